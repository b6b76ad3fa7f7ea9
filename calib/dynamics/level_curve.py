"""The level of the excitation over its frequency, where it was measured point by point."""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

SAME_LEVEL = 1e-12  # relative difference of levels, by rounding  [1]


def level_over_frequency(frequency: np.ndarray, level: np.ndarray) -> Callable[[float], float]:
    """Amplitude of the excitation at a frequency: a smooth curve through those measured, monotone between them.

    It is a curve without corners (Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238) of the logarithm, so that
    the level stays above 0; beyond the ends it goes on with its slope there. At a frequency that was measured several
    times it is the mean of the levels there. Corners would be corners of the response, at which its continuation ends.
    """
    known, place = np.unique(frequency, return_inverse=True)
    values = np.log(np.bincount(place, weights=level) / np.bincount(place))
    if known.size == 1 or np.ptp(values) <= SAME_LEVEL:
        constant = float(level[0]) if np.ptp(level) <= SAME_LEVEL * level[0] else math.exp(values[0])
        return lambda at: constant
    curve = PchipInterpolator(known, values)
    ends = {at: (float(curve(at)), float(curve(at, 1))) for at in (float(known[0]), float(known[-1]))}

    @lru_cache(maxsize=8)  # the equations at one frequency are asked for several times, one after the other
    def at_frequency(at: float) -> float:
        inside = min(max(at, float(known[0])), float(known[-1]))
        if inside == at:
            return math.exp(float(curve(at)))
        value, slope = ends[inside]
        return math.exp(value + slope * (at - inside))

    return at_frequency
