"""The white noise of samples, by their differences."""

import numpy as np
from scipy.special import comb

from calib.records.clipping import level_step

MAD_PER_STD = 0.6745  # median of the absolute value over the standard deviation, of normal noise
DIFFERENCE_ORDER = 6  # of the differences: a motion of 20 samples a period leaves 3e-5 of its amplitude in them
MIN_WHITENESS = 0.5  # of the noise by differences over that by differences of two orders less: 1 of white noise  [1]


def white_noise_std(values: np.ndarray, order: int = DIFFERENCE_ORDER) -> np.ndarray:
    """Standard deviation (...) of the white noise of rows (..., n), by the median of their differences of some order.

    In the unit of the samples; 0 of rows that are too short. A difference of order k has the variance of a sample times
    the binomial coefficient of 2 k over k.
    """
    if values.shape[-1] <= order:
        return np.zeros(values.shape[:-1])
    differences = np.abs(np.diff(values, order, axis=-1))
    return np.asarray(np.median(differences, axis=-1) / (MAD_PER_STD * np.sqrt(comb(2 * order, order))))


def shows_noise(values: np.ndarray) -> bool:
    """Whether samples (n,) have white noise, and beyond the step between their levels: none of many are equal."""
    noise = white_noise_std(values)
    return bool(noise > max(level_step(values), MIN_WHITENESS * white_noise_std(values, DIFFERENCE_ORDER - 2)))
