"""Instants of uniform samples that were printed with too few digits."""

import numpy as np

from calib.units import plain_number

ROUNDING_TOLERANCE = 1e-6  # of the resolution of rounded instants: what doubles add to it  [1]


def rounding_hint(time: np.ndarray) -> str:
    """Advice where uniform sampling and too few digits explain the steps of the instants (n,) [s]; "" elsewhere.

    Instants rounded to the resolution q lie within q of the uniform grid through the first and the last one. Where
    several fall on one, the next step is q, and none is larger; elsewhere two steps differ by q at most, and one
    twice as long as another may be a missing sample.
    """
    steps = np.diff(time)
    if steps.size == 0 or (steps < 0.0).any() or time[-1] <= time[0]:
        return ""
    zero = np.flatnonzero(steps == 0.0)
    if zero.size:
        resolution = steps[np.clip(np.concatenate([zero - 1, zero + 1]), 0, steps.size - 1)].max()
        largest = (1.0 + ROUNDING_TOLERANCE) * resolution
    else:
        resolution = steps.max() - steps.min()
        largest = (2.0 - ROUNDING_TOLERANCE) * steps.min()
    interval = (time[-1] - time[0]) / steps.size
    deviation = np.abs(time - time[0] - interval * np.arange(time.size)).max()
    if steps.max() > largest or deviation > (1.0 + ROUNDING_TOLERANCE) * resolution:
        return ""
    return (
        "where the instants are rounded to too few digits, state the sampling rate in the place of `time`, as in "
        f'rate = "2 kHz" (here about {plain_number(1.0 / interval)} Hz)'
    )
