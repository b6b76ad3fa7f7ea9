"""Frequency responses: against closed forms, another integrator, and a surface of motions with an isola."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from dynamics.plain_maps import PlainMap
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, fsolve

import calib.dynamics.response
from calib.dynamics.harmonic_response import balanced_response
from calib.dynamics.response import frequency_response
from calib.dynamics.response_dataset import response_dataset
from calib.dynamics.setting import Setting
from calib.dynamics.swept_response import swept_response
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.residual_compliance import EFFECT as RESIDUAL_COMPLIANCE
from calib.effects.response_lag import EFFECT as RESPONSE_LAG
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, make_response
from calib.simulators.oscillator.oscillator import Oscillator

MASS, DAMPING, STIFFNESS = 1.0, 1.0, 400.0  # kg, N s/m, N/m
VALUES = {"mass": MASS, "damping": DAMPING, "stiffness": STIFFNESS}
K3 = 4e5  # N/m^3
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0, phase=0.4)


def transfer(frequency, level):
    """Complex displacement of the linear oscillator [m]."""
    omega = 2.0 * np.pi * frequency
    return level / (STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega)


def setting(*effects, stop=False, **values):
    return Setting(Model(Oscillator(stop=stop), effects), FORCE, {**VALUES, **values})


@pytest.fixture(scope="module")
def duffing():
    return frequency_response(setting(CUBIC_STIFFNESS, k3=K3), (2.5, 4.5), [0.1, 0.6], steps=5)


# --- the linear oscillator


def test_the_response_of_a_linear_oscillator_is_its_transfer_function():
    response = frequency_response(setting(), (2.5, 4.0), [0.5, 2.0], steps=3)
    assert response.levels == (0.5, 2.0)
    for one in response.branches:
        expected = transfer(one.frequency, one.level)
        np.testing.assert_allclose(one.harmonics[0, 1], expected, atol=1e-9 * abs(expected).max())
        np.testing.assert_allclose(one.peak[0], abs(expected), rtol=1e-4)
        assert np.abs(one.harmonics[0, [0, 2, 3]]).max() < 1e-9 * abs(expected).max()
        assert one.branch.stable.all()
        assert one.branch.ends == ("edge of the window, 2.5", "edge of the window, 4")
    assert len(response.branches) == 2


def test_the_phase_does_not_depend_on_that_of_the_section():
    other = setting()
    other = Setting(other.model, FORCE, other.values, phase=0.3)
    [one] = frequency_response(other, (2.5, 3.0), [0.5], steps=2).branches
    np.testing.assert_allclose(one.harmonics[0, 1], transfer(one.frequency, 0.5), atol=1e-11)


# --- Duffing's oscillator


def flow(frequency, level, state):
    """State after a period, by another integrator, from phase zero of the force's record."""
    omega = 2.0 * math.pi * frequency

    def rate(t, y):
        force = level * math.cos(omega * t + FORCE.phase)
        return [y[1], (force - DAMPING * y[1] - STIFFNESS * y[0]) / MASS - K3 * y[0] ** 3]

    return solve_ivp(rate, (0.0, 1.0 / frequency), state, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]


def derivative(frequency, level, state):
    steps = np.diag([1e-7, 1e-6])
    return np.array([
        (flow(frequency, level, state + h) - flow(frequency, level, state - h)) / (2.0 * h.sum()) for h in steps
    ]).T  # fmt: skip


@pytest.mark.slow
def test_the_folds_of_duffing_agree_with_another_integrator(duffing):
    [one] = duffing.at(0.6)
    folds = [point for point in one.branch.points if point.kind == "fold"]
    assert len(folds) == 2
    scale = np.array([0.02, 0.5])

    def defining(unknown):
        state, frequency = unknown[:2] * scale, unknown[2]
        singular = np.linalg.det(derivative(frequency, 0.6, state) - np.eye(2))
        return [*((flow(frequency, 0.6, state) - state) / scale), singular]

    for fold in folds:
        root = fsolve(defining, [*(fold.state / scale), fold.parameter], xtol=1e-10)
        assert fold.parameter == pytest.approx(root[2], rel=1e-6)


def test_a_stepped_sweep_by_another_integrator_comes_to_the_stable_parts(duffing):
    [one] = duffing.at(0.6)
    low, high = sorted(point.parameter for point in one.branch.points if point.kind == "fold")
    frequency = 0.5 * (low + high)
    stable = one.branch.stable
    for start in (0.0, 0.06):  # the lower and the upper motion
        state = np.array([start, 0.0])
        for _ in range(80):
            state = flow(frequency, 0.6, state)
        there = [
            place
            for place in np.flatnonzero(stable[:-1] & stable[1:])
            if (one.frequency[place] - frequency) * (one.frequency[place + 1] - frequency) <= 0.0
        ]
        assert len(there) == 2
        nearest = min(there, key=lambda place: np.abs(one.branch.states[place] - state).max())
        ends = one.branch.states[nearest : nearest + 2]
        assert (np.abs(state - ends.mean(axis=0)) < np.abs(ends[1] - ends[0]) + 1e-9).all()
    assert one.branch.stable.sum() < one.frequency.size


def test_the_peaks_of_weak_duffing_lie_on_its_first_order_backbone():
    response = frequency_response(setting(CUBIC_STIFFNESS, k3=2e4), (2.9, 3.5), [0.2, 0.4], steps=3)
    for one in response.branches:
        amplitude = abs(one.harmonics[0, 1])
        top = int(amplitude.argmax())
        backbone = math.sqrt(STIFFNESS / MASS + 0.75 * 2e4 * amplitude[top] ** 2) / (2.0 * math.pi)
        assert one.frequency[top] == pytest.approx(backbone, rel=3e-3)
        assert backbone > 1.001 * math.sqrt(STIFFNESS / MASS) / (2.0 * math.pi)


# --- a stop


@pytest.mark.slow
def test_the_motion_comes_to_the_stop_where_its_amplitude_is_the_gap():
    gap = 0.02
    response = frequency_response(setting(stop=True, gap=gap, restitution=0.6), (2.0, 5.0), [0.8], steps=9)

    def beyond(frequency):
        return abs(transfer(frequency, 0.8)) - gap

    expected = [brentq(beyond, 2.0, 3.18), brentq(beyond, 3.19, 5.0)]
    free = [one for one in response.branches if not one.branch.impacts.any()]
    found = sorted(p.parameter for one in free for p in one.branch.points if p.kind == "grazing")
    assert found == pytest.approx(expected, rel=1e-6)
    knocking = [one for one in response.branches if one.branch.impacts.any()]
    assert any(one.branch.stable.any() for one in knocking)
    for one in knocking:
        assert np.abs(one.harmonics[0, 0]).max() > 1e-5  # the stop is on one side


def test_motions_beyond_the_branches_that_are_followed_are_told(monkeypatch):
    monkeypatch.setattr(calib.dynamics.response, "MAX_BRANCHES", 1)
    response = frequency_response(setting(stop=True, gap=0.02, restitution=0.6), (2.0, 5.0), [0.8], steps=9)
    assert len(response.branches) == 1
    beyond = [met for met in response.irregular if met.kind.startswith("beyond the 1 branches")]
    assert beyond
    assert all(2.0 <= met.frequency <= 5.0 for met in beyond)


# --- curves apart from the others


def bumped(x, f):
    """Surface whose level sets are the motions: at levels between its hollow and the pass, one of them is closed."""
    return x - 3.0 * np.exp(-((f - 3.0) ** 2 + (x - 2.2) ** 2) / 0.3)


class SurfaceMap(PlainMap):
    def __init__(self, frequency, level):
        super().__init__(lambda x: x + 0.1 * (level - bumped(x, frequency)), None, [0.0])

    def motion(self, state, periods, samples):
        return np.tile(state[:1] * np.cos(2.0 * np.pi * np.arange(periods * samples) / samples), (1, 1))


def surface():
    return SimpleNamespace(
        map=lambda varied=None: SurfaceMap(*(varied or {"f": 3.0, "a": 0.5}).values()),
        unit=lambda name: "m", section_phase=0.0, values={},
        excitation=Excitation("base", "base motion", frequency=3.0, amplitude=0.5),
        model=SimpleNamespace(name="surface", measured_response=lambda record, values: record),
    )  # fmt: skip


def test_a_closed_curve_is_found_by_continuation_in_the_level():
    without = frequency_response(surface(), (1.0, 5.0), [0.5], steps=3)
    assert len(without.branches) == 1
    response = frequency_response(surface(), (1.0, 5.0), [0.5], steps=3, isolas=True)
    [closed] = [one for one in response.branches if one.isolated]
    x = closed.harmonics[0, 1].real
    assert np.abs(bumped(x, closed.frequency) - 0.5).max() < 1e-8
    assert closed.branch.ends == ("the branch closes on itself",) * 2
    assert 2.2 < closed.frequency.min() < 3.0 < closed.frequency.max() < 3.8
    assert response.branches[0].isolated is False


# --- effects on what is measured


RESIDUAL, LAG = 2e-3, 5e-3  # m/N, s
MEASURED_WITH = {"residual_compliance": RESIDUAL, "response_lag": LAG}


@pytest.fixture(scope="module", params=[frequency_response, balanced_response])
def measured_and_motion(request):
    """One branch with a level that follows the frequency: as it is measured, and of the motion itself."""
    motion, effects = setting(CUBIC_STIFFNESS, k3=2e4), (RESIDUAL_COMPLIANCE, RESPONSE_LAG)
    measured = replace(motion, model=motion.model.extended(*effects), values={**motion.values, **MEASURED_WITH})
    return [
        request.param(held, (2.6, 3.6), [0.3], steps=3, amplitude=lambda level, f: level * f / 3.0).branches[0]
        for held in (measured, motion)
    ]


@pytest.mark.slow
def test_the_first_harmonic_is_what_effects_on_the_response_have_measured(measured_and_motion):
    measured, motion = measured_and_motion
    np.testing.assert_array_equal(measured.frequency, motion.frequency)
    level = 0.3 * motion.frequency / 3.0
    expected = (motion.harmonics[0, 1] + RESIDUAL * level) * np.exp(-2j * np.pi * LAG * motion.frequency)
    np.testing.assert_allclose(measured.harmonics[0, 1], expected, rtol=1e-12)
    assert np.abs(measured.harmonics[0, 1] / motion.harmonics[0, 1] - 1.0).min() > 0.05


def test_higher_harmonics_are_late_by_the_lag_and_have_no_residual(measured_and_motion):
    measured, motion = measured_and_motion
    orders = np.arange(2, motion.harmonics.shape[1])[:, None]
    expected = motion.harmonics[0, 2:] * np.exp(-2j * np.pi * LAG * orders * motion.frequency)
    np.testing.assert_allclose(measured.harmonics[0, 2:], expected, rtol=1e-12, atol=1e-20)


def test_the_curve_is_the_one_that_a_measured_response_is_compared_with(measured_and_motion):
    measured, _ = measured_and_motion
    points = slice(None, None, -(-measured.frequency.size // 7))
    frequency = measured.frequency[points]
    record = make_response(frequency, ["mass"], np.ones((1, frequency.size)), 0.1 * frequency, "N", 0,
                           np.sign(frequency[-1] - frequency[0]))  # fmt: skip
    model = Model(Oscillator(), (CUBIC_STIFFNESS, RESIDUAL_COMPLIANCE, RESPONSE_LAG))
    swept = swept_response(model, {**VALUES, "k3": 2e4, **MEASURED_WITH}, FORCE, record)
    order = np.argsort(swept.frequency.values)
    compared = CubicSpline(swept.frequency.values[order], complex_amplitude(swept)[0, order])(frequency)
    size = np.abs(measured.harmonics[0, 1]).max()
    np.testing.assert_allclose(compared, measured.harmonics[0, 1, points], atol=1e-4 * size)


def test_the_motion_itself_is_left_as_it_is_by_effects_on_the_response(measured_and_motion):
    measured, motion = measured_and_motion
    np.testing.assert_array_equal(measured.peak, motion.peak)
    np.testing.assert_array_equal(measured.harmonics[:, 0], motion.harmonics[:, 0])
    np.testing.assert_array_equal(measured.branch.states, motion.branch.states)


# --- what is refused, and the file


@pytest.mark.parametrize(
    ("window", "levels", "options", "says"),
    [
        ((3.0, 3.0), [1.0], {}, "from a positive one to a higher one"),
        ((-1.0, 3.0), [1.0], {}, "from a positive one to a higher one"),
        ((2.0, 3.0), [], {}, "one or more positive levels"),
        ((2.0, 3.0), [1.0, math.nan], {}, "one or more positive levels"),
        ((2.0, 3.0), [1.0], {"harmonics": 0}, "at least 1 harmonic and 2 steps, got 0 and 17"),
    ],
)
def test_what_is_no_response_is_refused(window, levels, options, says):
    with pytest.raises(CalibError, match=says):
        frequency_response(setting(), window, levels, **options)


def test_a_map_that_tells_no_motion_is_refused():
    plain = surface()
    plain.map = lambda varied=None: PlainMap(lambda x: 0.5 * x, None, [0.0])
    with pytest.raises(CalibError, match=r"'surface' does not tell the motion between its sections.*`motion`"):
        frequency_response(plain, (1.0, 2.0), [1.0])


def test_the_dataset_holds_every_point_with_its_level(duffing):
    dataset = response_dataset(duffing)
    sizes = [one.frequency.size for one in duffing.branches]
    assert dataset.sizes["point"] == sum(sizes)
    assert dataset.sizes["harmonic"] == 4
    louder = dataset.isel(point=dataset.level.values == 0.6).sel(body="mass", harmonic=1)
    [one] = duffing.at(0.6)
    np.testing.assert_array_equal(louder.amplitude, abs(one.harmonics[0, 1]))
    np.testing.assert_array_equal(louder.phase, np.angle(one.harmonics[0, 1]))
    at = dataset.special_point.values
    folds = dataset.special_kind.values == "fold"
    assert folds.sum() == 2
    np.testing.assert_allclose(dataset.frequency.values[at[folds]], dataset.special_frequency.values[folds])
    assert all("units" in dataset[name].attrs for name in ("amplitude", "phase", "frequency", "level"))


def test_on_level_counts_the_levels():
    told = []
    frequency_response(setting(), (2.0, 2.5), [2.0, 1.0, 2.0], steps=2, on_level=lambda *args: told.append(args))
    assert told == [(1.0, 0), (2.0, 1)]
