"""Test functions of codimension two: what is zero where a second condition holds on a curve of bifurcations.

Kuznetsov, Elements of Applied Bifurcation Theory (2004), section 9.1; for curves of grazings the multipliers are those
of the motion without the touch.
"""

import itertools
from typing import NamedTuple

import numpy as np

from calib.dynamics.arclength import Test
from calib.dynamics.defining import SingularPair
from calib.dynamics.orbits import Cycle

MULTIPLIERS = {"fold": 1.0, "flip": -1.0}  # that is critical along a curve of this kind  [1]


class LocusPoint(NamedTuple):
    """A point of a curve of folds, flips or grazings, for `calib.dynamics.arclength`.

    Attributes
    ----------
    z : (dimension + 2,) what is continued; located : the point of the curve, which differs from it for a grazing only
    tangent : (dimension + 2,)
    corrections : steps of Newton's method that it took
    error : (2,) of the parameters of `located`, as shares of their windows
    cycle : at z
    multipliers : (dimension,) at `located`
    pair : singular pair of the derivative of one return less the critical multiplier, of a grazing less 1
    gradient : (dimension,) derivative of the defining function by the state
    margin : how far the motion is from a grazing, or from another one  [1]
    """

    z: np.ndarray
    located: np.ndarray
    tangent: np.ndarray
    corrections: int
    error: np.ndarray
    cycle: Cycle
    multipliers: np.ndarray
    pair: SingularPair
    gradient: np.ndarray
    margin: float


def others(kind: str, multipliers: np.ndarray) -> np.ndarray:
    """Return the multipliers less the critical one, which a grazing does not have."""
    if kind not in MULTIPLIERS:
        return multipliers
    return np.delete(multipliers, np.argmin(np.abs(multipliers - MULTIPLIERS[kind])))


def oriented(points: list[LocusPoint]) -> list[LocusPoint]:
    """Return the points with the singular vectors of neighbours on one side."""
    turned: list[LocusPoint] = []
    for point in points:
        value, left, right = point.pair
        opposite = bool(turned) and right @ turned[-1].pair.right < 0.0
        turned.append(point._replace(pair=SingularPair(value, -left, -right)) if opposite else point)
    return turned


def evidence(curve: str, kind: str, point: LocusPoint) -> str:
    """Numbers of a point of codimension two; empty at a neutral saddle, where two real multipliers have the product 1.

    Parameters
    ----------
    curve : "fold", "flip" or "grazing"
    """
    rest = others(curve, point.multipliers)
    if "Neimark-Sacker" in kind:
        one, _ = min(itertools.combinations(rest, 2), key=lambda pair: abs(pair[0] * pair[1] - 1.0))
        turned = abs(np.angle(one)) / (2.0 * np.pi)
        return f"a pair of modulus {abs(one):.6f} turns by {turned:.6f} of a circle per return" if one.imag else ""
    if kind == "cusp":
        return f"the quadratic coefficient is {point.gradient @ point.pair.right:.1e}"
    return "multipliers " + ", ".join(map(in_words, point.multipliers))


def in_words(multiplier: complex) -> str:
    """Return a multiplier with six decimals: a real one, or one of a pair, as 0.3 - 0.4i."""
    real, imaginary = f"{multiplier.real:.6f}", f"{abs(multiplier.imag):.6f}"
    if not float(imaginary):
        return real
    return f"{real} {'-' if multiplier.imag < 0.0 else '+'} {imaginary}i"


def _quadratic_coefficient(point: LocusPoint, base: LocusPoint) -> float:
    right = point.pair.right
    return float(point.gradient @ right * np.sign(right @ base.pair.right))


def _double_multiplier(point: LocusPoint, _: LocusPoint) -> float:
    return float(point.pair.left @ point.pair.right)


def _another_multiplier(kind: str, value: float) -> Test[LocusPoint]:
    return lambda point, _: float(np.prod(others(kind, point.multipliers) - value).real)


def _pair_on_circle(kind: str) -> Test[LocusPoint]:
    def product(point: LocusPoint, _: LocusPoint) -> float:
        pairs = itertools.combinations(others(kind, point.multipliers), 2)
        return float(np.prod([one * other - 1.0 for one, other in pairs]).real)

    return product


TESTS: dict[str, dict[str, Test[LocusPoint]]] = {
    "fold": {
        "cusp": _quadratic_coefficient,
        "1:1 resonance": _double_multiplier,
        "fold-flip": _another_multiplier("fold", -1.0),
        "fold-Neimark-Sacker": _pair_on_circle("fold"),
    },
    "flip": {
        "1:2 resonance": _double_multiplier,
        "fold-flip": _another_multiplier("flip", 1.0),
        "flip-Neimark-Sacker": _pair_on_circle("flip"),
    },
    "grazing": {
        "fold-grazing": _another_multiplier("grazing", 1.0),
        "flip-grazing": _another_multiplier("grazing", -1.0),
        "Neimark-Sacker-grazing": _pair_on_circle("grazing"),
    },
}
AT_GRAZING = {"fold": "fold-grazing", "flip": "flip-grazing", "grazing": "double grazing"}  # where such a curve ends
CLEARANCE_OR_SPEED = "least clearance or closing speed"
TEST_FUNCTIONS = {  # what is zero at a point of codimension two
    "cusp": "coefficient of the quadratic term",
    "1:1 resonance": "product of the two eigenvectors to the multiplier 1",
    "1:2 resonance": "product of the two eigenvectors to the multiplier -1",
    "fold-flip": "difference of a further multiplier from 1 or -1",
    "fold-grazing": "difference of a multiplier from 1",
    "flip-grazing": "difference of a multiplier from -1",
    "fold-Neimark-Sacker": "difference of the product of a further pair of multipliers from 1",
    "flip-Neimark-Sacker": "difference of the product of a further pair of multipliers from 1",
    "Neimark-Sacker-grazing": "difference of the product of a pair of multipliers from 1",
    "double grazing": CLEARANCE_OR_SPEED,
}
