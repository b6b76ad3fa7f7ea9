"""Defining systems of bifurcation curves: what holds, beside P^n(x; a, b) = x, along a fold, a flip or a grazing.

The unknowns are z = (state / scale, a and b as shares of their windows). A fold and a flip have a multiplier m of 1 and
of -1: the smallest singular value of M - m I, with the sign of its determinant, is zero (M is the derivative of one
return). With the singular vectors u, v of that value s its derivative is u . dM v, and u . M'' e v = u . M'' v e along
a direction e of the state, so that two derivatives M beside x in the direction of v give it for all states.

A motion that grazes lies on the border of two maps, one with the touch and one without it. That without it is smooth up
to the border, where the least clearance of a near miss comes to zero: cycles are sought at which it has small values,
from which the one at zero is extrapolated.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from calib.dynamics.arclength import EDGE_ROUNDING
from calib.dynamics.tangent import jacobian
from calib.modelling.orbit import PeriodMap
from calib.records import OK

DEFINING_DIFFERENCE = 1e-7  # of the scale and of the windows, for derivatives of a defining function


@dataclass(frozen=True)
class ParameterPlane:
    """Two parameters and the maps at their values.

    Attributes
    ----------
    maps : the map at a value of each, in their units
    a, b : windows, lowest and highest value
    """

    maps: Callable[[float, float], PeriodMap]
    a: tuple[float, float]
    b: tuple[float, float]

    def values(self, z: np.ndarray) -> tuple[float, float]:
        """Values of a and b at the scaled point z (d,): its last two components, shares of the windows."""
        (a, b), shares = zip(self.a, self.b, strict=True), z[-2:]
        first, second = ((1.0 - share) * low + share * high for share, low, high in zip(shares, a, b, strict=True))
        return float(first), float(second)  # exact at the edges

    def holds(self, z: np.ndarray) -> bool:
        """Whether the scaled point z (d,) is in the plane, but for rounding."""
        return bool(np.abs(z[-2:] - 0.5).max() <= 0.5 + EDGE_ROUNDING)

    def widths(self) -> np.ndarray:
        """Widths of the windows (2,), each in its unit."""
        return np.array([self.a[1] - self.a[0], self.b[1] - self.b[0]])


@dataclass(frozen=True)
class Returns:
    """Returns after `periods` periods over a plane of parameters, states in units of `scale` (dimension,)."""

    plane: ParameterPlane
    periods: int
    scale: np.ndarray

    def map(self, z: np.ndarray) -> PeriodMap:
        """Map at the parameters of z."""
        return self.plane.maps(*self.plane.values(np.clip(z, 0.0, 1.0)))

    def state(self, z: np.ndarray) -> np.ndarray:
        """State (dimension,) at z, each component in its unit."""
        return z[:-2] * self.scale

    def departure(self, z: np.ndarray) -> np.ndarray:
        """Return of the state less the state (dimension,); NaN where the motion fails or z is not in the plane."""
        unknown = np.full(self.scale.size, np.nan)
        if not self.plane.holds(z):
            return unknown
        orbit = self.map(z).orbit(self.state(z), self.periods)
        return orbit.states[-1] / self.scale - z[:-2] if orbit.status == OK else unknown

    def derivative(self, z: np.ndarray) -> np.ndarray:
        """Derivative M (dimension, dimension) of one return by the state; NaN as in `departure`."""
        if not self.plane.holds(z):
            return np.full((self.scale.size, self.scale.size), np.nan)
        map = self.map(z)
        ratio = map.scale / self.scale  # a map's scale may change with the parameters
        return jacobian(map, self.state(z), self.periods)[1] * ratio[:, None] / ratio


class Defining(Protocol):
    """A function that is zero along a curve, beside the departure of its cycles."""

    def value(self, returns: Returns, z: np.ndarray) -> float:
        """Value at z (d,), NaN where it is not known."""
        ...

    def by_state(self, returns: Returns, z: np.ndarray) -> np.ndarray:
        """Its derivative (dimension,) by the state in units of the scale."""
        ...


class SingularPair(NamedTuple):
    """Smallest singular value of a matrix, negative where its determinant is, and the vectors u, v: u . A v = value."""

    value: float
    left: np.ndarray
    right: np.ndarray


def singular_pair(matrix: np.ndarray) -> SingularPair:
    """Smallest singular value of a square matrix (n, n) with its sign; NaN where the matrix is not known."""
    if not np.isfinite(matrix).all():
        unknown = np.full(len(matrix), np.nan)
        return SingularPair(math.nan, unknown, unknown)
    left, sizes, right = np.linalg.svd(matrix)
    # of the orthogonal factors, not of the matrix: known where the smallest singular value is lost to rounding
    sign = float(np.sign(np.linalg.det(left) * np.linalg.det(right)))
    return SingularPair(sign * sizes[-1], sign * left[:, -1], right[-1])


@dataclass(frozen=True)
class CriticalMultiplier:
    """A multiplier is `multiplier`: 1 at a fold, -1 at a flip."""

    multiplier: float

    def pair(self, matrix: np.ndarray) -> SingularPair:
        """Singular pair of M - m I, of the derivative M of one return."""
        return singular_pair(matrix - self.multiplier * np.eye(len(matrix)))

    def value(self, returns: Returns, z: np.ndarray) -> float:
        """Signed smallest singular value."""
        return self.pair(returns.derivative(z)).value

    def by_state(self, returns: Returns, z: np.ndarray) -> np.ndarray:
        """Derivative (dimension,), by the symmetry of second derivatives."""
        pair = self.pair(returns.derivative(z))
        if math.isnan(pair.value):
            return pair.left
        along = DEFINING_DIFFERENCE * np.append(pair.right, [0.0, 0.0])
        change = returns.derivative(z + along) - returns.derivative(z - along)
        return pair.left @ change / (2.0 * DEFINING_DIFFERENCE)


@dataclass(frozen=True)
class NearMiss:
    """The least clearance that an impact is missed by is `clearance`, in units of `length` [m], with `impacts`."""

    clearance: float
    length: float
    impacts: int

    def value(self, returns: Returns, z: np.ndarray) -> float:
        """Least clearance less that wanted; NaN where impacts have come or gone, or nothing is missed."""
        map, state = returns.map(z), returns.state(z)
        orbit = map.orbit(state, returns.periods)
        if orbit.status != OK or (len(orbit.impacts) != self.impacts and orbit.contact == 0.0):
            return math.nan
        misses = np.concatenate([map.near_misses(x) for x in (state, *orbit.states[:-1])])
        return float(misses.min()) / self.length - self.clearance if misses.size else math.nan

    def by_state(self, returns: Returns, z: np.ndarray) -> np.ndarray:
        """Derivative (dimension,) by central differences."""
        steps = DEFINING_DIFFERENCE * np.eye(z.size)[:-2]
        change = [self.value(returns, z + step) - self.value(returns, z - step) for step in steps]
        return np.array(change) / (2.0 * DEFINING_DIFFERENCE)


def residual(returns: Returns, defining: Defining, z: np.ndarray) -> np.ndarray:
    """Left-hand sides (dimension + 1,) of the defining system; NaN where they are not known."""
    departure = returns.departure(z)
    known = np.isfinite(departure).all()
    return np.append(departure, defining.value(returns, z) if known else math.nan)


def system_derivative(returns: Returns, defining: Defining, z: np.ndarray) -> np.ndarray:
    """Derivative (dimension + 1, dimension + 2) of the defining system by z; NaN where it is not known."""
    by_state = np.vstack([returns.derivative(z) - np.eye(z.size - 2), defining.by_state(returns, z)])
    columns = []
    for i in (-2, -1):
        behind, ahead = z.copy(), z.copy()
        behind[i] = max(z[i] - DEFINING_DIFFERENCE, 0.0)
        ahead[i] = min(z[i] + DEFINING_DIFFERENCE, 1.0)
        change = residual(returns, defining, ahead) - residual(returns, defining, behind)
        columns.append(change / (ahead[i] - behind[i]))
    return np.column_stack([by_state, *columns])
