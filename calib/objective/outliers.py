"""Isolated outliers of sampled channels, such as lost echoes and drop-outs.

A sample is judged by the median of those about it and the median absolute deviation from it (the identifier of Hampel;
Davies & Gather, J. Am. Stat. Assoc. 88 (1993) 782).
"""

import numpy as np
import scipy

STD_PER_MAD = 1.4826  # of a normal distribution: standard deviation over median absolute deviation
WINDOW_SAMPLES = 7  # samples
MIN_DEVIATION = 8.0  # of an outlier from the median, in standard deviations
MIN_DEVIATION_SHARE = 0.1  # of it, over the standard deviation of the channel
MIN_NEIGHBOUR_RATIO = 2.0  # of it to those of the two samples beside it


def smoothed(rows: np.ndarray) -> np.ndarray:
    """Rows (row, n) with each sample replaced by the median of those about it."""
    return scipy.ndimage.median_filter(rows, (1, WINDOW_SAMPLES))


def deviations(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance of each sample (row, n) from the median about it, and the standard deviation (row, 1) of them."""
    distance = np.abs(rows - smoothed(rows))
    return distance, STD_PER_MAD * np.median(distance, axis=1, keepdims=True)


def isolated_outliers(rows: np.ndarray) -> np.ndarray:
    """Whether a sample (row, n) stands alone far from the median of those about it, as a dropout of a vibrometer does.

    At a turning point or a jump of the motion itself the samples beside it are far too.
    """
    distance, sigma = deviations(rows)
    far = distance > np.maximum(MIN_DEVIATION * sigma, MIN_DEVIATION_SHARE * rows.std(axis=1, keepdims=True))
    beside = np.pad(distance, ((0, 0), (1, 1)))
    return far & (distance > MIN_NEIGHBOUR_RATIO * np.maximum(beside[:, :-2], beside[:, 2:]))
