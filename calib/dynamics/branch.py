"""Branches: a cycle followed through one parameter by pseudo-arclength continuation.

The unknowns z = (state / scale, (parameter - low) / (high - low)) run along the curve P^n(x; p) = x.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr

from calib.dynamics.arclength import CLOSED, CurvePoint, Mark, OneWay, Test, along_tangent, root, roots, run
from calib.dynamics.grazing import extrapolated, impacts_differ, section_hint
from calib.dynamics.orbits import SAME_STATE_DISTANCE, Cycle, checked_guess, cycle_at, reduced, shoot
from calib.dynamics.tangent import jacobian
from calib.errors import CalibError
from calib.modelling.orbit import PeriodMap
from calib.records import OK

MAPS_KEPT = 8  # at the latest values of the parameter: to make one costs more than its orbit of one period
PARAMETER_DIFFERENCE = 1e-7  # of the window, for the derivative; below MIN_ARCLENGTH_STEP, to stay off a grazing

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
    extent: float = 1.0,
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
    extent : size of the motions, in units of the map's scale: steps along the curve are relative to it

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
    maps = lru_cache(MAPS_KEPT)(maps)
    map = maps(parameter)
    cycle = reduced(map, shoot(map, checked_guess(map, guess, periods), periods))
    if not cycle.converged:
        return _branch(map, cycle.periods, [], [], (cycle.reason, cycle.reason))
    curve = _Curve(maps, low, high, cycle.periods, extent * map.scale)
    z = np.append(cycle.state / curve.scale, (parameter - low) / (high - low))
    start = curve.point(z, cycle.steps, np.eye(z.size)[-1])
    if start is None:
        why = "the derivative by the parameter is not known: the motion fails beside the parameter"
        return _branch(map, cycle.periods, [], [], (why, why))
    onward, specials_onward, last = _one_way(curve, start, most)
    if last == CLOSED:
        return _branch(map, cycle.periods, onward, specials_onward, (CLOSED, CLOSED))
    back, specials_back, first = _one_way(curve, start._replace(tangent=-start.tangent), most)
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

    @property
    def corrections(self) -> int:
        return len(self.cycle.steps) - 1

    @property
    def multipliers(self) -> np.ndarray:
        return self.cycle.multipliers


@dataclass(frozen=True)
class _Curve:
    """The curve P^periods(x; p) = x in the unknowns z, as `calib.dynamics.arclength.SolutionCurve`."""

    maps: Callable[[float], PeriodMap]
    low: float
    high: float
    periods: int
    scale: np.ndarray
    parameters: int = 1

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

    def predicted(self, base: _CurvePoint, before: _CurvePoint, step: float) -> np.ndarray:
        """Guess on the tangent: beside a cycle of half the period a curve bends sharply."""
        return along_tangent(base, step)

    def obstacle(self, base: _CurvePoint, point: _CurvePoint) -> str:
        if impacts_differ(base.cycle, point.cycle):
            return f"impacts per return change from {base.cycle.impacts} to {point.cycle.impacts}"
        return "the nearest cycle has a shorter period" if self.shorter(point) else ""

    def marks(self, base: _CurvePoint, ahead: _CurvePoint) -> list[Mark[_CurvePoint]] | None:
        if self.periods % 2 == 0 and self.opening(ahead, base) < 0.0:
            birth = root(self, base, ahead, self.opening)
            return None if birth is None else [Mark("flip", birth, FROM_FLIP, last=True)]
        located = roots(self, base, ahead, TESTS)
        if located is None:
            return None
        marks = [Mark(kind, point, evidence(kind, point)) for kind, point in located]
        return [mark for mark in marks if mark.evidence]

    def where(self, point: _CurvePoint) -> str:
        return f"{point.parameter:g}"


def _one_way(curve: _Curve, start: _CurvePoint, most: int) -> tuple[list[_CurvePoint], list[Special], str]:
    """Points from `start` on along its tangent, special points among them, and why they end."""
    made: OneWay[_CurvePoint] = run(curve, start, most)
    specials = [
        Special(mark.kind, mark.point.parameter, mark.point.cycle.state, index, mark.evidence)
        for index, mark in made.marks
    ]
    return _ended(curve, made.points, specials, made.reason) if made.lost else (made.points, specials, made.reason)


# --- special points


class StabilityPoint(CurvePoint, Protocol):
    """A cycle on a curve over one parameter.

    Attributes
    ----------
    multipliers : (m,) complex Floquet multipliers
    matrix : (d - 1, d) derivative of the equations
    """

    @property
    def multipliers(self) -> np.ndarray:
        """Floquet multipliers (m,)."""
        ...

    @property
    def matrix(self) -> np.ndarray:
        """Derivative of the equations (d - 1, d)."""
        ...


def _fold(point: StabilityPoint, _: StabilityPoint) -> float:
    return float(point.tangent[-1])


def _branching(point: StabilityPoint, base: StabilityPoint) -> float:
    """Determinant of the matrix with the tangent at `base`, over its modulus there: of many unknowns it overflows."""
    own, reference = (np.linalg.slogdet(np.vstack([one.matrix, base.tangent])) for one in (point, base))
    return float(own.sign * np.exp(own.logabsdet - (reference.logabsdet if reference.sign else 0.0)))


def _flip(point: StabilityPoint, _: StabilityPoint) -> float:
    return float(np.prod(point.multipliers + 1.0).real)


def _neimark_sacker(point: StabilityPoint, _: StabilityPoint) -> float:
    pairs = itertools.combinations(point.multipliers, 2)
    return float(np.prod([one * other - 1.0 for one, other in pairs]).real)


TESTS: dict[str, Test[StabilityPoint]] = {
    "fold": _fold,
    "branching": _branching,
    "flip": _flip,
    "Neimark-Sacker": _neimark_sacker,
}


def evidence(kind: str, point: StabilityPoint) -> str:
    """Evidence of a special point; empty at a neutral saddle, where two real multipliers have the product 1."""
    if kind != "Neimark-Sacker":
        nearest = point.multipliers[np.argmin(np.abs(point.multipliers - (-1.0 if kind == "flip" else 1.0)))]
        return f"a multiplier is {nearest.real:.6f}"
    pairs = itertools.combinations(point.multipliers, 2)
    one, _ = min(pairs, key=lambda pair: abs(pair[0] * pair[1] - 1.0))
    turned = abs(np.angle(one)) / (2.0 * math.pi)
    return f"a pair of modulus {abs(one):.6f} turns by {turned:.6f} of a circle per return" if one.imag else ""


def _ended(
    curve: _Curve, points: list[_CurvePoint], specials: list[Special], reason: str
) -> tuple[list[_CurvePoint], list[Special], str]:
    """Points, special points and reason of the end of a curve: grazing where its margin goes to zero."""
    cycle = points[-1].cycle
    at = f"{points[-1].parameter:.9g}"
    z = extrapolated([point.z for point in points], [point.cycle.margin for point in points])
    if z is not None:
        evidence = f"the last cycle before, at {at}, has its nearest miss at {cycle.nearest:.3g} m, its slowest impact "
        evidence += f"at {cycle.slowest:.3g} m/s; {reason}"
        grazing = Special("grazing", curve.parameter(z), z[:-1] * curve.scale, len(points) - 1, evidence)
        return points, [*specials, grazing], f"grazing at {grazing.parameter:.9g}"
    return points, specials, f"lost at {at}: {reason}{section_hint(cycle)}"


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
