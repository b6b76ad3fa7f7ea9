"""Gaps in time, where a record lacks samples."""

import numpy as np

MAX_REGULAR_STEP = 1.5  # of the median interval between samples, beyond which one lacks a sample  [1]
MAX_SHARE_OF_GAPS = 0.05  # of the intervals; where more exceed it, the record is sampled irregularly altogether  [1]


def gaps_in(time: np.ndarray) -> np.ndarray:
    """Instants (gap, 2) of the samples before and behind each gap  [s]; none of a record of irregular samples.

    A gap is an interval of more than 1.5 times the median one, where no more than 5 % of the intervals are.

    time : (n,) increasing  [s]
    """
    steps = np.diff(time)
    if not steps.size:
        return np.empty((0, 2))
    before = np.flatnonzero(steps > MAX_REGULAR_STEP * np.median(steps))
    if before.size > MAX_SHARE_OF_GAPS * steps.size:
        return np.empty((0, 2))
    return np.column_stack([time[before], time[before + 1]])
