"""Separate modes of a sample: sets of draws with an empty gap between them.

A gap between neighbouring draws along an axis separates modes where it is too wide for a chance. Where the density were
the same about it, its width would be an exponential variable, and that of the k next gaps beside it together a gamma
variable: it exceeds r times the latter with probability (1 + r)^-k. The wider side counts. The axes are those of the
parameters and the principal ones of the draws; each side is looked at again by itself. Modes that touch are one.
"""

import math

import numpy as np

MIN_MODE_SHARE = 0.02  # of the draws, on either side of a gap  [1]: fewer are no mode
MIN_MODE_DRAWS = 10  # on either side of a gap  [count]: a density is hardly known from fewer
MAX_CHANCE = 1e-3  # that a sample of one mode is taken apart  [1]


def separate_modes(points: np.ndarray) -> list[np.ndarray]:
    """Indices of the points (n, dim) that belong to each mode, the largest first; one of all where there is no gap.

    points : equally weighted draws; some may be there several times
    """
    unique, first = np.unique(points, axis=0, return_inverse=True)
    parts = _parted(unique, np.arange(len(unique)), max(MIN_MODE_DRAWS, math.ceil(MIN_MODE_SHARE * len(unique))))
    members = [np.flatnonzero(np.isin(first.ravel(), part)) for part in parts]
    return sorted(members, key=lambda own: (-own.size, own[0]))


def _parted(points: np.ndarray, members: np.ndarray, least: int) -> list[np.ndarray]:
    """Take the members (k,) of the points apart at the widest gap, until there is none."""
    own = points[members]
    rarest, below = math.log(2 * points.shape[1] * len(points) / MAX_CHANCE), None
    for positions in (own @ _axes(own)).T:
        order = np.argsort(positions, kind="stable")
        surprises = _surprises(positions[order], least)
        if surprises.size and surprises.max() > rarest:
            rarest, below = float(surprises.max()), order[: least + int(np.argmax(surprises))]
    if below is None:
        return [members]
    lower = np.zeros(members.size, dtype=bool)
    lower[below] = True
    return _parted(points, members[lower], least) + _parted(points, members[~lower], least)


def _axes(points: np.ndarray) -> np.ndarray:
    """Unit vectors (dim, 2 dim): the parameters, and the principal axes of the points (n, dim) in their own scales."""
    dim = points.shape[1]
    spread = points.std(axis=0)
    scale = np.where(spread > 0.0, spread, 1.0)
    _, _, right = np.linalg.svd((points - points.mean(axis=0)) / scale, full_matrices=True)
    return np.hstack([np.eye(dim), right.T / scale[:, None]])


def _surprises(positions: np.ndarray, least: int) -> np.ndarray:
    """Minus logarithm of the chance of each gap with `least` of the ascending positions (n,) on both sides."""
    n = positions.size
    left = np.arange(least - 1, n - least)  # last position below each gap
    if not left.size:
        return np.empty(0)
    gap = positions[left + 1] - positions[left]
    beside = np.maximum(positions[left] - positions[left - least + 1], positions[left + least] - positions[left + 1])
    return (least - 1) * np.log1p(gap / np.maximum(beside, np.finfo(float).tiny))
