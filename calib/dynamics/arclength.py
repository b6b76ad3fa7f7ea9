"""Pseudo-arclength continuation: points of a curve of solutions, one step after another.

The unknowns z (d,), the last of which are parameters between 0 and 1, run along the curve of the d - 1 equations
residual(z) = 0. From a point with the unit tangent t the next is sought at t . (z - guess) = 0 with the guess a step
ahead (Keller 1977), which the curve predicts: on its tangent, or on the cubic through the last two points.
"""

import math
from collections.abc import Callable, Mapping
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from calib.dynamics.orbits import newton

FIRST_ARCLENGTH_STEP = 0.01  # along the curve, in scaled coordinates z
MAX_ARCLENGTH_STEP = 0.05  # the same
MIN_ARCLENGTH_STEP = 1e-6  # the same; a curve that cannot be followed with it ends
MAX_QUICK_CORRECTIONS = 3  # of the corrector; after no more the step along the curve is lengthened
MAX_NEWTON_STEPS = 8  # of the corrector
MIN_PREDICTOR_SPACING = 0.5  # distance of the last two points over the step, below which the tangent is followed  [1]
MAX_PREDICTOR_BEND = 0.05  # departure of the cubic from the tangent over the step, above which that is followed  [1]
MIN_TANGENT_COSINE = 0.95  # between neighbouring tangents
EDGE_ROUNDING = 1e-12  # of a parameter that is at the edge of its window
ARCLENGTH_TOLERANCE = 1e-11  # of the position of a special point along the curve
MAX_TEST_AT_ROOT = 1e-2  # value of a test function at its root over that at the step's end; above it it has jumped

CLOSED = "the branch closes on itself"
EDGE_OF_WINDOW, POINTS_ARE_MADE = "edge of the window", "points are made"  # begin and end of what else ends one


class CurvePoint(Protocol):
    """A point of a curve.

    Attributes
    ----------
    z, tangent : (d,) and the unit tangent there
    corrections : steps of Newton's method that it took
    """

    @property
    def z(self) -> np.ndarray:
        """Point in scaled coordinates (d,)."""
        ...

    @property
    def tangent(self) -> np.ndarray:
        """Unit tangent (d,)."""
        ...

    @property
    def corrections(self) -> int:
        """Steps of Newton's method that it took."""
        ...


P = TypeVar("P", bound=CurvePoint)
Test = Callable[[P, P], float]  # of a point and the one before it; it changes sign at a special point


class Mark(NamedTuple, Generic[P]):
    """A special point: its kind, the sentence with its numbers, and whether the curve ends there for this reason."""

    kind: str
    point: P
    evidence: str
    last: bool = False


class SolutionCurve(Protocol[P]):
    """What is followed: n equations in n + 1 unknowns, the last `parameters` of which stay within [0, 1]."""

    @property
    def parameters(self) -> int:
        """Number of parameters among the unknowns."""
        ...

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Left-hand sides (d - 1,), NaN where they are not known."""
        ...

    def derivative(self, z: np.ndarray) -> np.ndarray:
        """Their derivative (d - 1, d), NaN where it is not known."""
        ...

    def point(self, z: np.ndarray, steps: tuple[float, ...], heading: np.ndarray) -> P | None:
        """Point at a solution, its tangent along `heading` (d,); None where the derivative is not known."""
        ...

    def predicted(self, base: P, before: P, step: float) -> np.ndarray:
        """Guess (d,) a step ahead of `base`, by `along_tangent` or `along_cubic`.

        before : the point before `base`, or `base` where there is none
        """
        ...

    def obstacle(self, base: P, point: P) -> str:
        """Why `point` is not the next one after `base`; empty where it is."""
        ...

    def marks(self, base: P, ahead: P) -> list[Mark[P]] | None:
        """Special points between two neighbours in their order; None where the curve is lost between them."""
        ...

    def where(self, point: P) -> str:
        """The parameters of a point, for a sentence."""
        ...


class OneWay(NamedTuple, Generic[P]):
    """Points of a curve one way from a start; its special points by position, why it ends, and whether it is lost."""

    points: list[P]
    marks: list[tuple[int, Mark[P]]]
    reason: str
    lost: bool


def run(curve: SolutionCurve[P], start: P, most: int, longest: float = MAX_ARCLENGTH_STEP) -> OneWay[P]:
    """Follow the curve from `start` along its tangent for at most `most` points, special points aside.

    longest : step along the curve, in scaled coordinates z
    """
    points, marks, step = [start], list[tuple[int, Mark[P]]](), min(FIRST_ARCLENGTH_STEP, longest)
    while len(points) <= most:
        base = points[-1]
        if any(abs(z - float(t > 0.0)) <= EDGE_ROUNDING for z, t in _parameters(curve, base)):
            return OneWay(points, marks, f"{EDGE_OF_WINDOW}, {curve.where(base)}", False)
        ahead, reason = _ahead(curve, base, points[-2] if len(points) > 1 else base, step)
        between = curve.marks(base, ahead) if ahead else []
        if ahead is None or between is None:
            step /= 2.0
            if step < MIN_ARCLENGTH_STEP:
                return OneWay(points, marks, reason or "the cycles beside a special point are not found", True)
            continue
        for mark in between:
            points.append(mark.point)
            marks.append((len(points) - 1, mark))
            if mark.last:
                return OneWay(points, marks, mark.evidence, False)
        points.append(ahead)
        step = min(1.5 * step, longest) if ahead.corrections <= MAX_QUICK_CORRECTIONS else step
        to_start = start.z - ahead.z
        if np.linalg.norm(to_start) <= step and min(to_start @ ahead.tangent, start.tangent @ ahead.tangent) > 0.0:
            return OneWay([*points, start], marks, CLOSED, False)
    return OneWay(points, marks, f"{most} {POINTS_ARE_MADE}", False)


def near(
    curve: SolutionCurve[P], guess: np.ndarray, normal: np.ndarray, heading: np.ndarray, reach: float
) -> tuple[P | None, str]:
    """Point of the curve in the plane through `guess`, within `reach` of it; None and why without one."""
    z, sizes, reason = newton(
        lambda z: np.append(curve.residual(z), normal @ (z - guess)),
        lambda z: np.vstack([curve.derivative(z), normal]),
        guess,
        MAX_NEWTON_STEPS,
    )
    if reason:
        return None, reason
    if np.linalg.norm(z - guess) > reach:
        return None, "the nearest cycle lies off the branch"
    point = curve.point(z, sizes, heading)
    return point, "" if point else "the motion fails beside the cycle"


def along_tangent(base: CurvePoint, step: float) -> np.ndarray:
    """Guess (d,) a step ahead of `base` on its tangent."""
    return base.z + step * base.tangent


def along_cubic(base: CurvePoint, before: CurvePoint, step: float) -> np.ndarray:
    """Guess (d,) a step ahead of `base` on the cubic through it and the point before, with their tangents.

    On the tangent where the points are close together or the curve bends sharply.
    """
    straight = along_tangent(base, step)
    distance = float(np.linalg.norm(base.z - before.z))
    if distance < MIN_PREDICTOR_SPACING * abs(step):
        return straight
    chord = (base.z - before.z) / distance
    second = (2.0 * base.tangent + before.tangent - 3.0 * chord) / distance
    third = (base.tangent + before.tangent - 2.0 * chord) / distance**2
    bend = step**2 * (second + step * third)
    return straight + bend if np.linalg.norm(bend) <= MAX_PREDICTOR_BEND * abs(step) else straight


def roots(curve: SolutionCurve[P], base: P, ahead: P, tests: Mapping[str, Test[P]]) -> list[tuple[str, P]] | None:
    """Points between two neighbours at which a test changes sign, in their order; None where the curve is lost."""
    located = []
    for kind, test in tests.items():
        ends = test(base, base), test(ahead, base)
        if ends[0] * ends[1] < 0.0:
            point = root(curve, base, ahead, test)
            if point is None:
                return None
            if abs(test(point, base)) < MAX_TEST_AT_ROOT * max(map(abs, ends)):
                located.append((kind, point))
    return sorted(located, key=lambda entry: (entry[1].z - base.z) @ base.tangent)


def root(curve: SolutionCurve[P], base: P, ahead: P, test: Test[P]) -> P | None:
    """Point between two neighbours at which `test` changes sign, by the Illinois method on the arclength."""
    low, high = 0.0, float(np.linalg.norm(ahead.z - base.z))
    # so close to the curve that Newton has little to do, which matters where its matrix is singular: at a branching
    between = CubicHermiteSpline([low, high], [base.z, ahead.z], [base.tangent, ahead.tangent])
    normal, reach = (ahead.z - base.z) / high, 0.5 * high
    at_low, at_high = test(base, base), test(ahead, base)
    point, before = None, math.inf
    for _ in range(60):
        arclength = (low * at_high - high * at_low) / (at_high - at_low)
        point, _ = near(curve, between(arclength), normal, base.tangent, reach)
        if point is None:
            return None
        value = test(point, base)
        if value == 0.0 or abs(arclength - before) < ARCLENGTH_TOLERANCE:
            break
        before = arclength
        if value * at_high < 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        high, at_high = arclength, value
    return point


def _ahead(curve: SolutionCurve[P], base: P, before: P, step: float) -> tuple[P | None, str]:
    """Next point, a step ahead of `base` or on the edge of the window before that; None and why without one.

    before : see `SolutionCurve.predicted`
    """
    normal = base.tangent
    share, edge = 1.0, -1
    for i, (z, t) in enumerate(_parameters(curve, base), start=base.z.size - curve.parameters):
        if not 0.0 < z + step * t < 1.0 and (float(t > 0.0) - z) / (step * t) <= share:
            share, edge = (float(t > 0.0) - z) / (step * t), i
    guess = curve.predicted(base, before, share * step)
    if edge >= 0:
        guess[edge], normal = float(base.tangent[edge] > 0.0), np.eye(guess.size)[edge]
    point, reason = near(curve, guess, normal, base.tangent, 0.5 * step)
    if point is None:
        return None, reason
    reason = curve.obstacle(base, point)
    if not reason and point.tangent @ base.tangent < MIN_TANGENT_COSINE:
        reason = "the branch has a corner"
    return (None, reason) if reason else (point, "")


def _parameters(curve: SolutionCurve[P], point: P) -> list[tuple[float, float]]:
    """Each parameter of a point, and the component of the tangent along it."""
    return list(zip(point.z[-curve.parameters :], point.tangent[-curve.parameters :], strict=True))
