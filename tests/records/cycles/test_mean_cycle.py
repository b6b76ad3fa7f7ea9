"""The mean cycle of records whose clock knows nothing of the drive."""

import numpy as np
import pytest
from scipy.signal import lfilter

from calib.records.cycles import harmonics, mean_cycle

FREQUENCY = 26.24  # Hz
PERIOD = 1.0 / FREQUENCY
SIGMA = 0.01
RATES = [8000.0, 8192.0, 10_000.0, 26.24 * 23.7, 26.24 * 20.003, 26.24 * 397.1]  # Hz, beside a drive of 26.24 Hz


def motion(time):
    """A displacement of three harmonics and amplitude about 1."""
    angle = 2.0 * np.pi * FREQUENCY * time
    return np.sin(angle) + 0.2 * np.cos(3.0 * angle + 1.0) + 0.02 * np.cos(7.0 * angle)


def instants(rate, cycles):
    return np.arange(int(cycles * rate * PERIOD)) / rate


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("phi", [0.0, 0.7])
def test_what_is_left_about_the_mean_cycle_is_the_noise(rate, phi):
    time, rng = instants(rate, 40.0), np.random.default_rng(1)
    noise = SIGMA * np.sqrt(1.0 - phi**2) * lfilter([1.0], [1.0, -phi], rng.standard_normal(time.size))
    mean = mean_cycle(time, (motion(time) + noise)[None], PERIOD)
    left = mean.residual[0] / np.sqrt(1.0 - mean.parameters / time.size)
    error = np.sqrt((1.0 + phi**2) / (1.0 - phi**2) / (2.0 * time.size))  # of a standard deviation, relative
    assert left.std() == pytest.approx(noise.std(), rel=5.0 * error)
    assert np.corrcoef(left[1:], left[:-1])[0, 1] == pytest.approx(phi, abs=5.0 / np.sqrt(time.size))


@pytest.mark.parametrize("rate", RATES)
def test_the_mean_cycle_is_the_motion_itself(rate):
    mean = mean_cycle(instants(rate, 10.3), motion(instants(rate, 10.3))[None], PERIOD)
    np.testing.assert_allclose(mean.loop[0], motion(mean.phase * PERIOD), atol=3e-3)
    amplitude = np.abs(harmonics(mean.loop, 3))[0]
    np.testing.assert_allclose(amplitude, [1.0, 0.0, 0.2], atol=1e-3)


@pytest.mark.parametrize("rate", [FREQUENCY * 50.0, FREQUENCY * 51.3])
def test_noise_of_the_mean_cycle_falls_with_the_number_of_cycles(rate):
    time, rng = instants(rate, 64.0), np.random.default_rng(2)
    mean = mean_cycle(time, (motion(time) + SIGMA * rng.standard_normal(time.size))[None], PERIOD)
    error = mean.loop[0] - motion(mean.phase * PERIOD)
    assert error.std() == pytest.approx(SIGMA / 8.0, rel=0.3)
    assert mean.deviation.mean() == pytest.approx(SIGMA, rel=0.05)


@pytest.mark.parametrize("rate", [FREQUENCY * 50.0, FREQUENCY * 51.3])
def test_samples_without_weight_do_not_count(rate):
    time = instants(rate, 20.0)
    values, weight = motion(time), np.ones(time.size)
    values[::7], weight[::7] = 100.0, 0.0
    mean = mean_cycle(time, values[None], PERIOD, weight=weight[None])
    np.testing.assert_allclose(mean.loop[0], motion(mean.phase * PERIOD), atol=3e-3)


def test_true_instants_of_a_jittering_clock_are_taken_as_they_are():
    rng = np.random.default_rng(3)
    time = instants(FREQUENCY * 60.0, 20.0)
    time = time + 0.2 / (FREQUENCY * 60.0) * rng.uniform(-1.0, 1.0, time.size)
    mean = mean_cycle(time, motion(time)[None], PERIOD)
    assert np.abs(mean.residual).max() < 2e-3


def test_a_cycle_of_two_periods_keeps_both_halves():
    time = instants(FREQUENCY * 37.7, 21.0)
    values = motion(time) + 0.1 * np.sin(np.pi * FREQUENCY * time)
    mean = mean_cycle(time, values[None], PERIOD, 2)
    at = mean.phase * PERIOD
    np.testing.assert_allclose(mean.loop[0], motion(at) + 0.1 * np.sin(np.pi * FREQUENCY * at), atol=3e-3)
