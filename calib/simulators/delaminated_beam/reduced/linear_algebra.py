"""Products and triangular factors of small matrices, for kernels."""

import numpy as np
from numba import njit

from calib.simulators.compilation import INLINED

VECTOR = {**INLINED, "fastmath": {"contract", "reassoc"}}


@njit(**VECTOR)
def dot(rows: np.ndarray, i: int, y: np.ndarray) -> float:
    """Row i of (m, n) times y (n,)."""
    total = 0.0
    for k in range(len(y)):
        total += rows[i, k] * y[k]
    return total


@njit(**VECTOR)
def dot_row(row: np.ndarray, y: np.ndarray) -> float:
    """Product of two (n,)."""
    total = 0.0
    for k in range(len(y)):
        total += row[k] * y[k]
    return total


@njit(**VECTOR)
def cholesky_factorise(matrix: np.ndarray, first: int, count: int) -> None:
    """Replace the rows of a symmetric positive definite matrix, from `first` on, by those of its Cholesky factor."""
    for i in range(first, count):
        for j in range(i):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / matrix[j, j]
        pivot = matrix[i, i]
        for k in range(i):
            pivot -= matrix[i, k] ** 2
        matrix[i, i] = np.sqrt(pivot)


@njit(**VECTOR)
def cholesky_solve(factor: np.ndarray, right: np.ndarray, count: int) -> None:
    """Solve a system whose Cholesky factor is given; the solution stands in `right`."""
    for i in range(count):
        total = right[i]
        for k in range(i):
            total -= factor[i, k] * right[k]
        right[i] = total / factor[i, i]
    for i in range(count - 1, -1, -1):
        right[i] /= factor[i, i]
        for k in range(i):
            right[k] -= factor[i, k] * right[i]
