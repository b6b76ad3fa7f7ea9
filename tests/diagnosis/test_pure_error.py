"""Noise from replicates of a frequency response, on noise that is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from calib.diagnosis.noise import REPLICATED, STATED
from calib.diagnosis.pure_error import pure_errors, recursive_residuals
from calib.records.response import make_response

FREQUENCY = np.linspace(3.0, 4.0, 40)  # Hz
ROWS = [("mass", "in_phase"), ("mass", "quadrature")]
LEVELS = (1.0, 2.0, 4.0)  # N


def sweeps(ways=(1.0, -1.0)):
    """Record of sweeps of these directions at each level."""
    plan = [(level, way) for level in LEVELS for way in ways]
    frequency = np.concatenate([FREQUENCY[:: int(way)] for _, way in plan])
    level, way = np.repeat(plan, FREQUENCY.size, axis=0).T
    amplitude = level / (3.5**2 - frequency**2 + 0.4j * frequency)
    number = np.repeat(np.arange(len(plan)), FREQUENCY.size)
    return make_response(frequency, ["mass"], amplitude[None], level, "N", number, way)


def errors(record, noise, stated=None):
    """Noise as it is estimated beside a misfit of the model, which is the same in all sweeps of a level."""
    frequency, level = record["frequency"].values, record["level"].values
    misfit = 3.0 * level * np.sin(9.0 * frequency)
    measured = np.array([record["in_phase"].values[0], record["quadrature"].values[0]])
    return pure_errors(record, ROWS, measured, noise + misfit, np.ones(noise.shape), stated)


def test_recursive_residuals_are_differences_from_the_mean_of_the_replicates_before():
    residual, weight = np.array([1.0, 3.0, 5.0, 7.0, 9.0]), np.array([1.0, 1.0, 1.0, 1.0, 0.0])
    found, free = recursive_residuals(residual, weight, np.array([0, 1, 0, 0, 1]))
    np.testing.assert_allclose(found, [0.0, 0.0, 4.0 * np.sqrt(1 / 2), 4.0 * np.sqrt(2 / 3), 0.0])
    np.testing.assert_array_equal(free, [0.0, 0.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize("ways", [(1.0, -1.0), (1.0, -1.0, 1.0)])
def test_white_noise_is_found_beside_a_misfit_of_a_hundred_times_its_variance(ways):
    record, levels, orders = sweeps(ways), [], []
    for seed in range(40):
        noise = 0.3 * np.random.default_rng(seed).standard_normal((2, record.sizes["point"]))
        for one in errors(record, noise).values():
            assert one.source == REPLICATED
            assert one.repeated
            levels.append(one.sigma**2)
            orders.append(one.ar.size)
    assert np.mean(levels) == pytest.approx(0.09, rel=0.03)  # 80 estimates of 120 degrees of freedom or more: 1.4 %
    assert np.mean(np.array(orders) > 0) < 0.1


def test_memory_of_the_noise_is_not_that_of_the_misfit():
    record, found = sweeps(), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = lfilter([np.sqrt(1.0 - 0.36)], [1.0, -0.6], rng.standard_normal((2, record.sizes["point"])), axis=1)
        found += [one.autocorrelation(3)[1:] for one in errors(record, noise).values()]
    np.testing.assert_allclose(np.mean(found, axis=0), [0.6, 0.36], atol=0.06)


def test_a_stated_level_stands():
    noise = np.random.default_rng(1).standard_normal((2, sweeps().sizes["point"]))
    for one in errors(sweeps(), noise, stated=1.0).values():
        assert one.source == STATED
        assert one.sigma == pytest.approx(1.0, abs=0.15)


def test_one_sweep_of_each_level_shows_no_noise():
    record = sweeps((1.0,))
    assert errors(record, np.zeros((2, record.sizes["point"]))) == {}
