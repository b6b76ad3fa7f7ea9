"""Replicates in a frequency response: points measured again at the same frequency and level, in another sweep.

What replicates differ by is noise, whatever the model leaves of them: the pure error of a regression, beside which its
lack of fit is judged (Draper & Smith, Applied Regression Analysis, 1998, section 2.1).
"""

import numpy as np
import xarray as xr

from calib.records.response import complex_amplitude, sweeps

SAME_LEVEL_RATIO = 1.05  # of the median levels of two sweeps at the same level  [1]
MAX_STEPS = 0.1  # between the frequencies of replicates, over the median step of the coarser sweep  [1]
MAX_DEPARTURE = 0.5  # of the amplitudes of all bodies, over their rms: beyond it two points are of two branches


def replicates(record: xr.Dataset) -> np.ndarray:
    """Number (point,) of the group of replicates that each point belongs to; of a point measured once its own.

    Each point of a sweep is grouped with the nearest one of the first sweep at its level, where either is the nearest
    of the other, and where both are of the same branch: between two folds a sweep down is not a sweep up again.
    """
    group = np.arange(record.sizes["point"])
    frequency, level = record["frequency"].values, record["level"].values
    amplitude = complex_amplitude(record)
    first: list[np.ndarray] = []
    for _, points in sweeps(record):
        same = (one for one in first if _ratio(np.median(level[one]), np.median(level[points])) <= SAME_LEVEL_RATIO)
        base = next(same, None)
        if base is None:
            first.append(points)
            continue
        again, before = _matched(frequency[points], frequency[base])
        again, before = points[again], base[before]
        both = np.concatenate([points, base])
        rms = np.sqrt(np.mean(np.linalg.norm(amplitude[:, both], axis=0) ** 2))
        near = np.linalg.norm(amplitude[:, again] - amplitude[:, before], axis=0) <= MAX_DEPARTURE * rms
        group[again[near]] = group[before[near]]
    return group


def levels_of_sweeps(record: xr.Dataset) -> np.ndarray:
    """Number (point,) of the level that the sweep of each point has, by its median: of repeated sweeps the same."""
    number, medians = np.empty(record.sizes["point"], dtype=int), list[float]()
    for _, points in sweeps(record):
        own = float(np.median(record["level"].values[points]))
        same = [k for k, known in enumerate(medians) if _ratio(known, own) <= SAME_LEVEL_RATIO]
        if not same:
            medians.append(own)
        number[points] = same[0] if same else len(medians) - 1
    return number


def _ratio(one: float, other: float) -> float:
    """Ratio of two positive levels, the larger over the smaller."""
    return max(one, other) / min(one, other)


def _matched(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of frequencies of two sweeps that are nearest to each other and no farther than MAX_STEPS apart."""
    nearest, back = _nearest(one, other), _nearest(other, one)
    steps = [float(np.median(np.abs(np.diff(own)))) for own in (one, other) if own.size > 1]
    own = np.arange(one.size)
    close = (back[nearest] == own) & (np.abs(one - other[nearest]) <= MAX_STEPS * max(steps, default=0.0))
    return own[close], nearest[close]


def _nearest(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Index (n,) of the nearest of `other` to each of `one` (n,)."""
    order = np.argsort(other)
    at = np.searchsorted(other[order], one)
    low, high = order[np.maximum(at - 1, 0)], order[np.minimum(at, other.size - 1)]
    return np.where(np.abs(other[low] - one) <= np.abs(other[high] - one), low, high)
