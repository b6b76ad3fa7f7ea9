"""The profile of the likelihood over two parameters, on a grid about the best point."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.confidence.constrained import ConstrainedFit, FittedPoint
from calib.confidence.derivatives import Evaluate
from calib.confidence.lockstep import lockstep
from calib.confidence.profile import CROSSED, Centre, SideEnd

NODES_PER_SIDE = 4  # of the grid, beside the best point  [count]
NODES = (2 * NODES_PER_SIDE + 1) ** 2 - 1  # of the grid, without the best point  [count]
GRID_OVER_INTERVAL = 1.35  # half width of the grid over that of the interval  [1]: the joint region is wider by 1.27

Node = tuple[int, int]  # of the grid, counted from the best point


@dataclass(frozen=True, eq=False)
class Pair:
    """A grid over two parameters.

    Attributes
    ----------
    centre : the best point
    axes : of the two parameters
    positions : (2, n) of the nodes along each, in the unit cube; the best point is the middle one
    """

    centre: Centre
    axes: tuple[int, int]
    positions: np.ndarray

    @classmethod
    def about(cls, centre: Centre, axes: tuple[int, int], ends: Sequence[tuple[SideEnd, SideEnd]]) -> "Pair":
        """Grid over the intervals of two parameters, that end at `ends` (low, high) each, and somewhat beyond."""
        rows = []
        for axis, (low, high) in zip(axes, ends, strict=True):
            x = float(centre.u[axis])
            below, above = (_reach(end) for end in (low, high))
            side = np.arange(1, NODES_PER_SIDE + 1) / NODES_PER_SIDE
            rows.append(np.concatenate([x - below * side[::-1], [x], x + above * side]))
        return cls(centre, axes, np.clip(rows, 0.0, 1.0))

    def ratio(self, node: Node, point: FittedPoint) -> float:
        """Likelihood ratio at a node."""
        if node == (0, 0):
            return 0.0
        shift = np.array([self._position(k, node[k]) - self.centre.u[axis] for k, axis in enumerate(self.axes)])
        return self.centre.likelihood.ratio(point.square, self.axes, shift) if shift.any() else 0.0

    def fitted(
        self,
        evaluate: Evaluate,
        fit: Callable[[Evaluate], ConstrainedFit],
        known: Mapping[Node, FittedPoint],
        on_point: Callable[[Node, FittedPoint], None],
    ) -> dict[Node, FittedPoint]:
        """Fit the other parameters at every node: the middle column first, then each row outwards from it.

        Parameters
        ----------
        evaluate : points (n, dim) -> n outcomes
        fit : of an evaluation
        known : nodes of an earlier run
        on_point : called with each further node
        """  # fmt: skip
        points = dict(known)
        centre = FittedPoint(tuple(self.centre.u.tolist()), self.centre.likelihood.square, 0.0, self.centre.kind)
        points[0, 0] = centre
        span = range(1, NODES_PER_SIDE + 1)

        def chain(nodes: Sequence[Node]) -> Callable[[Evaluate], None]:
            def follow(own: Evaluate) -> None:
                for before, node in zip(nodes, nodes[1:], strict=False):
                    if node not in points:
                        earlier = nodes[max(nodes.index(before) - 1, 0)]
                        points[node] = fit(own)(self._starts(node, before, earlier, points), self._free)
                        on_point(node, points[node])

            return follow

        lockstep(evaluate, [chain([(0, 0), *((0, sign * k) for k in span)]) for sign in (-1, 1)])
        rows = range(-NODES_PER_SIDE, NODES_PER_SIDE + 1)
        lockstep(evaluate, [chain([(0, row), *((sign * k, row) for k in span)]) for row in rows for sign in (-1, 1)])
        return points

    @property
    def _free(self) -> np.ndarray:
        return ~np.isin(np.arange(self.centre.u.size), self.axes)

    def _position(self, k: int, number: int) -> float:
        return float(self.positions[k, NODES_PER_SIDE + number])

    def _starts(self, node: Node, before: Node, earlier: Node, points: Mapping[Node, FittedPoint]) -> list[np.ndarray]:
        """Points from which the others are fitted at a node: continued from the two before, and from the best point."""
        centre, likelihood = self.centre.u, self.centre.likelihood
        held = np.array([self._position(k, node[k]) for k in range(2)])
        guesses = []
        usable = math.isfinite(points[before].square)
        if usable:
            first, second = np.array(points[before].u), np.array(points[earlier].u)
            guesses.append(first)
            own = list(self.axes)
            length = float(np.linalg.norm(first[own] - second[own]))
            if math.isfinite(points[earlier].square) and length > 0.0:
                guesses.append(first + (first - second) * np.linalg.norm(held - first[own]) / length)
        if likelihood.differentiable:
            unit = likelihood.unit_covariance
            along = unit[:, self.axes] @ np.linalg.inv(unit[np.ix_(self.axes, self.axes)])
            guesses.append(centre + along @ (held - centre[list(self.axes)]))
        else:
            guesses.append(centre)
        starts = [np.clip(guess, 0.0, 1.0) for guess in guesses]
        for start in starts:
            start[list(self.axes)] = held
        return starts


def _reach(end: SideEnd) -> float:
    """Half width of the grid on one side; no further than where the motion can still be compared."""
    return end.distance * (GRID_OVER_INTERVAL if end.cause == CROSSED else 1.0)
