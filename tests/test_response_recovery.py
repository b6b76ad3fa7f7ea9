"""Claims about calibrations on stepped sines; many of them: `bench_response_recovery.py`."""

import pytest
from response_recovery import WINDOWS, recovered


@pytest.mark.slow
def test_values_behind_a_stepped_sine_are_found_within_their_intervals(tmp_path):
    truth, confidence = recovered(1, (1.0,), tmp_path)
    for name in WINDOWS:
        low, high = confidence.interval[name]
        middle, error = 0.5 * (low + high), 0.25 * (high - low)
        assert abs(truth[name] - middle) < 3.0 * error
        assert error < 0.05 * truth[name]
