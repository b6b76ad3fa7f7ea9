"""Branches: a cycle followed through one parameter by pseudo-arclength continuation.

The unknowns z = (state / scale, (parameter - low) / (high - low)) run along the curve P^n(x; p) = x. From a point with
the unit tangent t the next is sought at t . (z - guess) = 0 with the guess a step ahead (Keller 1977).
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from calib.dynamics.orbits import SAME_STATE_DISTANCE, Cycle, checked_guess, cycle_at, newton, reduced, shoot
from calib.dynamics.tangent import jacobian
from calib.errors import CalibError
from calib.modelling.orbit import PeriodMap
from calib.records import OK

FIRST_ARCLENGTH_STEP = 0.01  # along the curve, in scaled coordinates z
MAX_ARCLENGTH_STEP = 0.05  # the same
MIN_ARCLENGTH_STEP = 1e-6  # the same; a curve that cannot be followed with it ends
PARAMETER_DIFFERENCE = 1e-7  # of the window, for the derivative; below MIN_ARCLENGTH_STEP, to stay off a grazing
MAX_QUICK_CORRECTIONS = 3  # of the corrector; after no more the step along the curve is lengthened
MAX_NEWTON_STEPS = 8  # of the corrector
MIN_TANGENT_COSINE = 0.95  # between neighbouring tangents
ARCLENGTH_TOLERANCE = 1e-11  # of the position of a special point along the curve
MAX_TEST_AT_ROOT = 1e-2  # value of a test function at its root over that at the step's end; above it it has jumped
MAX_GRAZING_MARGIN = 1e-2  # margin and distance along the curve up to which a curve is extrapolated to grazing
SECTION_MARGIN = 1e-3  # periods: distance of an impact from the section that explains an end

CLOSED = "the branch closes on itself"
FROM_FLIP = "it comes out of a flip of the cycle of half its period"


@dataclass(frozen=True, eq=False)
class Special:
    """A point of a branch at which the motion changes.

    Attributes
    ----------
    kind : "fold", "branching", "flip", "Neimark-Sacker" or "grazing"
    parameter : its value there; state (dimension,), each component in its unit
    index : position in the branch's arrays; a grazing, which is no point of theirs, has that of the last cycle before
    evidence : one sentence with the numbers
    """

    kind: str
    parameter: float
    state: np.ndarray
    index: int
    evidence: str


@dataclass(frozen=True)
class Branch:
    """Cycles of one family in the order of the curve; m of them, special points among them.

    Attributes
    ----------
    periods : of one return
    bodies, names, units : of the map: bodies, components of the state and their units
    parameter : (m,)
    displacement, velocity : (body, periods, m) at the sections of one return  [m], [m/s]
    states : (m, dimension) each component in its unit
    multipliers : (m, dimension) complex, by falling modulus
    stable : (m,) whether all multipliers are within the unit circle
    impacts : (m,) number per return
    slowest : (m,) least closing speed, inf without impacts  [m/s]
    nearest : (m,) least clearance that an impact was missed by, inf without  [m]
    points : the special points in the order of the curve
    ends : why the curve ends before its first and after its last point
    """

    periods: int
    bodies: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    parameter: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    states: np.ndarray
    multipliers: np.ndarray
    stable: np.ndarray
    impacts: np.ndarray
    slowest: np.ndarray
    nearest: np.ndarray
    points: tuple[Special, ...]
    ends: tuple[str, str]

    def dataset(self, name: str, unit: str) -> xr.Dataset:
        """Return the branch as a Dataset; `name` [unit] is what has varied.

        Its dimensions are body, cycle (of one return), step (along the curve), component, multiplier and special.
        """
        rows = {
            "displacement": (("body", "cycle", "step"), self.displacement, {"units": "m"}),
            "velocity": (("body", "cycle", "step"), self.velocity, {"units": "m/s"}),
            "state": (("step", "component"), self.states, {"units": "that of the component"}),
            "multiplier_modulus": (("step", "multiplier"), np.abs(self.multipliers), {"units": "1"}),
            "multiplier_angle": (("step", "multiplier"), np.angle(self.multipliers), {"units": "rad"}),
            "stable": ("step", self.stable),
            "impacts": ("step", self.impacts, {"units": "1"}),
            "slowest_impact": ("step", self.slowest, {"units": "m/s"}),
            "nearest_miss": ("step", self.nearest, {"units": "m"}),
            "special_kind": ("special", np.array([point.kind for point in self.points], dtype=str)),
            "special_parameter": ("special", np.array([point.parameter for point in self.points]), {"units": unit}),
            "special_index": ("special", np.array([point.index for point in self.points], dtype=int)),
            "special_evidence": ("special", np.array([point.evidence for point in self.points], dtype=str)),
        }
        return xr.Dataset(
            rows,
            coords={
                "parameter": ("step", self.parameter, {"units": unit, "name": name}),
                "body": list(self.bodies),
                "component": list(self.names),
                "component_unit": ("component", list(self.units)),
            },
            attrs={"periods": self.periods, "first_end": self.ends[0], "last_end": self.ends[1]},
        )


def follow(
    maps: Callable[[float], PeriodMap],
    guess: np.ndarray,
    parameter: float,
    window: tuple[float, float],
    periods: int = 1,
    most: int = 400,
) -> Branch:
    """Follow the cycle near `guess` from `parameter` both ways, through folds, as far as `window` and the motion allow.

    A cycle whose least period divides `periods` is followed with that period. A branch ends at an edge of the window,
    where an impact grazes, where it comes out of a flip of the cycle of half its period, on itself, or after `most`
    points one way. Without a cycle at `parameter` it has no points, and both ends say why.

    Parameters
    ----------
    maps : the map at a value of the parameter, in the parameter's unit
    guess : (dimension,) state near a cycle at `parameter`, each component in its unit
    window : lowest and highest value of the parameter

    Raises
    ------
    CalibError : a window without width or without `parameter`, a guess that is no state, or a motion without a period
    """
    if periods < 1:
        raise CalibError(
            f"a branch consists of periodic motions, got the period {periods} at {parameter:g}, which stands for a "
            "motion that does not return; begin at another value, or from a state on a periodic motion"
        )
    low, high = window
    if not np.isfinite([low, high]).all() or not low < high or not low <= parameter <= high:
        raise CalibError(
            f"expected a parameter in a window [low, high] of some width, got {parameter:g} in [{low:g}, {high:g}]"
        )
    map = maps(parameter)
    cycle = reduced(map, shoot(map, checked_guess(map, guess, periods), periods))
    if not cycle.converged:
        return _branch(map, cycle.periods, [], [], (cycle.reason, cycle.reason))
    curve = _Curve(maps, low, high, cycle.periods, map.scale)
    z = np.append(cycle.state / map.scale, (parameter - low) / (high - low))
    start = curve.point(z, cycle.steps, np.eye(z.size)[-1])
    if start is None:
        why = "the derivative by the parameter is not known: the motion fails beside the parameter"
        return _branch(map, cycle.periods, [], [], (why, why))
    onward, specials_onward, last = _run(curve, start, most)
    if last == CLOSED:
        return _branch(map, cycle.periods, onward, specials_onward, (CLOSED, CLOSED))
    back, specials_back, first = _run(curve, start._replace(tangent=-start.tangent), most)
    shift = len(back) - 1
    specials = [replace(special, index=shift - special.index) for special in specials_back[::-1]]
    specials += [replace(special, index=shift + special.index) for special in specials_onward]
    return _branch(map, cycle.periods, [*back[:0:-1], *onward], specials, (first, last))


class _CurvePoint(NamedTuple):
    """Point z (dimension + 1,) of the curve, unit tangent there, cycle and derivative (dimension, dimension + 1)."""

    z: np.ndarray
    parameter: float
    tangent: np.ndarray
    cycle: Cycle
    matrix: np.ndarray


@dataclass(frozen=True)
class _Curve:
    """The curve P^periods(x; p) = x in the unknowns z."""

    maps: Callable[[float], PeriodMap]
    low: float
    high: float
    periods: int
    scale: np.ndarray

    def parameter(self, z: np.ndarray) -> float:
        return (1.0 - z[-1]) * self.low + z[-1] * self.high  # exact at both edges

    def residual(self, z: np.ndarray) -> np.ndarray:
        if not 0.0 <= z[-1] <= 1.0:
            return np.full(z.size - 1, np.nan)
        orbit = self.maps(self.parameter(z)).orbit(z[:-1] * self.scale, self.periods)
        return orbit.states[-1] / self.scale - z[:-1] if orbit.status == OK else np.full(z.size - 1, np.nan)

    def derivative(self, z: np.ndarray) -> np.ndarray:
        map = self.maps(self.parameter(z))
        _, own = jacobian(map, z[:-1] * self.scale, self.periods)
        ratio = map.scale / self.scale  # a map's scale may change with the parameter
        by_state = own * ratio[:, None] / ratio - np.eye(ratio.size)
        behind, ahead = max(z[-1] - PARAMETER_DIFFERENCE, 0.0), min(z[-1] + PARAMETER_DIFFERENCE, 1.0)
        change = self.residual(np.append(z[:-1], ahead)) - self.residual(np.append(z[:-1], behind))
        return np.column_stack([by_state, change / (ahead - behind)])

    def point(self, z: np.ndarray, steps: tuple[float, ...], heading: np.ndarray) -> _CurvePoint | None:
        matrix = self.derivative(z)
        if not np.isfinite(matrix).all():
            return None
        derivative = matrix[:, :-1] + np.eye(self.scale.size)
        cycle = cycle_at(self.maps(self.parameter(z)), z[:-1] * self.scale, self.periods, derivative, steps)
        tangent = np.linalg.svd(matrix)[2][-1]
        tangent = tangent if tangent @ heading >= 0.0 else -tangent
        return _CurvePoint(z, self.parameter(z), tangent, cycle, matrix)

    def opening(self, point: _CurvePoint, base: _CurvePoint) -> float:
        """Difference of the states half a return apart, along that at `base`: it changes sign at the flip."""
        halves = (p.cycle.orbit.states[self.periods // 2 - 1] / self.scale - p.z[:-1] for p in (point, base))
        return float(np.dot(*halves))

    def shorter(self, point: _CurvePoint) -> bool:
        """Whether the motion returns after a part of the periods already, as one that a long step reaches may do."""
        parts = [point.cycle.orbit.states[n - 1] for n in range(1, self.periods) if self.periods % n == 0]
        return any(np.abs(state / self.scale - point.z[:-1]).max() < SAME_STATE_DISTANCE for state in parts)

    def ahead(self, base: _CurvePoint, step: float) -> tuple[_CurvePoint | None, str]:
        """Next point, a step ahead of `base` or on the edge of the window before that; None and why without one."""
        guess, normal = base.z + step * base.tangent, base.tangent
        if not 0.0 < guess[-1] < 1.0:
            edge = np.clip(guess[-1], 0.0, 1.0)
            guess = base.z + (edge - base.z[-1]) / base.tangent[-1] * base.tangent
            guess[-1], normal = edge, np.eye(guess.size)[-1]
        point, reason = self.near(guess, normal, base.tangent, 0.5 * step)
        if point and _impacts_differ(base, point):
            return None, f"impacts per return change from {base.cycle.impacts} to {point.cycle.impacts}"
        if point and self.shorter(point):
            return None, "the nearest cycle has a shorter period"
        if point and point.tangent @ base.tangent < MIN_TANGENT_COSINE:
            return None, "the branch has a corner"
        return point, reason

    def near(
        self, guess: np.ndarray, normal: np.ndarray, heading: np.ndarray, reach: float
    ) -> tuple[_CurvePoint | None, str]:
        """Point of the curve in the plane through `guess`, within `reach` of it; None and why without one."""
        z, sizes, reason = newton(
            lambda z: np.append(self.residual(z), normal @ (z - guess)),
            lambda z: np.vstack([self.derivative(z), normal]),
            guess,
            MAX_NEWTON_STEPS,
        )
        if reason:
            return None, reason
        if np.linalg.norm(z - guess) > reach:
            return None, "the nearest cycle lies off the branch"
        point = self.point(z, sizes, heading)
        return point, "" if point else "the motion fails beside the cycle"


def _run(curve: _Curve, start: _CurvePoint, most: int) -> tuple[list[_CurvePoint], list[Special], str]:
    """Points from `start` on along its tangent, special points among them, and why they end."""
    points, specials, step = [start], list[Special](), FIRST_ARCLENGTH_STEP
    while len(points) <= most:
        base = points[-1]
        if base.z[-1] == float(base.tangent[-1] > 0.0):
            return points, specials, f"edge of the window, {base.parameter:g}"
        ahead, reason = curve.ahead(base, step)
        between = _specials_between(curve, base, ahead) if ahead else []
        if ahead is None or between is None:
            step /= 2.0
            if step < MIN_ARCLENGTH_STEP:
                return _ended(curve, points, specials, reason or "the cycles beside a special point are not found")
            continue
        for kind, point, evidence in between:
            points.append(point)
            specials.append(Special(kind, point.parameter, point.cycle.state, len(points) - 1, evidence))
            if evidence == FROM_FLIP:
                return points, specials, FROM_FLIP
        points.append(ahead)
        step = min(1.5 * step, MAX_ARCLENGTH_STEP) if len(ahead.cycle.steps) <= MAX_QUICK_CORRECTIONS + 1 else step
        to_start = start.z - ahead.z
        if np.linalg.norm(to_start) <= step and min(to_start @ ahead.tangent, start.tangent @ ahead.tangent) > 0.0:
            return [*points, start], specials, CLOSED
    return points, specials, f"{most} points are made"


def _impacts_differ(one: _CurvePoint, other: _CurvePoint) -> bool:
    """Whether an impact has come or gone; chatter, which ends in permanent contact, has no number of impacts."""
    return one.cycle.impacts != other.cycle.impacts and not (one.cycle.orbit.contact or other.cycle.orbit.contact)


# --- special points


def _fold(point: _CurvePoint, _: _CurvePoint) -> float:
    return float(point.tangent[-1])


def _branching(point: _CurvePoint, base: _CurvePoint) -> float:
    return float(np.linalg.det(np.vstack([point.matrix, base.tangent])))


def _flip(point: _CurvePoint, _: _CurvePoint) -> float:
    return float(np.prod(point.cycle.multipliers + 1.0).real)


def _neimark_sacker(point: _CurvePoint, _: _CurvePoint) -> float:
    pairs = itertools.combinations(point.cycle.multipliers, 2)
    return float(np.prod([one * other - 1.0 for one, other in pairs]).real)


TESTS = {"fold": _fold, "branching": _branching, "flip": _flip, "Neimark-Sacker": _neimark_sacker}


def _evidence(kind: str, point: _CurvePoint) -> str:
    """Evidence of a special point; empty at a neutral saddle, where two real multipliers have the product 1."""
    multipliers = point.cycle.multipliers
    if kind != "Neimark-Sacker":
        nearest = multipliers[np.argmin(np.abs(multipliers - (-1.0 if kind == "flip" else 1.0)))]
        return f"a multiplier is {nearest.real:.6f}"
    pairs = itertools.combinations(multipliers, 2)
    one, _ = min(pairs, key=lambda pair: abs(pair[0] * pair[1] - 1.0))
    turned = abs(np.angle(one)) / (2.0 * math.pi)
    return f"a pair of modulus {abs(one):.6f} turns by {turned:.6f} of a circle per return" if one.imag else ""


Test = Callable[[_CurvePoint, _CurvePoint], float]  # of a point and the one before it; it changes sign


def _specials_between(
    curve: _Curve, base: _CurvePoint, ahead: _CurvePoint
) -> list[tuple[str, _CurvePoint, str]] | None:
    """Special points between two neighbours: kind, point and evidence; None where the curve is lost between them."""
    if curve.periods % 2 == 0 and curve.opening(ahead, base) < 0.0:
        root = _root(curve, base, ahead, curve.opening)
        return None if root is None else [("flip", root, FROM_FLIP)]
    specials = []
    for kind, test in TESTS.items():
        ends = test(base, base), test(ahead, base)
        if ends[0] * ends[1] < 0.0:
            root = _root(curve, base, ahead, test)
            if root is None:
                return None
            evidence = _evidence(kind, root)
            if evidence and abs(test(root, base)) < MAX_TEST_AT_ROOT * max(map(abs, ends)):
                specials.append((kind, root, evidence))
    return sorted(specials, key=lambda entry: (entry[1].z - base.z) @ base.tangent)


def _root(curve: _Curve, base: _CurvePoint, ahead: _CurvePoint, test: Test) -> _CurvePoint | None:
    """Point between two neighbours at which `test` changes sign, by the Illinois method on the arclength."""
    low, high = 0.0, float(np.linalg.norm(ahead.z - base.z))
    # so close to the curve that Newton has little to do, which matters where its matrix is singular: at a branching
    between = CubicHermiteSpline([low, high], [base.z, ahead.z], [base.tangent, ahead.tangent])
    normal, reach = (ahead.z - base.z) / high, 0.5 * high
    at_low, at_high = test(base, base), test(ahead, base)
    point, before = None, math.inf
    for _ in range(60):
        arclength = (low * at_high - high * at_low) / (at_high - at_low)
        point, _ = curve.near(between(arclength), normal, base.tangent, reach)
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


def _ended(
    curve: _Curve, points: list[_CurvePoint], specials: list[Special], reason: str
) -> tuple[list[_CurvePoint], list[Special], str]:
    """Points, special points and reason of the end of a curve: grazing where its margin goes to zero."""
    cycle = points[-1].cycle
    at = f"{points[-1].parameter:.9g}"
    z = _grazing(points)
    if z is not None:
        evidence = f"the last cycle before, at {at}, has its nearest miss at {cycle.nearest:.3g} m, its slowest impact "
        evidence += f"at {cycle.slowest:.3g} m/s; {reason}"
        grazing = Special("grazing", curve.parameter(z), z[:-1] * curve.scale, len(points) - 1, evidence)
        return points, [*specials, grazing], f"grazing at {grazing.parameter:.9g}"
    if np.any(np.minimum(cycle.orbit.impacts[:, 1], 1.0 - cycle.orbit.impacts[:, 1]) < SECTION_MARGIN):
        reason += "; an impact comes to the section, take it at another phase of the excitation"
    return points, specials, f"lost at {at}: {reason}"


def _grazing(points: list[_CurvePoint]) -> np.ndarray | None:
    """Extrapolate the curve z to margin 0; None where it does not run there.

    Taken are three points of which each has at least twice the margin of the next: a parabola through them is good to
    the third power of the last margin, which neither rounding nor the steps that end before the grazing disturb.
    """
    chosen = [points[-1]]
    for point in reversed(points):
        if len(chosen) < 3 and point.cycle.margin >= 2.0 * chosen[-1].cycle.margin:
            chosen.append(point)
    margins = np.array([point.cycle.margin for point in chosen])
    if len(chosen) < 3 or not 0.0 < margins[0] < MAX_GRAZING_MARGIN or not np.isfinite(margins).all():
        return None
    weights = [np.prod([m / (m - own) for m in np.delete(margins, i)]) for i, own in enumerate(margins)]
    z = sum(weight * point.z for weight, point in zip(weights, chosen, strict=True))
    return z if np.linalg.norm(z - points[-1].z) < MAX_GRAZING_MARGIN else None


def _branch(
    map: PeriodMap, periods: int, points: list[_CurvePoint], specials: list[Special], ends: tuple[str, str]
) -> Branch:
    cycles = [point.cycle for point in points]
    size = map.scale.size
    at_section = np.array([(cycle.orbit.displacement, cycle.orbit.velocity) for cycle in cycles])
    at_section = at_section.reshape(-1, 2, len(map.bodies), periods)
    return Branch(
        periods=periods,
        bodies=tuple(map.bodies),
        names=tuple(map.names),
        units=tuple(map.units),
        parameter=np.array([point.parameter for point in points]),
        displacement=np.moveaxis(at_section[:, 0], 0, -1),
        velocity=np.moveaxis(at_section[:, 1], 0, -1),
        states=np.array([cycle.state for cycle in cycles]).reshape(-1, size),
        multipliers=np.array([cycle.multipliers for cycle in cycles], dtype=complex).reshape(-1, size),
        stable=np.array([cycle.stable for cycle in cycles], dtype=bool),
        impacts=np.array([cycle.impacts for cycle in cycles], dtype=int),
        slowest=np.array([cycle.slowest for cycle in cycles]),
        nearest=np.array([cycle.nearest for cycle in cycles]),
        points=tuple(specials),
        ends=ends,
    )
