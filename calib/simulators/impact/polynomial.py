"""Polynomials of degree 4 over a step, in x = tau / step, and the nodes they are fitted at."""

from collections.abc import Sequence
from decimal import Decimal, localcontext

import numpy as np
from numba import njit

from calib.simulators.compilation import WITHIN

PROBE_INDEX = 5  # of a point between the nodes, where a polynomial through them is held against what it stands for
DECIMAL_DIGITS = 50  # in which nodes and weights are computed, so that every processor has the same ones


def _tables() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, fit, integrals and values at the probe, from Lagrange's polynomials in decimals, rounded once.

    The nodes are those of Gauss and Lobatto on [0, 1]: 0, 1/2 - sqrt(3/28), 1/2, 1/2 + sqrt(3/28), 1.
    """
    with localcontext(prec=DECIMAL_DIGITS):
        half, inner = Decimal("0.5"), (Decimal(3) / 28).sqrt()
        nodes = [Decimal(0), half - inner, half, half + inner, Decimal(1)]
        points = [*nodes, (nodes[1] + nodes[2]) / 2]
        bases = [_lagrange(nodes, k) for k in range(len(nodes))]
        fit = list(zip(*bases, strict=True))  # coefficient, node
        integrals = [[Decimal(0), *(c / (j + 1) for j, c in enumerate(basis))] for basis in bases]
        integral = [[_value(basis, point) for basis in integrals] for point in points]
        between = [_value(basis, points[PROBE_INDEX]) for basis in bases]
        return _rounded(points), _rounded(fit), _rounded(integral), _rounded(between)


def _rounded(table: Sequence[Decimal] | Sequence[Sequence[Decimal]]) -> np.ndarray:
    return np.array(table, dtype=float)


def _lagrange(nodes: list[Decimal], k: int) -> list[Decimal]:
    """Coefficients, of x^0 first, of the polynomial that is 1 at node k and 0 at the others."""
    coefficients = [Decimal(1)]
    for node in nodes[:k] + nodes[k + 1 :]:
        raised, lowered = [Decimal(0), *coefficients], [*coefficients, Decimal(0)]
        coefficients = [(a - node * b) / (nodes[k] - node) for a, b in zip(raised, lowered, strict=True)]
    return coefficients


def _value(coefficients: list[Decimal], x: Decimal) -> Decimal:
    total = Decimal(0)
    for c in reversed(coefficients):
        total = c + x * total
    return total


# FIT: values at the nodes -> coefficients; INTEGRAL: -> integrals up to each point, for a step of 1; BETWEEN: -> value
# at the probe
POINTS, FIT, INTEGRAL, BETWEEN = _tables()
NODES = POINTS[:PROBE_INDEX].copy()


@njit(**WITHIN)
def polynomial(coefficients: np.ndarray, x: float) -> float:
    """Value of c0 + c1 x + ... + c4 x^4."""
    c = coefficients
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])))


@njit(**WITHIN)
def slope(coefficients: np.ndarray, x: float) -> float:
    """Derivative by x of `polynomial`."""
    c = coefficients
    return c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * 4.0 * c[4]))
