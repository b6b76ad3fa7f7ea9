"""Claims about calibrations on stepped sines; many of them: `bench_response_recovery.py`."""

import numpy as np
import pytest
import xarray as xr
from response_recovery import WINDOWS, recovered, stretch_at


def test_a_frequency_just_beyond_a_fold_is_read_on_the_stretch_that_the_sweep_jumps_to():
    frequency, piece = [3.0, 3.2, 3.4, 3.403, 3.6], [0.0, 0.0, 0.0, 1.0, 1.0]
    motion = xr.Dataset({"frequency": ("point", frequency), "piece": ("point", piece)})
    assert stretch_at(motion, 3.4).tolist() == [0, 1, 2]
    assert stretch_at(motion, 3.401).tolist() == [3, 4]
    with pytest.raises(ValueError, match="no stretch"):
        stretch_at(motion.where(np.array(frequency) != 3.403, 3.45), 3.42)


@pytest.mark.slow
def test_values_behind_a_stepped_sine_are_found_within_their_intervals(tmp_path):
    truth, confidence = recovered(1, (1.0,), tmp_path)
    for name in WINDOWS:
        low, high = confidence.interval[name]
        middle, error = 0.5 * (low + high), 0.25 * (high - low)
        assert abs(truth[name] - middle) < 3.0 * error
        assert error < 0.05 * truth[name]
