"""Claims about calibrations on stepped sines; many of them: `bench_response_recovery.py`."""

import pytest
from response_recovery import WINDOWS, held, recovered, stepped


@pytest.mark.slow
@pytest.mark.parametrize("record_of", [stepped, held])
def test_values_behind_a_stepped_sine_are_found_within_their_intervals(record_of, tmp_path):
    truth, confidence = recovered(1, record_of, tmp_path)
    for name in WINDOWS:
        low, high = confidence.interval[name]
        middle, error = 0.5 * (low + high), 0.25 * (high - low)
        assert abs(truth[name] - middle) < 3.0 * error
        assert error < 0.05 * truth[name]
