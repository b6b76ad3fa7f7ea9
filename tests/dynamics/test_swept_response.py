"""What a sweep runs through: against a closed form, and from branch to branch."""

import numpy as np
import pytest
from dynamics.plain_maps import PlainMap, logistic
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from calib.dynamics import neighbour_curve, swept_paths, swept_series
from calib.dynamics.arclength import run
from calib.dynamics.level_curve import LevelCurve
from calib.dynamics.series_curve import modal_system
from calib.dynamics.setting import Setting
from calib.dynamics.swept_path import swept_path
from calib.dynamics.swept_response import swept_curves, swept_response
from calib.dynamics.swept_series import SeriesSweep, series_sweep
from calib.effects.coulomb_friction import EFFECT as COULOMB_FRICTION
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.drive_harmonic_2 import EFFECT as DRIVE_HARMONIC_2
from calib.effects.presliding import EFFECT as PRESLIDING
from calib.effects.quadratic_stiffness import EFFECT as QUADRATIC_STIFFNESS
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, make_response
from calib.simulators.oscillator.oscillator import Oscillator

VALUES = {"mass": 1.0, "damping": 1.0, "stiffness": 400.0}  # kg, N s/m, N/m
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0)


def swept(frequency, level, direction=1.0, **cubic):
    measured = make_response(frequency, ["mass"], np.ones((1, len(frequency))), level, "N", 0, direction)
    model = Model(Oscillator(), [CUBIC_STIFFNESS] if cubic else [])
    return swept_response(model, {**VALUES, **cubic}, FORCE, measured)


def test_the_response_of_a_linear_oscillator_is_its_transfer_function():
    found = swept(np.linspace(2.6, 4.0, 8), 0.5)
    omega = 2.0 * np.pi * found.frequency.values
    expected = 0.5 / (400.0 - omega**2 + 1j * omega)
    np.testing.assert_allclose(complex_amplitude(found)[0], expected, atol=1e-8 * abs(expected).max())


def test_values_of_which_nothing_could_move_are_a_failed_simulation():
    measured = make_response(np.linspace(2.6, 4.0, 8), ["mass"], np.ones((1, 8)), 0.5, "N", 0, 1.0)
    found = swept_response(Model(Oscillator()), {**VALUES, "mass": 0.0}, FORCE, measured)
    assert found.attrs["status"] == "impossible value"
    assert "mass" in found.attrs["reason"]


def test_a_sweep_down_jumps_up_where_the_lower_branch_folds():
    found = swept(np.linspace(4.2, 3.0, 7), 0.6, -1.0, k3=4e5)
    assert found.attrs["jumps"].startswith("sweep 0: fold at 3.50802")
    amplitude, piece = np.abs(complex_amplitude(found)[0]), found.piece.values
    assert amplitude[piece == 1.0][0] > 1.5 * amplitude[piece == 0.0][-1]


def by_shooting(monkeypatch, *sweep, **values):
    with monkeypatch.context() as patched:
        patched.setattr(swept_paths, "series_sweep", lambda *_: None)
        return swept(*sweep, **values)


def at(found, frequency, piece):
    """Complex amplitude at frequencies, by a spline over one stretch of a response."""
    own = found.isel(point=found.piece.values == piece).sortby("frequency")
    return CubicSpline(own.frequency.values, complex_amplitude(own)[0])(frequency)


def test_a_sweep_by_harmonic_balance_is_that_by_shooting(monkeypatch):
    frequency = np.linspace(3.0, 4.2, 49)
    found, other = swept(frequency, 0.6, k3=4e5), by_shooting(monkeypatch, frequency, 0.6, k3=4e5)
    folds = [float(one.attrs["jumps"].split()[-2]) for one in (found, other)]
    assert folds[0] == pytest.approx(folds[1], abs=1e-6)
    for piece, shared in ((0.0, frequency[frequency < 3.75]), (1.0, frequency[frequency > 3.9])):
        expected = at(other, shared, piece)
        np.testing.assert_allclose(at(found, shared, piece), expected, atol=1e-4 * abs(expected).max())


def test_a_sweep_beside_that_of_other_values_is_the_one_sought_without_it(monkeypatch):
    measured = make_response(np.linspace(2.8, 3.6, 17), ["mass"], np.ones((1, 17)), 0.2, "N", 0, 1.0)
    model, friction = Model(Oscillator(), [COULOMB_FRICTION]), {"friction": 2e-3, "friction_slip": 5e-3}
    _, known = swept_curves(Model(Oscillator()), VALUES, FORCE, measured)
    sought = swept_response(model, {**VALUES, **friction}, FORCE, measured)
    monkeypatch.setattr(swept_paths, "swept_path", None)  # nothing is sought without the known one
    found, own = swept_curves(model, {**VALUES, **friction}, FORCE, measured, known)
    frequency = np.linspace(2.8, 3.6, 50)
    expected = at(sought, frequency, 0.0)
    np.testing.assert_allclose(at(found, frequency, 0.0), expected, atol=1e-4 * abs(expected).max())
    again, _ = swept_curves(model, {**VALUES, **friction}, FORCE, measured, own)
    np.testing.assert_allclose(complex_amplitude(again), complex_amplitude(found), atol=1e-9 * abs(expected).max())


def test_a_sweep_that_ends_near_the_resonance_is_found_beside_that_of_another_stiffness(monkeypatch):
    measured = make_response(np.linspace(2.8, 3.3, 17), ["mass"], np.ones((1, 17)), 0.2, "N", 0, 1.0)
    values, frequency = {**VALUES, "stiffness": 0.97 * VALUES["stiffness"]}, np.linspace(2.8, 3.3, 50)
    _, known = swept_curves(Model(Oscillator()), VALUES, FORCE, measured)
    expected = at(swept_response(Model(Oscillator()), values, FORCE, measured), frequency, 0.0)
    monkeypatch.setattr(swept_paths, "swept_path", None)  # nothing is sought without the known one
    found, _ = swept_curves(Model(Oscillator()), values, FORCE, measured, known)
    np.testing.assert_allclose(at(found, frequency, 0.0), expected, atol=1e-4 * abs(expected).max())


@pytest.mark.parametrize(("effect", "values"), [(CUBIC_STIFFNESS, {"k3": 1e5}), (PRESLIDING, {"dahl_force": 0.02})])
def test_a_curve_to_first_order_departs_by_the_square_of_what_is_changed(effect, values):
    measured = make_response(np.linspace(2.8, 3.6, 17), ["mass"], np.ones((1, 17)), 0.2, "N", 0, 1.0)
    base, model = Model(Oscillator()), Model(Oscillator(), [effect])
    undisturbed, known = swept_curves(base, VALUES, FORCE, measured)
    held = {p.name: 3e-3 if p.unit == "m" else p.nominal for p in effect.parameters}
    changes, errors = [], []
    for share in (0.01, 0.1):
        own = {**VALUES, **held, **{name: share * value for name, value in values.items()}}
        whole, linear = (
            complex_amplitude(swept_curves(model, own, FORCE, measured, known, to_first_order=flag)[0])
            for flag in (False, True)
        )
        changes.append(np.abs(whole - complex_amplitude(undisturbed)).max())
        errors.append(np.abs(whole - linear).max())
    assert errors[0] < 0.03 * changes[0]
    assert errors[1] / errors[0] == pytest.approx(100.0, rel=0.5)


def there_and_back(level, direction, high=4.2, amplitude=1.0):
    """A measured response of two sweeps over the same 25 frequencies [Hz], whose second has another amplitude [m]."""
    frequency, sizes = np.linspace(3.0, high, 25), np.repeat([1.0, amplitude], 25)
    ways = [frequency[:: int(way)] for way in direction]
    return make_response(
        np.concatenate(ways), ["mass"], sizes[None], level, "N", np.repeat([0.0, 1.0], 25),
        np.repeat(direction, 25), place="mass", quantity="force",
    )  # fmt: skip


@pytest.mark.parametrize("direction", [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
def test_a_curve_without_folds_is_followed_once_for_sweeps_there_and_back(direction, monkeypatch):
    values, measured = {**VALUES, "k3": 2e5}, there_and_back(0.1, direction)
    model = Model(Oscillator(), [CUBIC_STIFFNESS])
    follow, paths = swept_paths.swept_path, []
    monkeypatch.setattr(swept_paths, "swept_path", lambda *given: paths.append(1) or follow(*given))
    found, curves = swept_curves(model, values, FORCE, measured)
    assert len(paths) == 1
    back = measured.isel(point=measured.sweep.values == 1.0)
    alone, own = swept_curves(model, values, FORCE, back)
    expected = complex_amplitude(alone)[0]
    frequency = back.frequency.values
    np.testing.assert_allclose(at(found, frequency, 1.0), at(alone, frequency, 0.0), atol=1e-5 * abs(expected).max())
    assert np.sign(np.diff(found.frequency.values[found.piece.values == 1.0])).max() * direction[1] == 1.0
    np.testing.assert_allclose(curves[1.0].last, own[1.0].last, atol=1e-5 * abs(own[1.0].last).max())


def test_a_sweep_back_at_another_level_is_that_of_its_level():
    """Where the sweep turns both have nearly the same motion: that of one level is not the curve of the other."""
    measured = there_and_back(np.repeat([0.1, 0.1015], 25), (1.0, -1.0))
    found = swept_response(Model(Oscillator()), VALUES, FORCE, measured)
    frequency = np.linspace(3.0, 4.2, 50)
    np.testing.assert_allclose(at(found, frequency, 1.0), 1.015 * at(found, frequency, 0.0), rtol=1e-4)


def test_sweeps_go_on_from_one_another_where_two_motions_are_possible():
    """Up below the jump, back into where a lower motion is possible, and up again: on the upper one all the way."""
    ways = [np.linspace(3.3, 3.7, 17), np.linspace(3.7, 3.55, 7), np.linspace(3.55, 3.7, 7)]
    sweep = np.repeat([0.0, 1.0, 2.0], [way.size for way in ways])
    model, values = Model(Oscillator(), [CUBIC_STIFFNESS]), {**VALUES, "k3": 4e5}

    def size(amplitude, piece):
        measured = make_response(
            np.concatenate(ways), ["mass"], np.where(sweep < 2.0, 0.03, amplitude)[None], 0.6, "N",
            sweep, np.array([1.0, -1.0, 1.0])[sweep.astype(int)], place="mass", quantity="force",
        )  # fmt: skip
        return np.abs(at(swept_response(model, values, FORCE, measured), 3.65, piece))

    upper = size(0.03, 0.0)
    assert [size(0.03, piece) for piece in (1.0, 2.0)] == pytest.approx([upper, upper], rel=1e-4)
    assert size(0.006, 2.0) < 0.7 * upper  # where the laboratory stopped in between


def test_sweeps_there_and_back_over_a_fold_are_those_of_each_alone():
    values, measured = {**VALUES, "k3": 4e5}, there_and_back(0.6, (1.0, -1.0))
    model = Model(Oscillator(), [CUBIC_STIFFNESS])
    jumps = swept_response(model, values, FORCE, measured).attrs["jumps"].split("; ")
    for sweep, said in zip((0.0, 1.0), jumps, strict=True):
        alone = swept_response(model, values, FORCE, measured.isel(point=measured.sweep.values == sweep))
        assert alone.attrs["jumps"] == said


@pytest.mark.parametrize("by_series", [True, False])
def test_a_sweep_that_turns_below_the_jump_stays_on_the_motion_that_was_measured(by_series, monkeypatch):
    if not by_series:
        monkeypatch.setattr(swept_paths, "series_sweep", lambda *_: None)
    model, values = Model(Oscillator(), [CUBIC_STIFFNESS]), {**VALUES, "k3": 4e5}
    upper, lower = (
        swept_response(model, values, FORCE, there_and_back(0.6, (1.0, -1.0), 3.7, amplitude))
        for amplitude in (0.03, 0.006)
    )
    assert upper.attrs["jumps"] == ""
    frequency = np.linspace(3.0, 3.7, 50)
    expected = at(upper, frequency, 0.0)
    np.testing.assert_allclose(at(upper, frequency, 1.0), expected, atol=1e-4 * abs(expected).max())
    assert lower.attrs["jumps"].startswith("sweep 1: fold at 3.508")
    between = there_and_back(0.6, (1.0, -1.0), 3.7, 0.03)  # as tracked: the way back has frequencies of its own
    between.frequency[25:] -= 0.01
    assert swept_response(model, values, FORCE, between).attrs["jumps"] == ""


def test_a_sweep_whose_derivatives_would_take_too_much_memory_is_followed_anew(monkeypatch):
    measured = make_response(np.linspace(2.8, 3.6, 17), ["mass"], np.ones((1, 17)), 0.2, "N", 0, 1.0)
    found, known = swept_curves(Model(Oscillator()), VALUES, FORCE, measured)
    [stretch] = known.values()
    sweep = series_sweep(Setting(Model(Oscillator()), FORCE, VALUES), lambda at: 0.2, stretch.frequency[[0, -1]])
    assert sweep.beside(stretch) is not None
    monkeypatch.setattr(neighbour_curve, "MAX_MATRIX_ENTRIES", stretch.frequency.size * 16**2 - 1)
    assert sweep.beside(stretch) is None
    again, _ = swept_curves(Model(Oscillator()), VALUES, FORCE, measured, known)
    np.testing.assert_array_equal(complex_amplitude(again), complex_amplitude(found))


def test_a_sweep_that_folds_is_sought_without_those_that_do_not_and_knows_none():
    measured = make_response(np.linspace(3.0, 4.2, 25), ["mass"], np.ones((1, 25)), 0.6, "N", 0, 1.0)
    model, values = Model(Oscillator(), [CUBIC_STIFFNESS]), {**VALUES, "k3": 4e5}
    _, known = swept_curves(Model(Oscillator()), VALUES, FORCE, measured)
    found, curves = swept_curves(model, values, FORCE, measured, known)
    assert list(known) == [0.0]
    assert not curves
    assert found.attrs["jumps"] == swept_response(model, values, FORCE, measured).attrs["jumps"] != ""


def test_a_drive_with_a_second_harmonic_is_balanced_as_by_shooting(monkeypatch):
    frequency = np.linspace(3.0, 3.6, 13)
    measured = make_response(frequency, ["mass"], np.ones((1, 13)), np.linspace(0.2, 0.3, 13), "N", 0, 1.0)
    model = Model(Oscillator(), [QUADRATIC_STIFFNESS, DRIVE_HARMONIC_2])
    values = {**VALUES, "k2": 4e3, "h2_cos": 0.4, "h2_sin": -0.3}
    found, curves = swept_curves(model, values, FORCE, measured)
    monkeypatch.setattr(swept_paths, "series_sweep", lambda *_: None)
    expected = at(swept_response(model, values, FORCE, measured), frequency, 0.0)
    assert list(curves) == [0.0]
    np.testing.assert_allclose(at(found, frequency, 0.0), expected, atol=1e-4 * abs(expected).max())
    pure = at(swept_response(model, {**values, "h2_cos": 0.0, "h2_sin": 0.0}, FORCE, measured), frequency, 0.0)
    assert abs(pure - expected).max() > 1e-3 * abs(expected).max()


@pytest.mark.slow
def test_harmonics_are_added_until_those_left_out_hardly_move_the_mass(monkeypatch):
    """Dry friction that turns about within a small velocity has harmonics that fall slowly."""
    model, values = Model(Oscillator(), [COULOMB_FRICTION]), {**VALUES, "friction": 0.05, "friction_slip": 1e-3}
    setting = Setting(model, FORCE, values)
    sweep = SeriesSweep(setting, modal_system(setting, 2.8, 0.2), 0.2, (2.8, 3.6), 1.0, lambda _: 0.2)
    followed = []
    with monkeypatch.context() as patch:
        patch.setattr(swept_series, "run", lambda *way: followed.append(way) or run(*way))
        stretch = sweep.stretch(2.8, sweep.first(2.8))
    assert stretch.coefficients.shape[-1] > 2 * swept_series.SERIES_HARMONICS[0] + 1
    assert len(followed) == 1  # with more harmonics it was found beside that of fewer
    monkeypatch.setattr(swept_series, "SERIES_HARMONICS", (127,))
    expected = sweep.stretch(2.8, sweep.first(2.8))
    monkeypatch.setattr(swept_series, "SERIES_HARMONICS", (7,))
    assert sweep.stretch(2.8, sweep.first(2.8)) is None
    frequency = np.linspace(2.8, 3.6, 50)
    found, true = (CubicSpline(s.frequency, s.harmonics[:, 0, 1])(frequency) for s in (stretch, expected))
    np.testing.assert_allclose(found, true, atol=3e-4 * abs(true).max())


def test_beyond_a_rigid_stop_a_sweep_goes_on_by_shooting():
    measured = make_response(np.linspace(2.8, 3.6, 9), ["mass"], np.ones((1, 9)), 0.2, "N", 0, 1.0)
    found = swept_response(Model(Oscillator(stop=True)), {**VALUES, "gap": 5e-3, "restitution": 0.6}, FORCE, measured)
    assert found.attrs["jumps"].startswith("sweep 0: grazing at ")
    assert len(set(found.piece.values)) > 1


def test_a_sweep_is_that_of_another_integrator_sampled_by_a_clock_of_its_own():
    """Stepped up, each step begins where the last one ended; 997 samples a second know nothing of the drive."""
    frequencies, level, k3 = np.array([2.9, 3.3, 3.6, 3.78, 3.95]), 0.6, 4e5
    state, amplitudes = np.zeros(2), []
    for frequency in frequencies:
        omega = 2.0 * np.pi * frequency

        def rate(t, y, omega=omega):
            return y[1], level * np.cos(omega * t) - 1.0 * y[1] - 400.0 * y[0] - k3 * y[0] ** 3

        periods = 60.0 / frequency
        times = np.arange(0.0, 10.0 / frequency, 1.0 / 997.0)
        motion = solve_ivp(rate, (0.0, periods + times[-1]), state, "DOP853", periods + times, rtol=1e-9, atol=1e-12)
        angle = np.outer(omega * times, np.arange(1, 8))
        basis = np.hstack([np.ones((times.size, 1)), np.cos(angle), np.sin(angle)])
        coefficients = np.linalg.lstsq(basis, motion.y[0], rcond=None)[0]
        amplitudes.append(coefficients[1] - 1j * coefficients[8])
        # the next step begins at phase 0, as the drive of this one is after whole periods
        state = solve_ivp(rate, (0.0, periods), state, "DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
    found = swept(np.linspace(2.8, 4.2, 29), level, k3=k3)
    for frequency, expected in zip(frequencies, amplitudes, strict=True):
        piece = float(frequency > float(found.attrs["jumps"].split()[-2]))
        assert at(found, frequency, piece) == pytest.approx(expected, abs=2e-3 * abs(expected))


@pytest.mark.parametrize("points", [21, 101])
def test_a_level_measured_point_by_point_is_followed_without_corners(points):
    """The force of a test at constant response bends at every frequency where it was set; the sweep is one stretch."""
    frequency = np.linspace(3.0, 3.4, points)
    omega = 2.0 * np.pi * frequency
    needed = (400.0 - omega**2 + 0.5j * omega) * 1e-3
    ragged = needed * np.exp(0.02 * np.random.default_rng(1).standard_normal(points))  # what a controller really held
    level = np.abs(ragged)
    measured = make_response(frequency, ["mass"], 1e-3 * np.ones((1, points)), level, "N")
    simulated = swept_response(Model(Oscillator()), {"mass": 1.0, "stiffness": 400.0, "damping": 0.5}, FORCE, measured)
    assert set(simulated.piece.values.tolist()) == {0.0}
    assert simulated.frequency.values[[0, -1]] == pytest.approx([2.98, 3.42])  # a margin beyond what was measured
    places = [int(np.argmin(np.abs(simulated.frequency.values - at))) for at in frequency]
    at, own = simulated.frequency.values[places], complex_amplitude(simulated)[0, places]
    exact = simulated.level.values[places] / (400.0 - (2.0 * np.pi * at) ** 2 + 1j * np.pi * at)
    np.testing.assert_allclose(own, exact, rtol=1e-6)
    curve = LevelCurve(frequency, level)
    np.testing.assert_allclose([curve(f) for f in frequency], level, rtol=1e-12)
    assert all(curve(f) > 0.0 for f in (2.5, 2.99, 3.41, 4.0))


def test_levels_that_were_read_several_times_at_a_frequency_are_their_mean():
    three_times = LevelCurve(np.array([3.0, 3.0, 3.0, 3.2]), np.full(4, 0.4))
    assert {three_times(at) for at in (2.5, 3.0, 3.1, 4.0)} == {0.4}  # 0.4 + 0.4 + 0.4 is not three times 0.4
    assert LevelCurve(np.array([3.0, 3.0]), np.array([1.0, 2.0]))(3.0) == pytest.approx(1.5)
    alike = LevelCurve(np.array([3.0, 3.0, 4.0, 4.0]), np.array([1.0, 3.0, 3.0, 1.0]))
    assert alike(3.5) == pytest.approx(2.0)


def test_a_stretch_of_one_motion_that_needs_more_harmonics_is_followed_with_them():
    """Irregular motion may last to the last stop of a sweep, where a periodic one is met at last."""
    setting = Setting(
        Model(Oscillator(), [COULOMB_FRICTION]), FORCE, {**VALUES, "friction": 0.05, "friction_slip": 1e-3}
    )
    system = modal_system(setting, 3.6, 0.5)
    sweep = SeriesSweep(setting, system, 0.5, (2.8, 3.6), 1.0, lambda at: 0.5)
    stretch = sweep.stretch(3.6, sweep.first(3.6))
    assert stretch.frequency.tolist() == [3.6]


@pytest.mark.parametrize("direction", [1, -1])
def test_what_does_not_repeat_is_passed_over_without_asking_whether_it_is_chaos(direction, monkeypatch):
    """Windows of period 6, 5 and 3 within the chaos of the logistic map, whose exponents take 400 periods and more."""
    derivatives, tangent = [], PlainMap.tangent
    monkeypatch.setattr(PlainMap, "tangent", lambda *given: derivatives.append(given[-1]) or tangent(*given))
    path = swept_path(logistic, np.arange(3.3, 3.845, 0.01)[::direction])
    assert [piece.periods for piece in path.pieces] == ([2, 4, 8, 6, 5, 3] if direction > 0 else [3, 5, 6, 8])
    assert not path.reason
    assert sum(derivatives) < 10_000
