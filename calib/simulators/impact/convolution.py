"""Coefficients of products of power series, while the series are being worked out."""

import numpy as np
from numba import njit

from calib.simulators.compilation import INLINED


@njit(**INLINED)
def convolutions(power: np.ndarray, weighted: np.ndarray, depth: np.ndarray, k: int) -> tuple[float, float]:
    """Return the sums of power[j] depth[k + 1 - j] and of weighted[j] depth[k + 1 - j] over j = 0..k, weighted[0] = 0.

    What is known last enters last.
    """
    plain, by_order = 0.0, 0.0
    for j in range(1, k + 1):
        other = depth[k + 1 - j]
        plain += power[j] * other
        by_order += weighted[j] * other
    return plain + power[0] * depth[k + 1], by_order


@njit(**INLINED)
def square_term(depth: np.ndarray, k: int) -> float:
    """Return the sum of depth[j] depth[k + 1 - j] over j = 0..k + 1, in two chains; what is known last enters last."""
    a, b, half = 0.0, 0.0, k // 2
    for j in range(1, half, 2):
        a += depth[j] * depth[k + 1 - j]
        b += depth[j + 1] * depth[k - j]
    if half % 2 == 1:
        a += depth[half] * depth[k + 1 - half]
    total = 2.0 * (a + b)
    if k % 2 == 1:
        total += depth[half + 1] * depth[half + 1]
    return total + 2.0 * depth[0] * depth[k + 1]
