"""Few linear equations in one step of the kernel: too few for LAPACK, whose calls cost more than the arithmetic."""

import numpy as np
from numba import njit

from calib.simulators.compilation import WITHIN


@njit(**WITHIN)
def eliminate(equations: np.ndarray, m: int) -> None:
    """Solve `m` equations, the first rows of an array (m or more, m + 1 or more), by Gauss and Jordan with pivoting.

    Column m, the right-hand side, becomes the solution; it is not finite where the equations are singular.
    """
    for i in range(m):
        pivot = i
        for row in range(i + 1, m):
            if abs(equations[row, i]) > abs(equations[pivot, i]):
                pivot = row
        for column in range(i, m + 1):
            largest = equations[pivot, column]
            equations[pivot, column] = equations[i, column]
            equations[i, column] = largest
        for column in range(m, i - 1, -1):
            equations[i, column] /= equations[i, i]
        for row in range(m):
            if row != i:
                for column in range(m, i - 1, -1):
                    equations[row, column] -= equations[row, i] * equations[i, column]
