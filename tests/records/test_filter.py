"""The zero-phase low-pass."""

import numpy as np

from calib.records.filter import low_pass


def test_the_low_pass_keeps_slow_and_stops_fast_without_a_delay():
    time = np.arange(4000) / 1000.0
    slow, fast = np.cos(2 * np.pi * 5.0 * time), np.cos(2 * np.pi * 400.0 * time)
    inside = slice(500, -500)
    np.testing.assert_allclose(low_pass(slow + fast, time, 100.0)[inside], slow[inside], atol=1e-6)


def test_the_low_pass_halves_the_amplitude_at_its_cutoff():
    time = np.arange(4000) / 1000.0
    at = np.cos(2 * np.pi * 100.0 * time)
    np.testing.assert_allclose(low_pass(at, time, 100.0)[500:-500], 0.5 * at[500:-500], atol=1e-6)
