"""Sweeps at a held amplitude: against a closed form and another integrator, and as a calibration meets them."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from calib.dynamics.harmonic_condition import quadrature
from calib.dynamics.held_curve import HeldBalance, HeldCurve
from calib.dynamics.held_sweeps import held_sweeps
from calib.dynamics.setting import Setting
from calib.dynamics.swept_motions import NOT_HELD, swept_motions
from calib.dynamics.swept_response import swept_curves, swept_response
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.linear_drag import EFFECT as LINEAR_DRAG
from calib.effects.presliding import EFFECT as PRESLIDING
from calib.effects.residual_compliance import EFFECT as RESIDUAL_COMPLIANCE
from calib.effects.response_lag import EFFECT as RESPONSE_LAG
from calib.features.frequency_response import ResponseDistance
from calib.modelling.model import Model
from calib.objective import Objective, Reference, Term
from calib.records.excitation import Excitation
from calib.records.held_response import at_one_level
from calib.records.response import complex_amplitude, make_response
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

VALUES = {"mass": 1.0, "damping": 1.0, "stiffness": 400.0}  # kg, N s/m, N/m
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0)
FREQUENCY = np.linspace(2.8, 4.4, 17)  # Hz
K3 = 4e5  # 1/(m^2 s^2); at 12 mm and 20 mm some motions of the oscillator are unstable at a set force


def held(amplitude, direction=1.0, frequency=FREQUENCY):
    """A record that holds an amplitude [m]; the level and phases of it do not matter here."""
    size = np.broadcast_to(np.asarray(amplitude, dtype=float), frequency.shape)
    stepped = frequency[:: int(direction)]
    return at_one_level(make_response(stepped, ["mass"], size[None], 1.0, "N", 0, direction), "mass")


def motions(model, values, record):
    return swept_motions(model, values, FORCE, record, 7)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_level_of_a_linear_oscillator_is_its_stiffness_times_the_amplitude(direction):
    (stretch,) = motions(Model(Oscillator()), VALUES, held(2e-3, direction)).stretches
    omega = 2.0 * np.pi * stretch.frequency
    force = 2e-3 * (400.0 - omega**2 + 1j * omega)
    np.testing.assert_allclose(stretch.level, np.abs(force), rtol=1e-9)
    np.testing.assert_allclose(np.angle(stretch.harmonics[:, 0, 1]), -np.angle(force), atol=1e-9)
    assert np.all(direction * np.diff(stretch.frequency) > 0.0)


@pytest.mark.parametrize("amplitude", [5e-3, 12e-3, 20e-3])
def test_motions_of_a_hardening_spring_close_after_a_period_also_where_they_are_unstable(amplitude):
    (stretch,) = motions(Model(Oscillator(), [CUBIC_STIFFNESS]), {**VALUES, "k3": K3}, held(amplitude)).stretches
    np.testing.assert_allclose(np.abs(stretch.harmonics[:, 0, 1]), amplitude, rtol=1e-9)
    for k in range(0, stretch.frequency.size, 9):
        omega, order = 2.0 * np.pi * stretch.frequency[k], np.arange(stretch.harmonics.shape[2])
        start = [stretch.harmonics[k, 0].sum().real, (1j * omega * order * stretch.harmonics[k, 0]).sum().real]

        def rate(t, y, omega=omega, level=stretch.level[k]):
            return y[1], level * np.cos(omega * t) - y[1] - 400.0 * y[0] - K3 * y[0] ** 3

        end = solve_ivp(rate, (0.0, 2.0 * np.pi / omega), start, "DOP853", rtol=1e-11, atol=1e-14).y[:, -1]
        np.testing.assert_allclose(end, start, atol=2e-4 * amplitude * omega)


def test_some_of_these_are_unstable_at_a_set_level_and_none_at_a_small_amplitude():
    for amplitude, all_stable in ((5e-3, True), (12e-3, False), (20e-3, False)):
        setting = Setting(Model(Oscillator(), [CUBIC_STIFFNESS]), FORCE, {**VALUES, "k3": K3})
        (sweep,) = held_sweeps(setting, held(amplitude))
        assert sweep.branch.stable.all() == all_stable


def test_an_amplitude_that_follows_the_frequency_is_held_point_by_point():
    """As where the acceleration is held."""
    amplitude = 10e-3 * (2.8 / FREQUENCY) ** 2
    (stretch,) = motions(Model(Oscillator(), [CUBIC_STIFFNESS]), {**VALUES, "k3": K3}, held(amplitude)).stretches
    inside = (stretch.frequency >= 2.8) & (stretch.frequency <= 4.4)
    wanted = 10e-3 * (2.8 / stretch.frequency[inside]) ** 2
    np.testing.assert_allclose(np.abs(stretch.harmonics[inside, 0, 1]), wanted, rtol=2e-3)  # of a curve through points
    beyond = 10e-3 * (2.8 / stretch.frequency[~inside]) ** 2
    np.testing.assert_allclose(np.abs(stretch.harmonics[~inside, 0, 1]), beyond, rtol=1e-2)


@pytest.mark.parametrize(
    ("effect", "own"), [(RESIDUAL_COMPLIANCE, {"residual_compliance": 4e-4}), (RESPONSE_LAG, {"response_lag": 0.01})]
)
def test_what_is_held_is_what_is_measured(effect, own):
    model, record = Model(Oscillator(), [CUBIC_STIFFNESS, effect]), held(12e-3)
    values = {**VALUES, "k3": K3, **own}
    found = swept_response(model, values, FORCE, record)
    assert found.attrs["status"] == "ok"
    (stretch,) = motions(model, values, record).stretches
    read = np.abs(complex_amplitude(found))[0] * stretch.level / record.level.values[0]
    np.testing.assert_allclose(read, 12e-3, rtol=1e-6)


def test_what_a_simulation_returns_crosses_to_another_process():
    found, curves = swept_curves(Model(Oscillator()), VALUES, FORCE, held(2e-3))
    again, others = pickle.loads(pickle.dumps((found, curves)))
    assert again.identical(found)
    assert others.keys() == curves.keys() == {0.0}
    np.testing.assert_array_equal(others[0.0].coefficients, curves[0.0].coefficients)


BESIDE = [
    (CUBIC_STIFFNESS, {"k3": K3}, 12e-3, "k3"),  # some of its motions are unstable at a set force
    (PRESLIDING, {"dahl_force": 0.3, "dahl_distance": 3e-3}, 5e-3, "dahl_force"),
]


def levels(found, at=FREQUENCY):
    (stretch,) = found.stretches
    return np.exp(CubicSpline(stretch.frequency, np.log(stretch.level))(at))


@pytest.mark.parametrize(("effect", "own", "amplitude", "name"), BESIDE)
def test_beside_a_known_curve_the_same_levels_are_found(effect, own, amplitude, name):
    model, record, values = Model(Oscillator(), [effect]), held(amplitude), {**VALUES, **own}
    known, changed = motions(model, values, record), {**values, name: 1.05 * values[name]}
    alone, beside = motions(model, changed, record), swept_motions(model, changed, FORCE, record, 7, known.curves)
    np.testing.assert_allclose(levels(beside), levels(alone), rtol=3e-5)  # of a curve through other points
    one, other = beside.curves[0.0], known.curves[0.0]
    assert one.level.size == other.level.size
    np.testing.assert_allclose(one.frequency[[0, -1]], other.frequency[[0, -1]], rtol=1e-12)
    np.testing.assert_allclose(one.amplitude, amplitude, rtol=1e-9)
    assert one.stable.all() == alone.curves[0.0].stable.all()
    assert one.left_out.max() == pytest.approx(alone.curves[0.0].left_out.max(), rel=0.1)


@pytest.mark.parametrize(("effect", "own", "amplitude", "name"), BESIDE)
def test_to_first_order_the_error_falls_with_the_square_of_the_change(effect, own, amplitude, name):
    model, record, values = Model(Oscillator(), [effect]), held(amplitude), {**VALUES, **own}
    known, errors = motions(model, values, record), []
    for change in (0.04, 0.01):
        changed = {**values, name: (1.0 + change) * values[name]}
        exact = swept_motions(model, changed, FORCE, record, 7, known.curves)
        linear = swept_motions(model, changed, FORCE, record, 7, known.curves, to_first_order=True)
        errors.append(np.abs(levels(linear) - levels(exact)).max())
    assert errors[1] < errors[0] / 10.0


def test_a_known_curve_of_another_range_or_another_number_of_harmonics_is_none_to_be_beside():
    model, values = Model(Oscillator(), [CUBIC_STIFFNESS]), {**VALUES, "k3": K3}
    alone = motions(model, values, held(12e-3))
    narrow = motions(model, values, held(12e-3, frequency=FREQUENCY[3:])).curves
    more = {0.0: replace(alone.curves[0.0], coefficients=np.zeros((3, 2, 15)))}
    for other in (narrow, more):
        for first in (True, False):
            found = swept_motions(model, values, FORCE, held(12e-3), 7, other, first)
            np.testing.assert_array_equal(found.stretches[0].level, alone.stretches[0].level)


@pytest.mark.parametrize("level", [2e130, 1e300])
def test_of_a_level_that_is_no_number_nothing_is_left_and_nothing_is_complained_of(level):
    setting = Setting(Model(Oscillator(), [CUBIC_STIFFNESS]), FORCE, {**VALUES, "k3": K3})
    held_balance = HeldBalance(setting, "mass", (2.8, 4.4), (1e-3, 1e3), 7)
    curve = HeldCurve(held_balance, quadrature, 0.01, 1.0)
    z = np.zeros((2, 17))
    z[:, -2] = 0.5
    z[:, -1] = np.log(np.array([1e130, level]) / 1e-3) / np.log(1e6)
    assert np.isfinite(np.linalg.norm(curve.residual(z[0])))
    assert np.isnan(curve.residual(z[1])).all()
    assert np.isnan(curve.residuals(z)).all()


def test_beside_a_motion_within_a_stop_one_that_meets_it_is_not_held():
    model, values = Model(Oscillator(stop=True)), {**VALUES, "gap": 5e-3, "restitution": 0.6}
    known = motions(model, values, held(4e-3))
    found = swept_motions(model, {**values, "gap": 3.9e-3}, FORCE, held(4e-3), 7, known.curves)
    assert found.failure[0] == NOT_HELD


def test_a_joint_that_slides_is_held_too():
    model = Model(Oscillator(), [PRESLIDING])
    values = {**VALUES, "dahl_force": 0.3, "dahl_distance": 3e-3}
    (stretch,) = motions(model, values, held(5e-3)).stretches
    (free,) = motions(model, {**values, "dahl_force": 0.0}, held(5e-3)).stretches
    assert stretch.level.min() > 1.5 * free.level.min()  # the level that overcomes the friction at resonance
    np.testing.assert_allclose(np.abs(stretch.harmonics[:, 0, 1]), 5e-3, rtol=1e-9)


def test_of_several_bodies_the_one_that_was_held_has_its_amplitude():
    simulator = FourDof()
    model = Model(simulator)
    drive = Excitation("base", "base motion", frequency=20.0, amplitude=1e-4)
    if ("base motion", "base") not in simulator.excitations:
        quantity, place = sorted(simulator.excitations)[0]
        drive = Excitation(place, quantity, frequency=20.0, amplitude=1e-4)
    bodies = list(model.bodies)[:2]
    frequency = np.linspace(18.0, 22.0, 9)
    unit = "N" if drive.quantity == "force" else "m"
    record = make_response(frequency, bodies, np.full((2, 9), 1e-5), 1e-4, unit, 0, 1.0)
    found = swept_motions(model, {}, drive, at_one_level(record, bodies[1]), 1)
    assert found.failure is None, found.failure
    row = found.bodies.index(bodies[1])
    np.testing.assert_allclose(np.abs(found.stretches[0].harmonics[:, row, 1]), 1e-5, rtol=1e-6)


def test_beyond_a_rigid_stop_nothing_can_be_held_and_the_simulation_says_where():
    model = Model(Oscillator(stop=True))
    values = {**VALUES, "gap": 5e-3, "restitution": 0.6}
    within = swept_response(model, values, FORCE, held(4e-3))
    assert (within.attrs["status"], within.attrs["jumps"]) == ("ok", "")
    beyond = swept_response(model, values, FORCE, held(6e-3))
    assert beyond.attrs["status"] == NOT_HELD
    assert beyond.attrs["reason"].startswith("sweep 0: mass cannot be held at 0.006 m from 2.72 Hz")
    rising = swept_response(model, values, FORCE, held(np.linspace(4e-3, 6e-3, 17)))
    assert rising.attrs["status"] == NOT_HELD
    assert re.match("sweep 0: mass is not held beyond 3.[0-9]+ Hz: ", rising.attrs["reason"])


@pytest.mark.parametrize(("low", "high", "ratio"), [(10.0, 500.0, 0.01), (50.0, 150.0, 0.001), (20.0, 2000.0, 0.01)])
def test_a_wide_window_with_a_sharp_resonance_is_swept_to_its_end(low, high, ratio):
    omega = 2.0 * np.pi * 100.0
    values = {"mass": 1.0, "damping": 2.0 * ratio * omega, "stiffness": omega**2}
    frequency = np.sort(np.append(np.geomspace(low, high, 40), 100.0 * (1.0 + ratio * np.linspace(-5.0, 5.0, 21))))
    own = (2.0 * np.pi * frequency) ** 2
    force = omega**2 - own + 2j * ratio * omega * np.sqrt(own)
    raw = make_response(
        frequency, ["mass"], (1.0 / own * np.exp(-1j * np.angle(force)))[None], np.abs(force) / own, "N"
    )
    record = at_one_level(raw, "mass")
    found = swept_response(Model(Oscillator()), values, FORCE, record)
    assert found.attrs["status"] == "ok"
    reference = Reference("wide", record, excitation=FORCE)
    assert Objective({"wide": reference}, [Term(ResponseDistance())])({"wide": found}).cost < 0.01


def test_the_noise_of_readings_of_the_amplitude_is_not_followed():
    frequency = np.linspace(2.8, 4.4, 200)
    rng = np.random.default_rng(3)
    omega = 2.0 * np.pi * frequency
    size = 2e-3 * (1.0 + 0.01 * rng.standard_normal(200))
    force = 2e-3 * (400.0 - omega**2 + 1j * omega)
    raw = make_response(frequency, ["mass"], (size * np.exp(-1j * np.angle(force)))[None], np.abs(force), "N")
    record = at_one_level(raw, "mass")
    (stretch,) = motions(Model(Oscillator()), VALUES, record).stretches
    np.testing.assert_allclose(np.abs(stretch.harmonics[:, 0, 1]), 2e-3, rtol=5e-3)
    assert stretch.frequency.size < 200


def test_what_feeds_a_motion_is_held_back():
    """A force along the velocity overcomes the damping: the level and its phase are those of both together."""
    feeding = replace(LINEAR_DRAG, parameters=(replace(LINEAR_DRAG.parameters[0], low=-np.inf),))
    (stretch,) = motions(Model(Oscillator(), [feeding]), {**VALUES, "c1": -3.0}, held(2e-3)).stretches
    omega = 2.0 * np.pi * stretch.frequency
    force = 2e-3 * (400.0 - omega**2 + 1j * omega * (1.0 - 3.0))
    np.testing.assert_allclose(stretch.level, np.abs(force), rtol=1e-9)
    turned = np.exp(1j * np.angle(force)) * stretch.harmonics[:, 0, 1] / 2e-3
    np.testing.assert_allclose(turned, 1.0, atol=1e-9)
