"""Curves of folds, flips and grazings over two parameters: what bounds the window of motions of one kind.

A special point of a branch is continued by pseudo-arclength continuation of its defining system (see
`calib.dynamics.defining`; Kuznetsov, Elements of Applied Bifurcation Theory, 2004, chapters 9 and 10). A curve goes on
through a point of codimension two at which it stays smooth, and ends where it comes to a grazing.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from calib.dynamics.arclength import (
    CLOSED,
    EDGE_ROUNDING,
    MAX_NEWTON_STEPS,
    Mark,
    OneWay,
    along_tangent,
    near,
    roots,
    run,
)
from calib.dynamics.branch import FROM_FLIP, Branch, Special
from calib.dynamics.codimension import (
    AT_GRAZING,
    CLEARANCE_OR_SPEED,
    MULTIPLIERS,
    TEST_FUNCTIONS,
    TESTS,
    LocusPoint,
    evidence,
    oriented,
    others,
)
from calib.dynamics.defining import (
    CriticalMultiplier,
    Defining,
    NearMiss,
    ParameterPlane,
    Returns,
    residual,
    singular_pair,
    system_derivative,
)
from calib.dynamics.grazing import at_zero, extrapolated, impacts_differ, section_hint
from calib.dynamics.orbits import SAME_STATE_DISTANCE, Cycle, cycle_at, length_scale, margin, newton
from calib.errors import CalibError

CLEARANCES = 1e-4 * np.arange(1.0, 5.0)  # of the scale of displacements: near misses that are extrapolated to none
MAX_START_CORRECTION = 2e-2  # scaled coordinates: distance of a curve's first point from the branch's special point
START_OFFSETS = (1e-3, 1e-4, 1e-2)  # scaled coordinates: from a grazing aside to where the stop is missed
MAX_REMEMBERED_MAPS = 32  # of the last values of both parameters
SAME_CURVE_DISTANCE = 2e-3  # scaled coordinates: special points that lie on one curve


@dataclass(frozen=True)
class CodimensionTwo:
    """A point of a curve at which a second condition holds.

    Attributes
    ----------
    kind : such as "cusp", "fold-flip", "1:2 resonance" or "flip-grazing"
    a, b : parameters there, in their units; state (dimension,), each component in its unit
    index : position in the curve's arrays; where a curve ends at a grazing it is that of the last point before
    test : the test function that vanishes
    evidence : one sentence with the numbers
    """

    kind: str
    a: float
    b: float
    state: np.ndarray
    index: int
    test: str
    evidence: str


@dataclass(frozen=True, eq=False)
class BifurcationCurve:
    """A curve of folds, flips or grazings over two parameters; m points in the order of the curve.

    Attributes
    ----------
    kind : "fold", "flip" or "grazing"; periods : of one return
    start : a of the special point of the branch that it goes through
    names, units : of the components of the state
    a, b : (m,) parameters, each in its unit
    errors : (2, m) of a and b: what Newton's method has left, or the extrapolation to grazing
    states : (m, dimension) each component in its unit
    multipliers : (m, dimension) complex, by falling modulus; of a grazing those of the motion without the touch
    bounding : (m,) whether all other multipliers are within the unit circle: it bounds a window of stable motion
    impacts : (m,) number per return, without the touch of a grazing
    tests : (m,) of each test function by the kind of point at which it is zero
    points : points of codimension two
    ends : why the curve ends before its first and after its last point
    """

    kind: str
    periods: int
    start: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    a: np.ndarray
    b: np.ndarray
    errors: np.ndarray
    states: np.ndarray
    multipliers: np.ndarray
    bounding: np.ndarray
    impacts: np.ndarray
    tests: dict[str, np.ndarray]
    points: tuple[CodimensionTwo, ...]
    ends: tuple[str, str]


def follow_curves(
    branch: Branch,
    plane: ParameterPlane,
    b: float,
    most: int = 400,
    on_curve: Callable[[tuple[BifurcationCurve, ...], int, int], None] | None = None,
) -> tuple[BifurcationCurve, ...]:
    """Follow the folds, flips and grazings of a branch, which is over a at this b, as curves over the plane.

    A special point that lies on a curve made before has none of its own. A curve whose first point is not found has no
    points, and both ends say why.

    Parameters
    ----------
    most : points each way
    on_curve : told the curves made so far, how many special points are done, and how many there are

    Raises
    ------
    CalibError : a window without width, or a branch that is not in the plane
    """
    for name, (low, high), values in (("a", plane.a, branch.parameter), ("b", plane.b, np.array([b]))):
        inside = bool(((values >= low) & (values <= high)).all())
        if not (np.isfinite([low, high]).all() and low < high and inside):
            raise CalibError(f"expected {name} of the branch in a window [low, high], got [{low:g}, {high:g}]")
    made: list[tuple[_Locus, list[LocusPoint], BifurcationCurve]] = []
    specials = [special for special in branch.points if special.kind in AT_GRAZING]
    # most of the time is that of making a map, and one is asked for again and again
    plane = replace(plane, maps=lru_cache(maxsize=MAX_REMEMBERED_MAPS)(plane.maps))
    for done, special in enumerate(specials, start=1):
        locus, start, reason = _start(branch, special, plane, b)
        known = [points for other, points, _ in made if (other.kind, other.periods) == (locus.kind, locus.periods)]
        if start is None or not any(_on_curve(points, start) for points in known):
            points, curve = _both_ways(locus, start, special, branch, reason, most)
            made.append((locus, points, curve))
        if on_curve:
            on_curve(tuple(curve for _, _, curve in made), done, len(specials))
    return tuple(curve for _, _, curve in made)


@dataclass(frozen=True)
class _Locus:
    """A curve of one kind, for `calib.dynamics.arclength`; `length` [m] and `impacts` matter to a grazing only."""

    kind: str
    returns: Returns
    length: float
    impacts: int
    parameters: int = 2

    @property
    def periods(self) -> int:
        return self.returns.periods

    def defining(self, clearance: float = CLEARANCES[0]) -> Defining:
        multiplier = MULTIPLIERS.get(self.kind)
        return NearMiss(clearance, self.length, self.impacts) if multiplier is None else CriticalMultiplier(multiplier)

    def residual(self, z: np.ndarray) -> np.ndarray:
        return residual(self.returns, self.defining(), z)

    def derivative(self, z: np.ndarray) -> np.ndarray:
        return system_derivative(self.returns, self.defining(), z)

    def point(self, z: np.ndarray, steps: tuple[float, ...], heading: np.ndarray) -> LocusPoint | None:
        matrix = self.derivative(z)
        if not np.isfinite(matrix).all():
            return None
        tangent = np.linalg.svd(matrix)[2][-1]
        tangent = tangent if tangent @ heading >= 0.0 else -tangent
        map, jacobian = self.returns.map(z), matrix[:-1, :-2] + np.eye(z.size - 2)
        cycle = cycle_at(map, self.returns.state(z), self.returns.periods, jacobian, steps)
        if self.kind == "grazing":
            return self._grazing(z, tangent, cycle, matrix, len(steps) - 1)
        error = np.abs(np.linalg.lstsq(matrix, -self.residual(z), rcond=None)[0][-2:])
        pair = singular_pair(matrix[:-1, :-2] + (1.0 - MULTIPLIERS[self.kind]) * np.eye(z.size - 2))
        return LocusPoint(
            z, z, tangent, len(steps) - 1, error, cycle, cycle.multipliers, pair, matrix[-1, :-2], cycle.margin
        )

    def _grazing(
        self, z: np.ndarray, tangent: np.ndarray, cycle: Cycle, matrix: np.ndarray, corrections: int
    ) -> LocusPoint | None:
        """Point of a curve of grazings, extrapolated from cycles that miss the stop by `CLEARANCES`."""
        at_edge = [i for i in (z.size - 2, z.size - 1) if abs(z[i] - 0.5) >= 0.5 - EDGE_ROUNDING]
        normal = np.eye(z.size)[at_edge[0]] if at_edge else tangent
        missing = [z]
        for clearance in CLEARANCES[1:]:
            next_z = self._missing_by(clearance, missing[-1], normal, matrix)
            if next_z is None:
                return None
            missing.append(next_z)
        located, coarser = at_zero(missing, CLEARANCES), at_zero(missing[:-1], CLEARANCES[:-1])
        derivative = at_zero([self.returns.derivative(own).ravel() for own in missing], CLEARANCES)
        derivative = derivative.reshape(z.size - 2, -1)
        multipliers = np.linalg.eigvals(derivative).astype(complex)
        multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
        further = margin(self.returns.map(z), cycle.orbit, np.sort(cycle.near_misses)[1:])
        pair, error = singular_pair(derivative - np.eye(z.size - 2)), np.abs(located - coarser)[-2:]
        return LocusPoint(z, located, tangent, corrections, error, cycle, multipliers, pair, matrix[-1, :-2], further)

    def _missing_by(
        self, clearance: float, guess: np.ndarray, normal: np.ndarray, matrix: np.ndarray
    ) -> np.ndarray | None:
        """Cycle that misses the stop by `clearance`, in the plane through a neighbour whose derivative is `matrix`."""
        defining, bordered = self.defining(clearance), np.vstack([matrix, normal])
        z, _, reason = newton(
            lambda z: np.append(residual(self.returns, defining, z), normal @ (z - guess)),
            lambda z: bordered,  # it hardly changes over so little
            guess,
            MAX_NEWTON_STEPS,
        )
        return None if reason else z

    def predicted(self, base: LocusPoint, before: LocusPoint, step: float) -> np.ndarray:
        """Guess on the tangent."""
        return along_tangent(base, step)

    def obstacle(self, base: LocusPoint, point: LocusPoint) -> str:
        if impacts_differ(base.cycle, point.cycle):
            return f"impacts per return change from {base.cycle.impacts} to {point.cycle.impacts}"
        shorter = _least_period(self.returns, point) < self.periods
        return "the nearest cycle has a shorter period" if shorter else ""

    def marks(self, base: LocusPoint, ahead: LocusPoint) -> list[Mark[LocusPoint]] | None:
        located = roots(self, base, ahead, TESTS[self.kind])
        if located is None:
            return None
        marks = [Mark(kind, point, evidence(self.kind, kind, point)) for kind, point in located]
        return [mark for mark in marks if mark.evidence]

    def where(self, point: LocusPoint) -> str:
        return self.place(point.located)

    def place(self, z: np.ndarray) -> str:
        return "(a, b) = ({:.9g}, {:.9g}) in SI".format(*self.returns.plane.values(z))


def _least_period(returns: Returns, point: LocusPoint) -> int:
    """Least divisor of the periods after which the motion returns."""
    ways = [n for n in range(1, returns.periods) if returns.periods % n == 0]
    gaps = [np.abs(point.cycle.orbit.states[n - 1] / returns.scale - point.z[:-2]).max() for n in ways]
    return min((n for n, gap in zip(ways, gaps, strict=True) if gap < SAME_STATE_DISTANCE), default=returns.periods)


# --- the first point


def _start(branch: Branch, special: Special, plane: ParameterPlane, b: float) -> tuple[_Locus, LocusPoint | None, str]:
    """Curve of a special point, its point at this b, heading for larger b, and why there is none."""
    map = plane.maps(branch.points[0].parameter, b)  # one scale for all, so that curves can be compared
    born = special.evidence == FROM_FLIP
    returns = Returns(plane, branch.periods // 2 if born else branch.periods, map.scale)
    locus = _Locus(special.kind, returns, length_scale(map, "m"), int(branch.impacts[special.index]))
    low, high = np.array([plane.a, plane.b]).T
    place = (np.array([special.parameter, b]) - low) / (high - low)
    z = np.concatenate([special.state / map.scale, place])
    up = np.eye(z.size)[-1]
    if special.kind in MULTIPLIERS:
        return locus, *near(locus, z, up, up, MAX_START_CORRECTION)
    last = np.append(
        branch.states[special.index] / map.scale, (branch.parameter[special.index] - low[0]) / (high - low)[0]
    )
    reason = "no cycle is found beside the grazing that misses the stop"
    for impacts, guess in _beside(locus, z, np.append(last, place[-1])):
        beside = replace(locus, impacts=impacts)
        point, _ = near(beside, guess, up, up, MAX_START_CORRECTION)
        if point and np.linalg.norm(point.located - z) < MAX_START_CORRECTION:
            least = _least_period(returns, point)
            if least == returns.periods:
                return beside, point, ""
            # two cycles meet in one of a part of their period, which is where both graze
            shorter = replace(
                locus, returns=replace(returns, periods=least), impacts=impacts * least // returns.periods
            )
            return shorter, *near(shorter, point.z, up, up, MAX_START_CORRECTION)
    return locus, None, reason


def _beside(locus: _Locus, z: np.ndarray, last: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Guesses of the motion that misses the stop, with its impacts: the last cycle of the branch, then aside of z."""
    yield locus.impacts, last
    for offset in START_OFFSETS:
        for direction in (*np.eye(z.size)[:-1], *-np.eye(z.size)[:-1]):
            guess = z + offset * direction
            for impacts in (locus.impacts - 1, locus.impacts):
                if NearMiss(0.0, locus.length, impacts).value(locus.returns, guess) > 0.0:  # false for NaN
                    yield impacts, guess


def _on_curve(points: list[LocusPoint], start: LocusPoint) -> bool:
    """Whether a curve passes through `start`."""
    for one, other in zip(points, points[1:], strict=False):
        length = float(np.linalg.norm(other.z - one.z))
        if length == 0.0 or (one.z[-1] - start.z[-1]) * (other.z[-1] - start.z[-1]) > 0.0:
            continue
        between = CubicHermiteSpline([0.0, length], [one.z, other.z], [one.tangent, other.tangent])
        ends = one.z[-1] - start.z[-1], other.z[-1] - start.z[-1]
        at = (
            0.0
            if ends[0] == 0.0
            else length
            if ends[1] == 0.0
            else brentq(lambda s, between=between: between(s)[-1] - start.z[-1], 0.0, length)
        )
        if np.linalg.norm(between(at) - start.z) < SAME_CURVE_DISTANCE:
            return True
    return False


# --- both ways


def _both_ways(
    locus: _Locus, start: LocusPoint | None, special: Special, branch: Branch, reason: str, most: int
) -> tuple[list[LocusPoint], BifurcationCurve]:
    """Points of the curve through `start`, and the curve that they make."""
    if start is None:
        why = f"its first point is not found: {reason}"
        return [], _curve(locus, special, branch, [], [], (why, why))
    onward, specials_onward, last = _one_way(locus, start, most)
    if last == CLOSED:
        return onward, _curve(locus, special, branch, onward, specials_onward, (CLOSED, CLOSED))
    back, specials_back, first = _one_way(locus, start._replace(tangent=-start.tangent), most)
    shift = len(back) - 1
    specials = [replace(point, index=shift - point.index) for point in specials_back[::-1]]
    specials += [replace(point, index=shift + point.index) for point in specials_onward]
    points = [*(point._replace(tangent=-point.tangent) for point in back[:0:-1]), *onward]
    return points, _curve(locus, special, branch, points, specials, (first, last))


def _one_way(locus: _Locus, start: LocusPoint, most: int) -> tuple[list[LocusPoint], list[CodimensionTwo], str]:
    """Points from `start` on along its tangent, those of codimension two among them, and why they end."""
    made: OneWay[LocusPoint] = run(locus, start, most)
    points = made.points
    specials = [
        _codimension_two(locus, mark.kind, mark.point.located, index, TEST_FUNCTIONS[mark.kind], mark.evidence)
        for index, mark in made.marks
    ]
    if not made.lost:
        return points, specials, made.reason
    z = extrapolated([point.located for point in points], [point.margin for point in points])
    cycle, at = points[-1].cycle, locus.where(points[-1])
    if z is None:
        return points, specials, f"lost at {at}: {made.reason}{section_hint(cycle)}"
    kind = AT_GRAZING[locus.kind]
    numbers = f"the last cycle before, at {at}, has a margin of {points[-1].margin:.2g} to grazing; {made.reason}"
    end = _codimension_two(locus, kind, z, len(points) - 1, CLEARANCE_OR_SPEED, numbers)
    return points, [*specials, end], f"{kind} at {locus.place(z)}"


def _codimension_two(locus: _Locus, kind: str, z: np.ndarray, index: int, test: str, evidence: str) -> CodimensionTwo:
    a, b = locus.returns.plane.values(z)
    return CodimensionTwo(kind, a, b, locus.returns.state(z), index, test, evidence)


def _curve(
    locus: _Locus,
    special: Special,
    branch: Branch,
    points: list[LocusPoint],
    specials: list[CodimensionTwo],
    ends: tuple[str, str],
) -> BifurcationCurve:
    size, plane = locus.returns.scale.size, locus.returns.plane
    values = np.array([plane.values(point.located) for point in points]).reshape(-1, 2)
    errors = np.array([point.error * plane.widths() for point in points]).reshape(-1, 2)
    every = oriented(points)
    return BifurcationCurve(
        kind=locus.kind,
        periods=locus.periods,
        start=special.parameter,
        names=branch.names,
        units=branch.units,
        a=values[:, 0],
        b=values[:, 1],
        errors=errors.T,
        states=np.array([locus.returns.state(point.located) for point in points]).reshape(-1, size),
        multipliers=np.array([point.multipliers for point in points], dtype=complex).reshape(-1, size),
        bounding=np.array(
            [np.abs(others(locus.kind, point.multipliers)).max(initial=0.0) < 1.0 for point in points], dtype=bool
        ),
        impacts=np.array([point.cycle.impacts for point in points], dtype=int),
        tests={kind: np.array([test(point, point) for point in every]) for kind, test in TESTS[locus.kind].items()},
        points=tuple(specials),
        ends=ends,
    )
