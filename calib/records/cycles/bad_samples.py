"""Bad samples of a motion that returns: spikes and drop-outs, which leave no trace in the cycles behind them."""

from typing import NamedTuple

import numpy as np

BAD_SAMPLE_STD = 8.0  # distance from the median of the cycles that are compared  [standard deviations of the noise]
MAX_BAD_STRETCH = 0.15  # of a cycle: a body that left its orbit takes longer to return  [1]
MAX_SHARE_OF_BAD_CYCLES = 0.05  # of the cycles: of more, the motion is another; one may always be  [1]
MIN_CYCLES_OF_MEDIAN = 4  # of which a median is not moved by a bad one
MAX_MEDIAN_PERIODS = 4  # after which the motion is tried to return: a longer one has too few cycles for a median


class MendedCycles(NamedTuple):
    """Cycles (row, cycle, phase) whose bad samples are those of the median cycle, how many, in how many stretches."""

    cycles: np.ndarray
    samples: int
    stretches: int


def without_bad_samples(cycles: np.ndarray, noise: np.ndarray) -> MendedCycles | None:
    """Replace the bad samples of cycles (row, cycle, phase) with noise (row,), None where there are none such.

    A sample is bad where it is 8 standard deviations of the noise from the median of the cycles that are n periods
    apart. Such samples are left out where they are in a few cycles alone, and in stretches much shorter than a cycle,
    with the motion on its orbit for a cycle before and behind. A structure that leaves its orbit, as in intermittent
    motion, cannot be back at once: its stretch is longer than that.

    Source: Hampel's identifier; Pearson, IEEE Transactions on Control Systems Technology 10 (2002) 55.
    """
    for lag in range(1, min(MAX_MEDIAN_PERIODS, cycles.shape[1] // MIN_CYCLES_OF_MEDIAN) + 1):
        median = np.empty_like(cycles)
        for start in range(lag):
            median[:, start::lag] = np.median(cycles[:, start::lag], axis=1, keepdims=True)
        bad = np.abs(cycles - median) > BAD_SAMPLE_STD * noise[:, None, None]
        spoilt = int(bad.any(axis=(0, 2)).sum())
        if not 0 < spoilt <= max(1, int(MAX_SHARE_OF_BAD_CYCLES * cycles.shape[1])):
            continue
        spans = _spans(bad.any(axis=0).ravel(), cycles.shape[2])
        if spans.max() <= max(1, int(MAX_BAD_STRETCH * cycles.shape[2])):
            return MendedCycles(np.where(bad, median, cycles), int(bad.sum()), spans.size)
    return None


def _spans(bad: np.ndarray, apart: int) -> np.ndarray:
    """Samples from the first to the last bad one (n,) of each stretch, those nearer than so many samples joined."""
    at = np.flatnonzero(bad)
    breaks = np.flatnonzero(np.diff(at) > apart)
    return at[np.append(breaks, at.size - 1)] - at[np.concatenate([[0], breaks + 1])] + 1
