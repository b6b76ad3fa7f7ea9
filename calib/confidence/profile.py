"""One side of the profile of the likelihood over a parameter: outwards from the best point, to where it ends.

At each value of the parameter the others are fitted again, by continuation from the values before. The next value
depends on nothing but the points so far: a profile that was interrupted goes on from them as if it had not been.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.confidence.constrained import MIN_EDGE_DISTANCE, ConstrainedFit, FittedPoint
from calib.confidence.likelihood import AdjustedLikelihood

FIRST_STEP = 0.35  # of the half width of the local interval  [1]
MAX_ROOT_STEP = 0.35  # of the root of the quantile, between two points outwards  [1]
MAX_STEP_GROWTH, MIN_STEP_GROWTH = 2.0, 0.2  # of a step outwards over the one before  [1]
OVERSHOOT = 1.05  # of the root of the quantile, at which a step is aimed that crosses it  [1]
MAX_ROOT_ERROR = 0.01  # of the root of the quantile: a point nearer to it locates the crossing by interpolation  [1]
MAX_BRACKET = 0.005  # of the distance from the best point: narrower brackets locate the crossing  [1]
BRACKET_MARGIN = 0.1  # of a bracket: a trial value stays away from its ends by it  [1]
SECANT_TRIALS = 4  # values in a bracket by interpolation, before it is bisected  [count]
WINDOW_SNAP = 0.1  # of a step: a value nearer to the end of the window goes to the end  [1]
DEFAULT_HALF_WIDTH = 0.1  # of the window: assumed where there is no local interval  [1]
MAX_LOCAL_HALF_WIDTH = 0.5  # of the window: assumed of wider local intervals  [1]
MAX_POINTS = 60  # of one side  [count]
ACCURACY = 2e-3  # of the quantile, to which the likelihood ratio of a point is fitted  [1]

CROSSED = "crossed"
WINDOW_END = "window end"
NO_MOTION = "no comparable motion"
JUMP = "jump"
NOT_LOCATED = "not located"


@dataclass(frozen=True, eq=False)
class Centre:
    """Where a profile begins.

    Attributes
    ----------
    u : (dim,) the best point, in the unit cube
    likelihood : about it
    kind : of its motion
    """

    u: np.ndarray
    likelihood: AdjustedLikelihood
    kind: str | None


@dataclass(frozen=True)
class SideEnd:
    """Where one side of a profile ends.

    Attributes
    ----------
    cause : CROSSED (the likelihood ratio reaches the quantile), WINDOW_END (it does not before the window's end),
        NO_MOTION (no motion beyond can be compared with the measurement), JUMP (it jumps over the quantile) or
        NOT_LOCATED (it took too many points)
    distance : from the best point, in the unit cube
    kinds : kinds of motion on the near and the far side
    reason : why a motion beyond cannot be compared; "" elsewhere
    """

    cause: str
    distance: float
    kinds: tuple[str | None, str | None]
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Side:
    """One side of the profile over one parameter.

    Attributes
    ----------
    centre : where it begins
    axis : of the parameter
    sign : -1.0 towards the low end of the window, 1.0 towards the high one
    """

    centre: Centre
    axis: int
    sign: float

    @property
    def limit(self) -> float:
        """Distance of the window's end."""
        x = self.centre.u[self.axis]
        return float(1.0 - x if self.sign > 0.0 else x)

    @property
    def target(self) -> float:
        """Root of the likelihood ratio at which the interval ends."""
        return math.sqrt(self.centre.likelihood.quantile([self.axis]))

    @property
    def half_width(self) -> float:
        """Half width of the local interval, within bounds; in the unit cube."""
        likelihood = self.centre.likelihood
        if not likelihood.differentiable:
            return DEFAULT_HALF_WIDTH
        return float(min(self.target * likelihood.standard_error[self.axis], MAX_LOCAL_HALF_WIDTH))

    def distance(self, point: FittedPoint) -> float:
        """Distance of a point from the best one along the parameter."""
        return abs(point.u[self.axis] - float(self.centre.u[self.axis]))

    def root(self, point: FittedPoint) -> float:
        """Root of the likelihood ratio of a point; infinite where it cannot be compared."""
        ratio = self.centre.likelihood.ratio(point.square, [self.axis], np.array([self.distance(point)]))
        return math.sqrt(max(ratio, 0.0))

    def next(self, points: Sequence[FittedPoint]) -> float | SideEnd:
        """Distance of the next value from the best point, or the end."""
        if self.limit <= MIN_EDGE_DISTANCE:
            return SideEnd(WINDOW_END, self.limit, (self.centre.kind, self.centre.kind))
        near, far = self._bracket(points)
        if len(points) >= MAX_POINTS:
            return self._end(NOT_LOCATED, near, far)
        return self._outwards(points, near) if far is None else self._within(points, near, far)

    def _bracket(self, points: Sequence[FittedPoint]) -> tuple[FittedPoint | None, FittedPoint | None]:
        """The last point before the first crossing, None for the centre; and the one behind it, None without one."""
        beyond = [point for point in points if self.root(point) >= self.target]
        far = min(beyond, key=self.distance, default=None)
        before = [p for p in points if far is None or self.distance(p) < self.distance(far)]
        return max(before, key=self.distance, default=None), far

    def _outwards(self, points: Sequence[FittedPoint], near: FittedPoint | None) -> float | SideEnd:
        if near is None:
            return min(FIRST_STEP * self.half_width, self.limit)
        at, root = self.distance(near), self.root(near)
        if at >= self.limit * (1.0 - 1e-12):
            return self._end(WINDOW_END, near, near)
        earlier = [(self.distance(p), self.root(p)) for p in points if self.distance(p) < at]
        before, root_before = max(earlier, default=(0.0, 0.0))
        last = at - before
        slope = (root - root_before) / last
        step = MAX_STEP_GROWTH * last
        if slope > 0.0:
            step = min(step, min(OVERSHOOT * self.target - root, MAX_ROOT_STEP * self.target) / slope)
        step = max(step, MIN_STEP_GROWTH * last)
        return self.limit if at + (1.0 + WINDOW_SNAP) * step >= self.limit else at + step

    def _within(self, points: Sequence[FittedPoint], near: FittedPoint | None, far: FittedPoint) -> float | SideEnd:
        """Next value between a point inside and one outside, or the end."""
        low, high = 0.0 if near is None else self.distance(near), self.distance(far)
        root_low, root_high = 0.0 if near is None else self.root(near), self.root(far)
        if min(self.target - root_low, root_high - self.target) <= MAX_ROOT_ERROR * self.target and not math.isinf(
            root_high
        ):
            return self._end(CROSSED, near, far)
        if high - low <= MAX_BRACKET * high:
            if math.isinf(root_high):
                return self._end(NO_MOTION, near, far)
            steep = root_high - root_low > MAX_ROOT_STEP * self.target
            return self._end(JUMP if steep else CROSSED, near, far)
        if math.isinf(root_high) or self._refinements(points) > SECANT_TRIALS:
            return 0.5 * (low + high)
        share = (self.target - root_low) / (root_high - root_low)
        return low + (high - low) * min(max(share, BRACKET_MARGIN), 1.0 - BRACKET_MARGIN)

    def _refinements(self, points: Sequence[FittedPoint]) -> int:
        """Number of points since the first one outside."""
        outside = [self.root(point) >= self.target for point in points]
        return len(points) - 1 - outside.index(True)

    def _end(self, cause: str, near: FittedPoint | None, far: FittedPoint | None) -> SideEnd:
        low = 0.0 if near is None else self.distance(near)
        kinds = self.centre.kind if near is None else near.kind, None if far is None else far.kind
        if cause == CROSSED and far is not None:
            root_low, root_high = 0.0 if near is None else self.root(near), self.root(far)
            share = (self.target - root_low) / (root_high - root_low)
            return SideEnd(cause, low + share * (self.distance(far) - low), kinds)
        return SideEnd(cause, low, kinds, "" if far is None else far.reason)

    def starts(self, points: Sequence[FittedPoint], distance: float) -> list[np.ndarray]:
        """Points (dim,) at a distance from which the others are fitted: extrapolated, and as at the nearest value."""
        centre, likelihood = self.centre.u, self.centre.likelihood
        known = [(self.distance(p), np.array(p.u)) for p in points if math.isfinite(p.square)]
        known = sorted([(0.0, centre), *known], key=lambda one: abs(one[0] - distance))
        nearest = known[0][1]
        if len(known) > 1:
            (one, first), (two, second) = known[:2]
            along = (second - first) / (two - one)
            guess = first + (distance - one) * along
        elif likelihood.differentiable:
            along = likelihood.unit_covariance[:, self.axis] / likelihood.unit_covariance[self.axis, self.axis]
            guess = centre + self.sign * distance * along
        else:
            guess = nearest
        starts = [np.clip(guess, 0.0, 1.0), nearest.copy()]
        for start in starts:
            start[self.axis] = self.position(distance)
        return starts

    def position(self, distance: float) -> float:
        """Position in the window at a distance; the end of the window exactly."""
        if distance >= self.limit:
            return 1.0 if self.sign > 0.0 else 0.0
        return float(self.centre.u[self.axis]) + self.sign * distance


def profile_side(
    side: Side, fit: ConstrainedFit, known: Sequence[FittedPoint], on_point: Callable[[int, FittedPoint], None]
) -> tuple[tuple[FittedPoint, ...], SideEnd]:
    """Follow one side of a profile to its end.

    Parameters
    ----------
    known : points of an earlier run, in their order
    on_point : called with the number and the point, where it was not known
    """
    points = list(known)
    free = np.arange(side.centre.u.size) != side.axis
    while not isinstance(following := side.next(points), SideEnd):
        point = fit(side.starts(points, following), free)
        on_point(len(points), point)
        points.append(point)
    return tuple(points), following


def fit_accuracy(likelihood: AdjustedLikelihood, axis: int) -> float:
    """Accuracy of the least sum of squares that a profile over an axis needs."""
    return ACCURACY * likelihood.quantile([axis]) / likelihood.factor([axis], np.ones(1))
