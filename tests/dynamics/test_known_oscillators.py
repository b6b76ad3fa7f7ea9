"""Kinds, exponents, shooting and continuation on simulators whose motions are known."""

import math

import numpy as np
import pytest
from dynamics.known_oscillators import (
    CUBIC,
    TURN,
    VAN_DER_POL,
    Ball,
    Impacting,
    driven,
    duffing,
    duffing_exponent,
)
from scipy.integrate import solve_ivp
from scipy.optimize import root

from calib.dynamics.branch import follow
from calib.dynamics.exponents import spectrum, standard_error
from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.orbit_kind import CHAOTIC, QUASI_PERIODIC
from calib.dynamics.orbits import shoot
from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.records.cycles import NO_CONTACT
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator
from calib.sweep import Sweep, run

BALLS = [Ball(1.3, 0.5), Ball(2.2, 0.5, 2), Ball(1.0, 0.8), Ball(1.1, 0.8, 2), Ball(1.3, 0.8, 3), Ball(2.3, 0.2)]
LOCKED = 2.5e-4 / TURN  # share of a period by which the end of chatter is cut short, at most: `lift` of the problem


def found(branch, kind):
    return [point for point in branch.points if point.kind == kind]


def same_rows(found, expected, abs):
    """Whether the rows (n, m) are the same in any order."""
    assert len(found) == len(expected)
    order, other = np.lexsort(found.T[::-1]), np.lexsort(expected.T[::-1])
    np.testing.assert_allclose(found[order], expected[other], rtol=0.0, atol=abs)


# --- the ball on a table that vibrates


@pytest.mark.parametrize("ball", BALLS)
def test_the_ball_meets_the_table_at_the_phase_and_with_the_speed_of_the_closed_form(ball):
    cycle = shoot(ball.map(), ball.state + [1e-5, 1e-3], ball.k)
    phi, speed = ball.impact
    assert cycle.converged
    assert cycle.impacts == 1
    assert (cycle.orbit.impacts[0, 1] + ball.phase) % 1.0 == pytest.approx(phi / TURN, abs=1e-9)
    assert cycle.orbit.impacts[0, 2] == pytest.approx(speed, rel=1e-9)
    np.testing.assert_allclose(cycle.state / ball.map().scale, ball.state / ball.map().scale, atol=1e-9)


@pytest.mark.parametrize("ball", [*BALLS, Ball(1.9, 0.5), Ball(1.4, 0.8)])  # the last two are unstable
def test_the_ball_has_the_multipliers_of_the_closed_form(ball):
    cycle = shoot(ball.map(), ball.state, ball.k)
    np.testing.assert_allclose(np.sort(cycle.multipliers), np.sort(ball.multipliers), atol=1e-7)
    assert cycle.stable == (ball.drive < ball.flip)


@pytest.mark.parametrize("ball", BALLS)
def test_fold_and_flip_of_the_ball_are_those_of_the_closed_form(ball):
    def maps(drive):
        return Ball(drive, ball.e, ball.k).map()

    branch = follow(maps, ball.state, ball.drive, (0.9 * ball.fold, ball.flip + 0.2), ball.k)
    [fold], [flip] = found(branch, "fold"), found(branch, "flip")
    assert fold.parameter == pytest.approx(ball.fold, abs=1e-6)
    assert flip.parameter == pytest.approx(ball.flip, abs=1e-6)
    high_bounce = math.hypot(ball.fold, 1.0)  # Holmes (1982): the same fold, another flip
    assert abs(flip.parameter - high_bounce) > 5e-3


def test_the_unstable_motion_of_the_ball_ends_where_it_grazes_the_table():
    e = 0.2

    def touches(z):  # height and its rate above the table z[1] rad after the impact, at the drive z[0]
        drive, s = z
        phi = -math.acos(Ball(drive, e).fold / drive)
        height = math.pi * s - 0.5 * s * s - drive * (math.sin(phi + s) - math.sin(phi))
        return [height, math.pi - s - drive * math.cos(phi + s)]

    exact = root(touches, [2.6, 1.6], tol=1e-13).x[0]
    branch = follow(lambda drive: Ball(drive, e).map(), Ball(2.3, e).state, 2.3, (2.0, 2.8))
    [grazing] = found(branch, "grazing")
    assert grazing.parameter == pytest.approx(exact, abs=1e-6)
    assert not branch.stable[grazing.index]


@pytest.mark.parametrize("k", [1, 2, 3])
def test_one_impact_in_k_periods_is_called_so_where_all_three_motions_live_side_by_side(k):
    ball = Ball(1.06, 0.8, k)
    assert ball.fold < ball.drive < ball.flip
    kind = kind_of_orbit(ball.map(), ball.state + [1e-6, 1e-4])
    assert (kind.kind, kind.label) == (f"period-{k}", f"1/{k}")
    assert kind.exponent == pytest.approx(math.log(np.abs(ball.multipliers).max()) / k, abs=1e-6)


def test_the_exponent_is_that_of_the_losses_where_neighbours_turn_about_the_motion():
    ball = Ball(1.3, 0.5)
    assert np.iscomplex(ball.multipliers).all()
    assert kind_of_orbit(ball.map(), ball.state).exponent == pytest.approx(math.log(0.5), abs=1e-9)


@pytest.mark.parametrize(("n", "drive"), [(1, 1.4), (2, 1.58), (4, 1.682), (8, 1.7), (16, 1.7037)])
def test_the_doublings_of_the_ball_have_the_periods_and_the_impacts_of_its_own_iteration(n, drive):
    ball = Ball(drive, 0.5)
    kind = kind_of_orbit(ball.map(), Ball(1.4, 0.5).state)
    assert (kind.kind, kind.label) == (f"period-{n}", f"{n}/{n}")
    rows = ball.bounces(600)[-64:]
    returns = [np.abs(rows[m:] - rows[:-m]).max() for m in range(1, 33)]
    assert 1 + int(np.flatnonzero(np.array(returns) < 1e-9)[0]) == n
    impacts = kind.orbit.impacts[:n]
    speeds = impacts[:, 2] * TURN * ball.frequency / 9.81
    same_rows(np.column_stack([(impacts[:, 1] + ball.phase) % 1.0 * TURN, speeds]), rows[-n:, :2], abs=1e-8)


def test_the_two_cycle_of_the_ball_is_born_where_its_fixed_point_flips():
    e = 0.5

    def maps(drive):
        return Ball(drive, e).map()

    two = kind_of_orbit(maps(1.58), Ball(1.4, e).state)
    branch = follow(maps, two.state, 1.58, (1.5, 1.7), periods=2)
    birth, flip = branch.points
    assert (birth.kind, flip.kind) == ("flip", "flip")
    assert birth.parameter == pytest.approx(Ball(1.4, e).flip, abs=1e-6)
    assert "half its period" in branch.ends[0]
    assert kind_of_orbit(maps(flip.parameter - 2e-3), two.state).kind == "period-2"
    assert kind_of_orbit(maps(flip.parameter + 2e-3), two.state).kind == "period-4"


def test_the_chaotic_ball_has_the_exponent_of_its_own_iteration():
    ball = Ball(1.72, 0.5)
    kind = kind_of_orbit(ball.map(), Ball(1.4, 0.5).state)
    assert kind.kind == CHAOTIC
    assert kind.impacts_per_period == 1.0
    rows, vector, logarithms = ball.bounces(2500), np.array([1.0, 0.3]), []
    for phi, closing, s in rows:
        gap, rate = vector[0] + s * vector[1], vector[1]
        slope = (1.0 + ball.e) * (ball.drive * math.sin(phi) - 1.0) / closing
        vector = -np.array([ball.e * gap, ball.e * rate + slope * gap])
        logarithms.append(math.log(np.linalg.norm(vector)))
        vector /= np.linalg.norm(vector)
    logarithms = np.array(logarithms[100:])
    assert rows[100:, 2].mean() == pytest.approx(TURN, rel=1e-2)  # so that an impact is a period
    both = math.hypot(kind.error, standard_error(logarithms))
    assert both < 0.04
    assert kind.exponent == pytest.approx(logarithms.mean(), abs=4.0 * both)
    assert kind.exponent > 5.0 * both


@pytest.mark.parametrize("e", [0.0, 0.5, 0.99])
def test_below_a_drive_of_one_g_the_ball_rests(e):
    kind = kind_of_orbit(Ball(0.95, e).map())
    assert (kind.kind, kind.label) == ("period-1", "0/1")
    assert kind.contact == pytest.approx(1.0, abs=1e-12)
    assert kind.exponent == -math.inf


@pytest.mark.parametrize(("e", "drive"), [(0.0, 1.2), (0.0, 2.0), (0.2, 1.2), (0.2, 1.5), (0.5, 1.2), (0.5, 1.3)])
def test_chatter_ends_in_contact_for_the_time_of_its_own_iteration(e, drive):
    ball = Ball(drive, e)
    kind = kind_of_orbit(ball.map())
    begins = now = math.asin(1.0 / drive)  # where the table falls away from below the ball
    speed, bounces = 0.0, 0
    while bounces == 0 or speed > 1e-6:
        s, closing = ball.flight(now, speed)
        now, speed, bounces = now + s, e * closing, bounces + 1
    now += 2.0 * speed / (1.0 - drive * math.sin(now)) / (1.0 - e)
    assert kind.kind == "period-1"
    assert kind.exponent == -math.inf
    assert kind.contact == pytest.approx(1.0 - (now - begins) / TURN, abs=LOCKED if e else 1e-12)
    assert 1 <= kind.impacts <= bounces


# --- smooth oscillators


@pytest.mark.slow
def test_ueda_s_oscillator_is_chaotic_with_its_known_exponent():
    start = (2.5, 0.0)
    map = duffing(0.05, 0.0, 1.0, 7.5, start=start)
    kind = kind_of_orbit(map, settle=100)
    assert kind.kind == CHAOTIC
    value, error = duffing_exponent(0.05, 0.0, 1.0, 7.5, start)
    assert value == pytest.approx(0.1034 * TURN, abs=4.0 * error)  # Sprott, Chaos and Time-Series Analysis (2003)
    assert kind.exponent == pytest.approx(value, abs=4.0 * math.hypot(error, kind.error))
    assert kind.error < 0.08


def test_the_exponents_of_ueda_s_oscillator_add_up_to_its_losses():
    map = duffing(0.05, 0.0, 1.0, 7.5)
    assert spectrum(map, np.array([2.5, 0.0]), 30).sum() == pytest.approx(-0.05 * TURN, abs=2e-6)


def test_the_mass_between_two_wells_stays_in_one_at_a_small_drive():
    kind = kind_of_orbit(duffing(0.25, -1.0, 1.0, 0.2, start=(1.0, 0.0)))
    assert kind.kind == "period-1"
    assert kind.exponent == pytest.approx(-0.125 * TURN, abs=1e-6)  # a pair: half of the losses each
    assert kind.orbit.displacement.min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.3, 0.4])
def test_the_mass_between_two_wells_is_chaotic_at_a_larger_drive(amplitude):
    kind = kind_of_orbit(duffing(0.25, -1.0, 1.0, amplitude, start=(1.0, 0.0)))
    value, error = duffing_exponent(0.25, -1.0, 1.0, amplitude, (1.0, 0.0), dropped=100)
    assert kind.kind == CHAOTIC  # Guckenheimer and Holmes, section 2.2
    assert kind.exponent == pytest.approx(value, abs=4.0 * math.hypot(error, kind.error))
    assert kind.orbit.displacement.min() < -0.5 < 0.5 < kind.orbit.displacement.max()


def test_van_der_pol_s_oscillator_locks_near_its_resonance():
    mu, amplitude, w = 0.2, 0.5, 1.02
    kind = kind_of_orbit(driven(VAN_DER_POL, w, amplitude, (1.0, 0.0), damping=0.0, stiffness=1.0, mu=mu))
    assert kind.kind == "period-1"

    def rate(t, y):
        return y[1], mu * (1.0 - y[0] ** 2) * y[1] - y[0] + amplitude * math.cos(w * t)

    end = solve_ivp(rate, (0.0, 60 * TURN / w), [1.0, 0.0], "DOP853", rtol=1e-11, atol=1e-11).y[:, -1]
    np.testing.assert_allclose(kind.state, end, atol=1e-7)


@pytest.mark.slow
def test_van_der_pol_s_oscillator_drifts_off_its_resonance():
    kind = kind_of_orbit(driven(VAN_DER_POL, 1.5, 0.2, (1.0, 0.0), damping=0.0, stiffness=1.0, mu=0.2))
    assert kind.kind == QUASI_PERIODIC
    assert abs(kind.exponent) < 4.0 * kind.error < 3e-3


def test_an_undamped_spring_drifts_where_its_frequency_is_no_fraction_of_the_drive_s():
    values = {"mass": 1.0, "stiffness": (0.5 * (math.sqrt(5.0) - 1.0)) ** 2, "damping": 0.0, "initial_velocity": 1.0}
    map = Model(Oscillator()).period_map(values, Excitation("mass", "force", frequency=1.0 / TURN, amplitude=0.3))
    kind = kind_of_orbit(map)
    assert kind.kind == QUASI_PERIODIC
    assert abs(kind.exponent) < 1e-3
    rational = Model(Oscillator()).period_map(
        {**values, "stiffness": (3.0 / 5.0) ** 2}, Excitation("mass", "force", frequency=1.0 / TURN, amplitude=0.3)
    )
    assert kind_of_orbit(rational).kind == "period-5"


# --- fold against hysteresis


def edge(grid, hit):
    """Middle between the last value of a grid at which there are impacts, up from the lowest, and the next."""
    last = int(np.flatnonzero(hit)[-1])
    assert hit[: last + 1].all()
    return 0.5 * (grid[last] + grid[last + 1])


@pytest.mark.parametrize("w", [1.0, 1.1, 1.17])
def test_the_impacting_motion_has_the_closing_speed_of_the_closed_form(w):
    known = Impacting()
    kind = kind_of_orbit(known.map(w), known.map(1.0).orbit(np.zeros(2), 100).states[-1])
    assert kind.label == "1/1"
    assert kind.orbit.impacts[-1, 2] == pytest.approx(known.impact(w), rel=1e-9)


@pytest.mark.slow
def test_the_branch_of_impacts_grazes_folds_and_grazes_at_the_frequencies_of_the_closed_form():
    known = Impacting()
    guess = known.map(1.0).orbit(np.zeros(2), 100).states[-1]
    branch = follow(known.map, guess, 1.0, (0.3, 2.0))
    [fold], grazing = found(branch, "fold"), found(branch, "grazing")
    assert fold.parameter == pytest.approx(known.fold, abs=1e-8)
    assert [point.parameter for point in grazing] == pytest.approx(known.grazing, abs=1e-6)
    assert not branch.stable[fold.index + 1 :].any()
    assert (branch.impacts == 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(("w", "window", "side"), [(0.35, (0.3, 0.95), 0), (2.0, (1.05, 2.2), 1)])
def test_the_free_motion_grazes_where_its_linear_amplitude_is_the_gap(w, window, side):
    known = Impacting()
    branch = follow(known.map, known.map(w).orbit(np.zeros(2), 200).states[-1], w, window)
    [grazing] = branch.points
    assert grazing.kind == "grazing"
    assert grazing.parameter == pytest.approx(known.grazing[side], abs=1e-6)
    assert (branch.impacts == 0).all()


def test_the_sweep_s_jumps_are_at_the_fold_forward_and_at_the_grazing_backward(tmp_path):
    known = Impacting()
    setting = Setting(
        Model(Oscillator(stop=True)), Excitation("mass", "force", frequency=1.0, amplitude=known.F), known.names, 0.5
    )
    grid = np.concatenate([[1.0, 1.05], np.arange(1.09, 1.2, 8e-4)]) / TURN
    swept = run(Sweep(setting, {"excitation.frequency": grid}, carry="both"), tmp_path / "sweep.nc")
    hit = swept.impacts == 1
    assert set(swept.kind.values[hit.values]) == {"period-1"}
    assert set(swept.kind.values[~hit.values]) == {NO_CONTACT}
    edges = {way: edge(grid * TURN, hit.sel(branch=way).values) for way in ("forward", "backward")}
    assert edges == pytest.approx({"forward": known.fold, "backward": known.grazing[1]}, rel=1e-3)


@pytest.mark.slow
def test_the_sweep_s_jumps_are_at_the_two_folds_of_a_hardening_spring(tmp_path):
    values = {"mass": 1.0, "stiffness": 1.0, "damping": 0.1, "k3": 0.3}
    setting = Setting(Model(Oscillator(), [CUBIC]), Excitation("mass", "force", frequency=1.0, amplitude=0.2), values)
    name = "excitation.frequency"
    map = setting.map({name: 1.0 / TURN})
    branch = follow(
        lambda w: setting.map({name: w / TURN}), map.orbit(map.initial, 60).states[-1], 1.0, (0.9, 1.35), most=1000
    )
    upper, lower = found(branch, "fold")
    fine, coarse = 1e-3 * np.arange(-4.5, 5.0), [1.0, 1.1, 1.2, 1.23, 1.3]
    grid = np.sort(np.concatenate([coarse, lower.parameter * (1.0 + fine), upper.parameter * (1.0 + fine)]))
    swept = run(Sweep(setting, {name: grid / TURN}, carry="both", settle=300), tmp_path / "sweep.nc", jobs=2)
    section = swept[["displacement", "velocity"]].to_dataarray().isel(body=0, cycle=-1)
    for way, fold in (("forward", upper), ("backward", lower)):
        near = np.flatnonzero(np.abs(grid / fold.parameter - 1.0) < 5e-3)
        jumps = np.linalg.norm(np.diff(section.sel(branch=way).values[:, near], axis=1), axis=0)
        last = near[np.argmax(jumps)]
        assert jumps.max() > 5.0 * np.sort(jumps)[-2]
        assert 0.5 * (grid[last] + grid[last + 1]) == pytest.approx(fold.parameter, rel=1e-3)
    apart = np.linalg.norm(section.sel(branch="forward").values - section.sel(branch="backward").values, axis=0)
    both = (grid > lower.parameter * 1.001) & (grid < upper.parameter * 0.999)
    assert (apart[both] > 0.1).all()
    assert (apart[(grid < lower.parameter * 0.999) | (grid > upper.parameter * 1.001)] < 1e-3).all()


# --- shooting on impacts


SHAKER = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)


@pytest.mark.parametrize("seed", range(5))
def test_newton_converges_with_order_two_on_a_motion_with_impacts(seed):
    map = Model(FourDof()).period_map({"restitution": 0.2}, SHAKER)
    kind = kind_of_orbit(map)
    assert kind.label == "3/2"
    guess = kind.state + 0.01 * map.scale * np.random.default_rng(seed).normal(size=8)
    cycle = shoot(map, guess, 2)
    steps = np.array(cycle.steps)
    assert steps.size >= 4
    assert (steps[1:] <= 10.0 * steps[:-1] ** 2 + 1e-13).all()  # but for rounding
    np.testing.assert_allclose(cycle.state / map.scale, kind.state / map.scale, atol=1e-9)


def test_the_multipliers_of_a_motion_with_impacts_have_the_product_of_the_closed_form():
    map = Model(FourDof()).period_map({"restitution": 0.2}, SHAKER)
    cycle = shoot(map, kind_of_orbit(map).state, 2)
    assert cycle.impacts == 3
    losses = np.exp(-2.0 * map.problem.regimes.rate[0].sum() * 2 * map.period)  # PHYSICS, section 2
    assert np.prod(cycle.multipliers).real == pytest.approx(0.2 ** (2 * 3) * losses, rel=1e-8)


def test_newton_finds_the_motion_that_a_flip_has_left_unstable():
    ball = Ball(1.6, 0.5)
    map = ball.map()
    cycle = shoot(map, ball.state + 1e-3 * map.scale)
    np.testing.assert_allclose(cycle.state / map.scale, ball.state / map.scale, atol=1e-9)
    assert cycle.multipliers[0].real < -1.0
    assert not cycle.stable
    assert kind_of_orbit(map, cycle.state + 1e-6 * map.scale).kind == "period-2"
