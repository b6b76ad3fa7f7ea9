"""Exponents against those that are known in closed form or to many digits."""

import math

import numpy as np
import pytest
from dynamics.plain_maps import PlainMap, delayed_logistic, henon, logistic
from dynamics.quasi_periodic_maps import PULL, circle, spiral, torus

from calib.dynamics.exponents import extended, largest_exponent, spectrum, standard_error


def settled(map, periods=500):
    return map.orbit(map.initial, periods).states[-1]


def test_the_logistic_map_at_four_has_exponent_ln_2():
    found = largest_exponent(logistic(4.0), settled(logistic(4.0)), 4000)
    assert abs(found.value - math.log(2.0)) < 4.0 * found.error
    assert found.error < 0.01


def test_a_fixed_point_has_the_logarithm_of_its_multiplier():
    found = largest_exponent(logistic(2.9), settled(logistic(2.9)), 400)
    assert found.value == pytest.approx(math.log(0.9), abs=1e-12)
    assert found.error < 1e-12


def test_the_exponent_of_henon_is_the_published_one():
    found = largest_exponent(henon(1.4), settled(henon(1.4)), 10_000)
    assert found.value == pytest.approx(0.4192, abs=4.0 * found.error)  # Sprott (2003), appendix A
    assert found.error < 0.006


def test_the_exponents_of_henon_add_up_to_the_logarithm_of_its_determinant():
    exponents = spectrum(henon(1.4), settled(henon(1.4)), 1000)
    assert exponents[0] > 0.0 > exponents[1]
    assert exponents.sum() == pytest.approx(math.log(0.3), abs=1e-10)


def test_a_circle_has_exponent_zero_and_the_pull_towards_it():
    np.testing.assert_allclose(spectrum(circle(), settled(circle()), 400), [0.0, math.log(1.0 - 2.0 * PULL)], atol=1e-9)


def test_a_torus_has_two_exponents_zero():
    pull = math.log(1.0 - 2.0 * PULL)
    np.testing.assert_allclose(spectrum(torus(), settled(torus()), 400), [0.0, 0.0, pull, pull], atol=1e-9)


def test_a_spiral_has_the_exponent_of_its_shrinking():
    found = largest_exponent(spiral(0.99), spiral(0.99).initial, 400)
    assert found.value == pytest.approx(math.log(0.99), abs=1e-12)


@pytest.mark.parametrize("map", [henon(1.4), delayed_logistic(2.1)])
def test_a_map_that_does_not_know_its_derivative_has_the_same_exponents(map):
    blind = PlainMap(map.function, None, map.initial)
    state = settled(map)
    np.testing.assert_allclose(spectrum(blind, state, 60), spectrum(map, state, 60), atol=1e-4)
    assert largest_exponent(blind, state, 60).value == pytest.approx(largest_exponent(map, state, 60).value, abs=1e-4)


def test_a_difference_that_is_wiped_out_has_exponent_minus_infinity():
    wiped = PlainMap(lambda x: np.array([0.3, 0.5 * x[1]]), lambda x: np.diag([0.0, 0.5]), [0.1, 0.1])
    np.testing.assert_allclose(spectrum(wiped, wiped.initial, 50), [math.log(0.5), -math.inf])
    flat = PlainMap(lambda x: np.array([0.3]), lambda x: np.zeros((1, 1)), [0.1])
    found = largest_exponent(flat, flat.initial, 50)
    assert (found.value, found.error) == (-math.inf, 0.0)


def test_going_on_equals_going_at_once():
    map, state = henon(1.4), settled(henon(1.4))
    at_once, later = largest_exponent(map, state, 300), extended(map, largest_exponent(map, state, 100), 200)
    assert later.value == pytest.approx(at_once.value, abs=1e-9)
    assert len(later.logarithms) == len(at_once.logarithms) == 300
    assert len(later.states) == len(at_once.states) == 350


def test_the_states_are_the_orbit():
    map, state = logistic(3.9), settled(logistic(3.9))
    np.testing.assert_array_equal(largest_exponent(map, state, 100).states, map.orbit(state, 150).states)


def test_an_orbit_that_fails_is_not_complete():
    leaving = PlainMap(lambda x: 1.1 * x, None, [1.0])  # past its limit after 73 periods
    found = largest_exponent(leaving, leaving.initial, 400)
    assert not found.complete
    assert found.value == pytest.approx(math.log(1.1), abs=1e-6)
    at_once = largest_exponent(leaving, np.array([900.0]), 400)
    assert not at_once.complete
    assert math.isnan(at_once.value)
    assert np.isnan(spectrum(leaving, leaving.initial, 400)).all()


def test_the_standard_error_covers_the_scatter_of_a_correlated_series():
    rng = np.random.default_rng(7)
    means, errors = [], []
    for _ in range(200):
        noise, series = rng.standard_normal(1000), np.zeros(1000)
        for k in range(1, 1000):
            series[k] = 0.8 * series[k - 1] + noise[k]
        means.append(series.mean())
        errors.append(standard_error(series))
    assert 0.8 < np.mean(errors) / np.std(means) < 1.4
    assert np.isnan(standard_error(np.ones(39)))
