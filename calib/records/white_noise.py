"""The white noise of samples, by their differences."""

import numpy as np
from scipy.special import comb

from calib.records.clipping import level_step
from calib.records.cycles.impacts import MAD_PER_STD

DIFFERENCE_ORDER = 6  # of the differences: a motion of 20 samples a period leaves 3e-5 of its amplitude in them
MIN_WHITENESS = 0.5  # of the noise by differences over that by differences of two orders less: 1 of white noise  [1]


def white_noise_std(values: np.ndarray, order: int = DIFFERENCE_ORDER) -> float:
    """Standard deviation of the white noise of samples (n,), by the median of their differences of some order  [unit].

    A difference of order k has the variance of a sample times the binomial coefficient of 2 k over k.
    """
    if values.size <= order:
        return 0.0
    return float(np.median(np.abs(np.diff(values, order)))) / (MAD_PER_STD * np.sqrt(comb(2 * order, order)))


def shows_noise(values: np.ndarray) -> bool:
    """Whether samples (n,) have white noise, and beyond the step between their levels: none of many are equal."""
    noise = white_noise_std(values)
    return noise > max(level_step(values), MIN_WHITENESS * white_noise_std(values, DIFFERENCE_ORDER - 2))
