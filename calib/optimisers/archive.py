"""The points evaluated so far with their costs, in the order of evaluation."""

from collections.abc import Sequence

import numpy as np


class Archive:
    """Points (n, dim) and costs (n,), inf for a failed run; it only grows."""

    def __init__(self, dim: int):
        self._points, self._costs, self._size = np.empty((64, dim)), np.empty(64), 0

    @property
    def points(self) -> np.ndarray:
        """All points (n, dim)."""
        return self._points[: self._size]

    @property
    def costs(self) -> np.ndarray:
        """All costs (n,)."""
        return self._costs[: self._size]

    def add(self, points: np.ndarray, costs: Sequence[float]) -> None:
        """Append points (n, dim) with costs (n,)."""
        while self._size + len(points) > len(self._costs):
            self._points = np.concatenate([self._points, np.empty_like(self._points)])
            self._costs = np.concatenate([self._costs, np.empty_like(self._costs)])
        new = slice(self._size, self._size + len(points))
        self._points[new], self._costs[new] = points, costs
        self._size = new.stop

    def near(self, u: np.ndarray, reach: float, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (n, dim) from u and costs (n,) of at most `most` points that did not fail, nearest first.

        Nearness is in the maximum norm; the point u itself is left out.
        """
        offsets = self.points - u
        distance = np.abs(offsets).max(axis=1)
        wanted = np.flatnonzero((distance > 0) & (distance <= reach) & np.isfinite(self.costs))
        wanted = wanted[np.argsort(distance[wanted], kind="stable")[:most]]
        return offsets[wanted], self.costs[wanted]
