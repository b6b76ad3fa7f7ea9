"""Periodic orbits by shooting."""

import math

import numpy as np
import pytest
from dynamics.plain_maps import GrazingMap, PlainMap, delayed_logistic, henon, logistic

from calib.dynamics.orbits import reduced, shoot
from calib.errors import CalibError


def henon_fixed(a, b=0.3):
    x = ((b - 1.0) + math.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)
    return np.array([x, b * x])


def by_differences(map):
    map.derivative = None
    return map


# --- Newton's steps


@pytest.mark.parametrize("a", [0.2, 1.4])
def test_newton_converges_with_order_two(a):
    steps = np.array(shoot(henon(a), henon_fixed(a) + [0.3, 0.1]).steps)
    above = np.log(steps[(steps > 1e-13) & (steps < 1e-1)])
    orders = np.diff(above)[1:] / np.diff(above)[:-1]
    assert above.size >= 3
    assert orders.min() > 1.8
    assert (steps[1:] <= 2.0 * steps[:-1] ** 2 + 1e-15).all()


@pytest.mark.parametrize("map", [henon, lambda a: by_differences(henon(a))])
def test_the_cycle_is_the_fixed_point_in_closed_form(map):
    cycle = shoot(map(0.2), [0.7, 0.2])
    assert cycle.converged
    assert cycle.residual < 1e-11
    assert np.abs(cycle.state - henon_fixed(0.2)).max() < 1e-11


def test_a_step_that_does_not_lower_the_residual_is_halved():
    steep = PlainMap(lambda x: x - np.arctan(5.0 * x), lambda x: np.diag(1.0 - 5.0 / (1.0 + 25.0 * x**2)), [0.0])
    cycle = shoot(steep, [1.0])  # undamped steps on arctan leave from beyond 1.39 / 5
    assert cycle.converged
    assert abs(cycle.state[0]) < 1e-11
    assert (np.diff(cycle.steps) < 0.0).all()


def test_a_guess_without_a_cycle_is_a_status():
    cycle = shoot(henon(-0.5), [0.0, 0.0])  # below the fold there is none
    assert not cycle.converged
    assert "residual" in cycle.reason
    assert np.isnan(cycle.multipliers).all()
    assert np.isnan(cycle.exponent)
    assert not cycle.stable


def test_a_guess_from_which_the_motion_fails_is_a_status():
    cycle = shoot(logistic(3.2), [-50.0], periods=3)
    assert not cycle.converged
    assert "fails" in cycle.reason


@pytest.mark.parametrize(
    ("guess", "periods", "words"), [([0.1], 1, "2 finite numbers"), ([0.1, np.nan], 1, "finite"), ([0, 0], 0, "period")]
)
def test_a_guess_that_is_no_state_is_the_callers_mistake(guess, periods, words):
    with pytest.raises(CalibError, match=words):
        shoot(henon(0.2), guess, periods)


# --- multipliers


@pytest.mark.parametrize("a", [1.5, 2.8, 3.3, 3.9])
def test_the_multiplier_of_the_logistic_fixed_point_is_2_less_a(a):
    cycle = shoot(logistic(a), [0.5])
    assert cycle.multipliers == pytest.approx([2.0 - a], abs=1e-9)
    assert cycle.stable == (a < 3.0)
    assert cycle.exponent == pytest.approx(math.log(abs(2.0 - a)), abs=1e-8)


def test_the_multipliers_of_two_periods_are_those_of_the_two_cycle():
    a = 3.3
    cycle = shoot(logistic(a), [0.8236], periods=2)
    expected = 4.0 + 2.0 * a - a**2
    assert cycle.multipliers == pytest.approx([expected], abs=1e-9)
    assert cycle.exponent == pytest.approx(0.5 * math.log(abs(expected)), abs=1e-8)


def test_the_multipliers_of_henon_solve_the_characteristic_equation():
    a, b = 1.4, 0.3
    x = henon_fixed(a)[0]
    expected = np.array([-a * x - math.sqrt(a**2 * x**2 + b), -a * x + math.sqrt(a**2 * x**2 + b)])
    cycle = shoot(henon(a), henon_fixed(a))
    assert cycle.multipliers == pytest.approx(expected, abs=1e-10)
    assert np.abs(shoot(by_differences(henon(a)), henon_fixed(a)).multipliers - expected).max() < 1e-8


def test_a_complex_pair_stands_side_by_side():
    pair = shoot(delayed_logistic(1.8), [0.4, 0.4]).multipliers
    assert pair[0] == pair[1].conj()
    assert abs(pair[0].imag) > 0.1
    assert abs(pair[0]) ** 2 == pytest.approx(0.8, abs=1e-10)  # a x = a - 1


# --- the least period


def test_a_fixed_point_sought_with_six_periods_has_period_1():
    map = logistic(2.8)
    cycle = shoot(map, [0.64], periods=6)
    assert cycle.periods == 6
    assert reduced(map, cycle).periods == 1
    assert reduced(map, cycle).multipliers == pytest.approx([-0.8], abs=1e-9)


def test_a_two_cycle_sought_with_four_periods_has_period_2():
    map = logistic(3.3)
    assert reduced(map, shoot(map, [0.8236], periods=4)).periods == 2


@pytest.mark.parametrize(("a", "periods", "guess"), [(3.5, 4, 0.875), (3.84, 3, 0.15)])
def test_a_cycle_with_its_least_period_stays(a, periods, guess):
    map = logistic(a)
    cycle = shoot(map, [guess], periods)
    assert reduced(map, cycle) is cycle
    assert np.ptp(cycle.orbit.states) > 0.1


def test_a_two_cycle_just_born_is_not_taken_for_the_fixed_point():
    a = 3.0 + 1e-6  # its two points lie 6e-4 apart
    two = (a + 1.0 + math.sqrt((a + 1.0) * (a - 3.0))) / (2.0 * a)
    map = logistic(a)
    assert reduced(map, shoot(map, [two], periods=2)).periods == 2


# --- grazing


def grazing_cycle(gap, kick=0.1):
    return shoot(GrazingMap(gap, kick), [1.0, -0.2])


def test_the_miss_of_a_cycle_is_its_clearance():
    cycle = grazing_cycle(1.25)
    assert cycle.nearest == pytest.approx(0.25, abs=1e-10)
    assert cycle.slowest == math.inf
    assert cycle.impacts == 0


def test_the_impacts_of_a_cycle_are_counted_per_return():
    cycle = shoot(GrazingMap(0.7), [0.9, -0.2], periods=2)
    speed = (-0.1 + math.sqrt(0.01 + 4 * 0.9 * 0.9 * 0.3)) / 1.8
    assert cycle.impacts == 2
    assert cycle.slowest == pytest.approx(speed, abs=1e-10)
    assert cycle.nearest == math.inf


@pytest.mark.parametrize(("gap", "near"), [(1.01, False), (1.0005, True), (0.99995, True), (0.99, False)])
def test_a_cycle_near_grazing_is_not_classified(gap, near):
    assert grazing_cycle(gap).grazing == near


def test_chatter_that_ends_in_contact_is_not_grazing():
    map = GrazingMap(0.99995)
    assert shoot(map, [1.0, -0.2]).grazing
    plain = map.orbit
    map.orbit = lambda state, periods: plain(state, periods)._replace(contact=0.1)
    assert not shoot(map, [1.0, -0.2]).grazing


def test_a_map_without_a_stop_never_grazes():
    cycle = shoot(henon(0.2), [0.7, 0.2])
    assert cycle.margin == math.inf
    assert not cycle.grazing
