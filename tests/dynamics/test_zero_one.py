"""The 0-1 test on series whose nature is known."""

import numpy as np
import pytest
from dynamics.plain_maps import delayed_logistic, henon, logistic
from dynamics.quasi_periodic_maps import GOLDEN, circle, torus

from calib.dynamics.zero_one import _mean_square_displacement, zero_one
from calib.errors import CalibError


def series(map, count=1000):
    return map.orbit(map.orbit(map.initial, 1000).states[-1], count).states[:, 0]


@pytest.mark.parametrize("map", [logistic(4.0), logistic(3.9), logistic(3.7), henon(1.4), delayed_logistic(2.27)])
def test_a_chaotic_series_has_k_near_one(map):
    assert zero_one(series(map)) > 0.95


@pytest.mark.parametrize("a", [2.5, 3.2, 3.5, 3.55, 3.83, 3.74])
def test_a_periodic_series_has_k_near_zero(a):
    assert abs(zero_one(series(logistic(a)))) < 0.05


@pytest.mark.parametrize("map", [circle(), circle(0.05 * GOLDEN), torus(), delayed_logistic(2.05)])
def test_a_quasi_periodic_series_has_k_near_zero(map):
    assert abs(zero_one(series(map))) < 0.05


def test_a_sine_has_k_near_zero():
    assert abs(zero_one(np.sin(2.0 * np.pi * GOLDEN * np.arange(1000)))) < 0.05


def test_weak_chaos_in_bands_needs_a_longer_series():
    weak = series(logistic(3.58), 8000)
    assert zero_one(weak[:1000]) < 0.6 < 0.85 < zero_one(weak)


@pytest.mark.parametrize("regular", [False, True])
def test_scale_does_not_count_and_an_offset_hardly(regular):
    values = np.sin(2.0 * np.pi * GOLDEN * np.arange(1000)) if regular else series(logistic(3.9))
    assert zero_one(1e-7 * values) == pytest.approx(zero_one(values), abs=1e-9)
    assert zero_one(values + 3.0) == pytest.approx(zero_one(values), abs=0.1)


def test_a_constant_series_has_k_zero():
    assert zero_one(np.full(1000, 0.3)) == 0.0
    assert zero_one(np.zeros(1000)) == 0.0


def test_the_displacement_is_the_mean_of_its_definition():
    values, c = series(logistic(3.9), 230), np.array([0.7, 1.9])
    p = np.cumsum(values * np.exp(1j * np.outer(c, np.arange(1, 231))), axis=1)
    direct = [(np.abs(p[:, n : n + 207] - p[:, :207]) ** 2).mean(axis=1) for n in range(1, 24)]
    np.testing.assert_allclose(_mean_square_displacement(values, c, 23), np.transpose(direct), rtol=1e-10)


@pytest.mark.parametrize("bad", [np.zeros(99), np.zeros((2, 500)), np.full(1000, np.nan)])
def test_what_is_no_series_is_refused(bad):
    with pytest.raises(CalibError, match="series of at least 100 finite numbers"):
        zero_one(bad)
