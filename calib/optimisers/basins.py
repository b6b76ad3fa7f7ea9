"""The basins in which local searches have ended."""

from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from calib.optimisers.archive import Archive

SAME_POINT_DISTANCE = 0.01  # of the window: ends of searches closer than this agree in point
SAME_COST_DIFFERENCE = 0.01  # relative: ends whose costs differ less agree in cost
COST_TOLERANCE = 1e-12  # absolute, for costs about zero
MIN_SEARCHES_IN_BEST_BASIN = 3  # that have to have ended there before the study may stop  [count]


@dataclass(frozen=True)
class Basin:
    """A point where searches ended, the least of their costs, and how many ended there."""

    point: tuple[float, ...]
    cost: float
    searches: int


@dataclass(frozen=True)
class Summary:
    """Agreement of the starts: a single basin reached by all is evidence of a global minimum, a basin each is none."""

    starts: int
    agree_in_point: int
    agree_in_cost: int
    basins: tuple[Basin, ...]


class SearchEnds:
    """Where local searches have ended, grouped into basins as they come in.

    Taken by their cost (by their order, among equals), an end belongs to the first basin that it agrees with in point
    and in cost, else it founds one. An end that is added is compared with all the others; of these only such are looked
    at again whose basin it takes over.

    Parameters
    ----------
    dim : of the unit cube
    """

    def __init__(self, dim: int):
        self._ends = Archive(dim)
        self._founders = np.empty(0, dtype=int)  # (n,): the end that founded the basin of each end

    def __len__(self) -> int:
        return len(self._founders)

    @property
    def points(self) -> np.ndarray:
        """Where they ended, (n, dim)."""
        return self._ends.points

    @property
    def costs(self) -> np.ndarray:
        """Their costs, (n,)."""
        return self._ends.costs

    def add(self, point: np.ndarray, cost: float) -> None:
        """Add the end of a search at a point (dim,)."""
        new = len(self)
        self._ends.add(point[None], [cost])
        self._founders = np.append(self._founders, -1)
        pending = [(cost, new)]
        while pending:
            _, end = heappop(pending)
            before, after = self._founders[end], self._founder_of(end)
            self._founders[end] = after
            if before == after:
                continue
            affected = np.empty(0, dtype=int)
            if before == end:  # its basin is taken over: those that belonged to it find another
                affected = np.flatnonzero(self._founders == end)
            elif after == end:
                affected = np.flatnonzero(self._agree(end, later=True))
            for other in affected.tolist():
                heappush(pending, (float(self.costs[other]), other))

    def _founder_of(self, end: int) -> int:
        """The first founder that comes before an end and agrees with it; else the end itself."""
        founding = self._founders == np.arange(len(self))
        agreeing = np.flatnonzero(self._agree(end, later=False) & founding)
        return int(agreeing[np.argmin(self.costs[agreeing])]) if len(agreeing) else end

    def _agree(self, end: int, later: bool) -> np.ndarray:
        """Whether each end (n,) comes after `end`, or before it, and the later of the two agrees with the earlier."""
        cost, number = self.costs[end], np.arange(len(self))
        if later:
            ordered = (self.costs > cost) | ((self.costs == cost) & (number > end))
            agree = ordered & same_cost(self.costs, cost)
        else:
            ordered = (self.costs < cost) | ((self.costs == cost) & (number < end))
            agree = ordered & same_cost(cost, self.costs)
        near = np.flatnonzero(agree)
        agree[near] = np.abs(self.points[near] - self.points[end]).max(axis=1) < SAME_POINT_DISTANCE
        return agree

    def basins(self) -> list[Basin]:
        """All basins, best first."""
        founders, counts = np.unique(self._founders, return_counts=True)
        order = np.argsort(self.costs[founders], kind="stable")
        return [
            Basin(tuple(self.points[end].tolist()), float(self.costs[end]), int(count))
            for end, count in zip(founders[order], counts[order], strict=True)
        ]

    def counts(self) -> tuple[int, int]:
        """Number of basins, and number of searches that ended in the best one."""
        founders, counts = np.unique(self._founders, return_counts=True)
        return len(founders), int(counts[np.argmin(self.costs[founders])]) if len(founders) else 0

    def agree_in_cost(self) -> int:
        """Number of ends whose cost is that of the best."""
        return int(same_cost(self.costs, self.costs.min()).sum()) if len(self) else 0

    def agreement(self) -> str | None:
        """Say that further searches would find nothing new; None where they might.

        The searches have ended in so few basins so often that fewer than half a basin more is to be expected (Boender &
        Rinnooy Kan 1987, Math. Program. 37, 59), the best of them at least three times.
        """
        n, (basins, in_best) = len(self), self.counts()
        if n <= basins + 2 or in_best < MIN_SEARCHES_IN_BEST_BASIN:
            return None
        if basins * (n - 1) / (n - basins - 2) < basins + 0.5:
            where = "one basin" if basins == 1 else f"the best of {basins} basins"
            return f"{in_best} of {n} local searches agree on {where}"
        return None

    def summary(self, starts: int) -> Summary:
        """Number of local searches begun, number that agree with the best, and the basins that they reached."""
        return Summary(starts, self.counts()[1], self.agree_in_cost(), tuple(self.basins()))


def same_cost(cost: np.ndarray | float, best: np.ndarray | float) -> np.ndarray:
    """Whether costs are that of the best, to one per cent."""
    return np.abs(cost - best) <= SAME_COST_DIFFERENCE * np.abs(best) + COST_TOLERANCE
