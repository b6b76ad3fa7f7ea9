"""The zero-phase low-pass."""

import numpy as np
import pytest

from calib.errors import CalibError
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


def test_instants_of_too_few_digits_are_answered_with_the_rate():
    """51.2 kHz in steps of 1 us, as an analyser prints them: no sample is missing, and none need be interpolated."""
    time = np.round(np.arange(4000) / 51200.0, 6)
    with pytest.raises(
        CalibError, match=r"state the sampling rate .* rate = \"2 kHz\" \(here about 51200 Hz\); else res"
    ):
        low_pass(np.sin(600.0 * time), time, 1000.0)


def test_a_missing_sample_is_not_put_down_to_rounding():
    time = np.delete(np.arange(4000) / 1000.0, 77)
    with pytest.raises(CalibError, match="from 0.001 s to 0.002 s; resample them or drop the cutoff"):
        low_pass(np.sin(6.0 * time), time, 100.0)
