"""Polynomials of degree 4 over a step, in x = tau / step, and the nodes they are fitted at."""

import math

import numpy as np
from numba import njit

NODES = np.array([0.0, 0.5 - math.sqrt(3.0 / 28.0), 0.5, 0.5 + math.sqrt(3.0 / 28.0), 1.0])  # Gauss-Lobatto
PROBE = 5  # index of a point between the nodes, where a polynomial through them is held against what it stands for
POINTS = np.append(NODES, 0.5 * (NODES[1] + NODES[2]))
# values at the nodes -> coefficients; -> integrals up to each point, for a step of 1; -> value at the probe
FIT = np.ascontiguousarray(np.linalg.inv(np.vander(NODES, increasing=True)))
INTEGRAL = np.ascontiguousarray((POINTS[:, None] ** np.arange(1, 6) / np.arange(1, 6)) @ FIT)
BETWEEN = POINTS[PROBE] ** np.arange(5) @ FIT


@njit(cache=True, error_model="numpy")
def polynomial(coefficients, x):
    """Value of c0 + c1 x + ... + c4 x^4."""
    c = coefficients
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])))


@njit(cache=True, error_model="numpy")
def slope(coefficients, x):
    """Derivative by x of `polynomial`."""
    c = coefficients
    return c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * 4.0 * c[4]))
