"""Curves of bifurcations of simulators: against closed forms, branches, sweeps and an integration of their own."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dynamics.known_oscillators import CUBIC, TURN, Ball, Impacting
from scipy.integrate import solve_ivp
from scipy.optimize import root

from calib.dynamics.branch import follow
from calib.dynamics.curves import follow_curves
from calib.dynamics.defining import ParameterPlane
from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator
from calib.study_file import load
from calib.sweep import Sweep, run

STUDY = Path(__file__).parents[2] / "studies" / "paper_minimal"
DAMPED = math.sqrt(1.0 - (0.5 * Impacting.c) ** 2)  # natural frequency of the damped oscillator  [rad/s]


def of_kind(curves, kind):
    return [curve for curve in curves if curve.kind == kind]


def driven(w, F):
    return Impacting(F).map(w)


def agrees_with_branches(maps, curve, count, reach):
    """Whether branches over a through some points of a curve have their special points there, to 1e-6 of a."""
    chosen = np.linspace(0, curve.a.size - 1, count + 2).astype(int)[1:-1]
    for i in chosen:
        a, b = curve.a[i], curve.b[i]
        branch = None
        for side in (-1.0, 1.0):
            at = a + 0.02 * side * reach
            branch = follow(
                lambda value, b=b: maps(value, b), curve.states[i], at, (at - reach, at + reach), curve.periods
            )
            located = [point.parameter for point in branch.points if point.kind == curve.kind]
            if located:
                break
        assert np.abs(np.array(located) - a).min() < 1e-6 * abs(a), branch.ends


# --- the ball on a table that vibrates


@pytest.mark.parametrize(
    ("ball", "kind"), [(Ball(1.3, 0.5), "fold"), (Ball(1.3, 0.5), "flip"), (Ball(2.2, 0.5, 2), "flip")]
)
def test_fold_and_flip_of_the_ball_are_the_curves_of_the_closed_form(ball, kind):
    k = ball.k
    at = {"fold": (0.98 * ball.fold, ball.drive), "flip": (ball.drive, ball.flip + 0.03)}[kind]
    branch = follow(lambda drive: Ball(drive, ball.e, k).map(), ball.state, ball.drive, at, k)
    plane = ParameterPlane(lambda drive, e: Ball(drive, e, k).map(), (0.5, 3.0), (0.4, 0.6))
    [curve] = follow_curves(branch, plane, ball.e)
    assert curve.kind == kind
    assert curve.b[[0, -1]] == pytest.approx([0.6, 0.4]) or curve.b[[0, -1]] == pytest.approx([0.4, 0.6])
    assert np.abs(curve.a - [getattr(Ball(1.0, e, k), kind) for e in curve.b]).max() < 1e-8


# --- the impacting oscillator


@pytest.mark.slow
def test_the_linear_motion_grazes_on_the_curve_of_the_closed_form():
    known = Impacting()
    branch = follow(known.map, known.map(0.8).orbit(np.zeros(2), 200).states[-1], 0.8, (0.75, 0.95))
    [curve] = follow_curves(branch, ParameterPlane(driven, (0.75, 0.95), (0.2, 0.4)), known.F)
    assert curve.kind == "grazing"
    assert np.abs(curve.b / np.hypot(1.0 - curve.a**2, known.c * curve.a) - 1.0).max() < 1e-9
    size = np.exp(-0.5 * known.c * TURN / curve.a)  # of both multipliers of the linear motion
    assert np.abs(np.abs(curve.multipliers) - size[:, None]).max() < 1e-9


@pytest.fixture(scope="module")
def impacting_curves():
    known = Impacting()
    guess = known.map(1.0).orbit(np.zeros(2), 100).states[-1]
    branch = follow(known.map, guess, 1.0, (0.5, 1.6))
    return follow_curves(branch, ParameterPlane(driven, (0.5, 1.6), (0.1, 0.6)), known.F)


@pytest.mark.slow
def test_fold_and_flip_of_the_impacting_motion_are_the_curves_of_the_closed_form(impacting_curves):
    [fold], [flip] = of_kind(impacting_curves, "fold"), of_kind(impacting_curves, "flip")

    def discriminant(F, w):
        a, b, c = Impacting(F).quadratic(w)
        return b * b - 4.0 * a * c

    def beyond_minus_one(F, w):
        return np.prod(Impacting(F).multipliers(w) + 1.0).real

    for curve, test in ((fold, discriminant), (flip, beyond_minus_one)):
        assert curve.a.size > 30
        assert all(test(F - 1e-8, w) * test(F + 1e-8, w) < 0.0 for w, F in zip(curve.a, curve.b, strict=True))


@pytest.mark.slow
def test_folds_and_flips_end_on_the_grazing_curve_at_fractions_of_the_damped_natural_frequency(impacting_curves):
    """Foale, Phil. Trans. R. Soc. A 347 (1994) 353; Chin, Ott, Nusse and Grebogi, Phys. Rev. E 50 (1994) 4427."""
    [fold], [flip], [grazing] = (of_kind(impacting_curves, kind) for kind in ("fold", "flip", "grazing"))
    [at_fold] = fold.points
    assert at_fold.kind == "fold-grazing"
    assert at_fold.a == pytest.approx(DAMPED, abs=1e-7)
    assert [point.kind for point in flip.points] == ["flip-grazing", "flip-grazing"]
    assert sorted(point.a for point in flip.points) == pytest.approx([2.0 / 3.0 * DAMPED, DAMPED], abs=1e-7)
    for point in (at_fold, *flip.points):
        assert Impacting(point.b).amplitude(point.a) == pytest.approx(1.0, abs=1e-7)
    assert (grazing.impacts == 0).all()  # one curve: both grazings of the branch lie on it


@pytest.mark.slow
def test_branches_over_another_drive_have_their_special_points_on_the_curves(impacting_curves):
    for curve in impacting_curves:
        agrees_with_branches(driven, curve, 3, 0.02)


# --- the beam of four degrees of freedom


def crossing(curves, kind, b):
    """Values of a at which curves of this kind have this b, by interpolation."""
    values = []
    for curve in of_kind(curves, kind):
        for i in np.flatnonzero((curve.b[1:] - b) * (curve.b[:-1] - b) <= 0.0):
            share = (b - curve.b[i]) / (curve.b[i + 1] - curve.b[i])
            values.append(curve.a[i] + share * (curve.a[i + 1] - curve.a[i]))
    return np.array(values)


def cells(swept, name, kind, impacts):
    """Two cells of a grid, (low, high) each, at the ends of the one stretch with motions of a kind and impacts."""
    mine = np.flatnonzero((swept.kind.values == kind) & (swept.impacts.values == impacts))
    assert (np.diff(mine) == 1).all()
    values = swept[name].values
    return [(values[max(mine[0] - 1, 0)], values[mine[0]]), (values[mine[-1]], values[mine[-1] + 1])]


@pytest.mark.slow
def test_the_curves_of_the_beam_scale_with_gap_and_amplitude_and_are_the_jumps_of_a_sweep(tmp_path):
    setting = load(STUDY).setting({"restitution": 0.1, "gap": 1e-3})
    names = "gap", "excitation.amplitude"

    def maps(gap, amplitude):
        return setting.map(dict(zip(names, (gap, amplitude), strict=True)))

    map = maps(1e-3, 1.5e-3)
    branch = follow(
        lambda gap: maps(gap, 1.5e-3), map.orbit(map.initial, 400).states[-1], 1e-3, (0.8e-3, 1.5e-3), most=1000
    )
    curves = follow_curves(branch, ParameterPlane(maps, (0.8e-3, 1.5e-3), (1.35e-3, 1.55e-3)), 1.5e-3)
    assert [curve.kind for curve in curves] == ["grazing", "fold", "grazing"]
    for curve in curves:
        assert np.ptp(curve.a / curve.b) < 1e-8
        agrees_with_branches(maps, curve, 1, 2e-5)
    over = {names[0]: np.concatenate([np.arange(0.81e-3, 0.88e-3, 1e-5), np.arange(1.11e-3, 1.31e-3, 1e-5)])}
    smaller = replace(setting, excitation=replace(setting.excitation, amplitude=1.4e-3))
    swept = run(Sweep(smaller, over, carry="both", settle=200), tmp_path / "sweep.nc")
    grazing, jump = np.sort(crossing(curves, "grazing", 1.4e-3)), crossing(curves, "fold", 1.4e-3)[0]
    _, (low, high) = cells(swept.sel(branch="forward"), names[0], "period-1", 1)
    assert low < jump < high
    (first, second), (low, high) = cells(swept.sel(branch="backward"), names[0], "period-1", 1)
    assert first < grazing[0] < second
    assert low < grazing[1] < high


@pytest.mark.slow
def test_grazing_and_flip_of_the_beam_over_restitution_and_frequency_are_the_changes_of_a_sweep(tmp_path):
    setting, frequency = load(STUDY).setting({"gap": 1e-3}), 26.3
    names = "restitution", "excitation.frequency"

    def maps(e, f):
        return setting.map(dict(zip(names, (e, f), strict=True)))

    map = maps(0.3, 26.24)
    branch = follow(lambda e: maps(e, 26.24), map.orbit(map.initial, 600).states[-1], 0.3, (0.15, 0.45), periods=2)
    curves = follow_curves(branch, ParameterPlane(maps, (0.15, 0.45), (26.2, 26.32)), 26.24)
    assert {(curve.kind, curve.periods) for curve in curves} == {("grazing", 1), ("flip", 2), ("fold", 2)}
    for curve in of_kind(curves, "grazing") + of_kind(curves, "flip"):
        agrees_with_branches(maps, curve, 1, 0.01)
    [grazing], flip = crossing(curves, "grazing", frequency), crossing(curves, "flip", frequency).max()
    grid = np.concatenate([np.arange(0.168, 0.176, 1e-3), [0.2, 0.3, 0.38], np.arange(0.4, 0.41, 2e-3)])
    driven_at = replace(setting, excitation=replace(setting.excitation, frequency=frequency))
    swept = run(Sweep(driven_at, {names[0]: grid}, carry="forward", settle=200), tmp_path / "sweep.nc")
    _, (low, high) = cells(swept, names[0], "period-1", 1)
    assert low < grazing < high
    _, (low, high) = cells(swept, names[0], "period-2", 3)
    assert low < flip < high


@pytest.mark.slow
def test_grazing_and_flip_of_the_beam_over_gap_and_amplitude_are_the_changes_of_a_sweep(tmp_path):
    """Of the motion of two periods; all lengths may be scaled alike, so that the curves are rays from the origin."""
    setting = load(STUDY).setting({"restitution": 0.3, "gap": 1e-3, "excitation.frequency": 26.3})
    names, amplitude = ("gap", "excitation.amplitude"), 1.47e-3

    def maps(gap, amplitude):
        return setting.map(dict(zip(names, (gap, amplitude), strict=True)))

    map = maps(1e-3, 1.5e-3)
    start = map.orbit(map.initial, 600).states[-1]
    branch = follow(lambda gap: maps(gap, 1.5e-3), start, 1e-3, (0.85e-3, 1.3e-3), periods=2)
    curves = follow_curves(branch, ParameterPlane(maps, (0.85e-3, 1.3e-3), (1.455e-3, 1.545e-3)), 1.5e-3)
    kinds = [(curve.kind, curve.periods) for curve in curves]
    assert kinds == [("grazing", 2), ("flip", 2), ("flip", 2), ("fold", 2), ("grazing", 1)]
    for curve in curves:
        assert np.ptp(curve.a / curve.b) < 1e-8
        assert curve.points == ()  # none of codimension two is met on a ray
    for curve in of_kind(curves, "flip"):
        agrees_with_branches(maps, curve, 1, 2e-5)
    first, last = np.sort(crossing(curves, "flip", amplitude))
    least, largest = np.sort(crossing(curves, "grazing", amplitude))
    ends = [0.905, 0.91, 0.92, 0.97, 1.018, 1.021, 1.024, 1.06, 1.16, 1.185, 1.188, 1.191, 1.21, 1.213, 1.22]
    gaps = np.array(ends) * amplitude / 1.5  # m
    smaller = replace(setting, excitation=replace(setting.excitation, amplitude=amplitude))
    swept = run(Sweep(smaller, {names[0]: gaps}, carry="both", settle=200), tmp_path / "sweep.nc")

    def of_period(branch, period, gap):
        """Whether the motion at the ends of the cell of the grid around a gap is of a period."""
        below = np.searchsorted(gaps, gap)
        return (swept.sel(branch=branch).kind.values[below - 1 : below + 1] == f"period-{period}").tolist()

    assert of_period("forward", 2, first) == [True, False]
    assert of_period("forward", 2, last) == [False, True]
    assert of_period("backward", 2, least) == [False, True]
    assert of_period("backward", 1, largest) == [False, True]


# --- Duffing's oscillator


@pytest.mark.slow
def test_the_folds_of_a_hardening_spring_are_those_of_its_own_variational_equation():
    damping, cubic = 0.1, 0.3
    values = {"mass": 1.0, "stiffness": 1.0, "damping": damping, "k3": cubic}
    setting = Setting(Model(Oscillator(), [CUBIC]), Excitation("mass", "force", frequency=1.0, amplitude=0.2), values)

    def maps(w, F):
        return setting.map({"excitation.frequency": w / TURN, "excitation.amplitude": F})

    def rate(t, y, w, F):
        slope = np.array([[0.0, 1.0], [-1.0 - 3.0 * cubic * y[0] ** 2, -damping]])
        force = F * math.cos(w * t) - damping * y[1] - y[0] - cubic * y[0] ** 3
        return np.concatenate([[y[1], force], (slope @ y[2:].reshape(2, 2)).ravel()])

    def folds(z, F):
        start = np.concatenate([z[:2], [1.0, 0.0, 0.0, 1.0]])
        end = solve_ivp(rate, (0.0, TURN / z[2]), start, "DOP853", args=(z[2], F), rtol=1e-12, atol=1e-13).y[:, -1]
        return [*(end[:2] - z[:2]), np.linalg.det(end[2:].reshape(2, 2) - np.eye(2))]

    map = maps(1.0, 0.2)
    branch = follow(lambda w: maps(w, 0.2), map.orbit(map.initial, 60).states[-1], 1.0, (0.95, 1.35), most=1000)
    curves = follow_curves(branch, ParameterPlane(maps, (0.95, 1.35), (0.15, 0.25)), 0.2)
    assert {curve.kind for curve in curves} == {"fold"}
    for curve in curves:
        for i in np.linspace(0, curve.a.size - 1, 4).astype(int):
            own = root(folds, [*curve.states[i], curve.a[i]], args=(curve.b[i],), tol=1e-11)
            assert own.x[2] == pytest.approx(curve.a[i], abs=1e-6)
