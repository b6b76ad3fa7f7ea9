"""An optimiser for programs of which some dozens of runs can be afforded: emulators of what they return search."""

from collections.abc import Sequence

import numpy as np
import scipy
from threadpoolctl import ThreadpoolController

from calib.optimisers import emulated_residuals
from calib.optimisers.basins import SearchEnds, Summary
from calib.optimisers.expected_improvement import emulate_cost, most_promising
from calib.optimisers.outcome import Asking, OutcomeLike, usable_part

FIRST_EMULATED_RADIUS = 0.2  # of the window: first trust region of a search by emulated residuals  [1]
MIN_SEARCH_DISTANCE = 0.1  # of the window, between the start of a search and the starts and ends of those before it
GLOBAL_POINTS = 3  # by expected improvement of the cost, between two searches by residuals  [count]
MIN_EMULATED_POINTS = 2  # simulations that ended, before anything can be emulated  [count]


class Surrogate:
    """Emulators of the residuals, or of the cost where there are none, say where to simulate next.

    With residuals: after a screen of dim + 2 points, a trust region about the best point in which the principal
    components of all residuals nearby are emulated (`emulated_residuals`). A search that has ended is followed by
    points of largest expected improvement of the cost over the whole cube (`expected_improvement`), and by a search
    from the best point away from those before. Without residuals: a screen of 2 dim + 2 points, then expected
    improvement alone.

    Simulations that fail, and in a search by residuals those of another kind of motion, enter by an emulated
    probability. A batch is filled with the points of which the emulators know least, or, by expected improvement, with
    those that would be next if each came out as emulated. It is meant for budgets of 30 to 150.

    Parameters
    ----------
    dim, seed : of the unit cube, and of everything random
    budget : evaluations in all, those before the first ask included
    batch : points wanted at a time
    screen : points before anything is emulated, those told before the first ask included; None as said above

    Raises
    ------
    ValueError : a screen of a negative number of points
    """

    def __init__(self, dim: int, seed: int, budget: int = 100, batch: int = 1, screen: int | None = None):
        if screen is not None and screen < 0:
            raise ValueError(
                f"screen: expected no negative number of points, got {screen}; leave it out for the default"
            )
        self._dim, self._budget, self._batch, self._size = dim, budget, batch, screen
        self._sobol = scipy.stats.qmc.Sobol(dim, rng=np.random.default_rng([seed, 1]))
        self._rng = np.random.default_rng([seed, 2])
        self._evaluated: list[tuple[np.ndarray, OutcomeLike]] = []
        self._spread: list[int] = []  # of the evaluated points, those of the screen and of expected improvement
        self._starts: list[np.ndarray] = []
        self._ends = SearchEnds(dim)
        self._plan: Asking[None] | None = None
        self._request, self._answers = np.zeros((0, dim)), list[OutcomeLike]()
        self._threads = ThreadpoolController()

    def ask(self) -> np.ndarray:
        """Points (n, dim): what the search wants next, cut to what is left of the budget."""
        with self._threads.limit(limits=1, user_api="blas"):  # the last bits depend on the number of threads
            if self._plan is None:
                self._spread = list(range(len(self._evaluated)))
                self._plan = self._search()
                self._request = next(self._plan)
            elif len(self._answers) == len(self._request):
                self._request, self._answers = self._plan.send(self._answers), []
        points = self._request[len(self._answers) :]
        left = self._budget - len(self._evaluated)
        return points[:left] if left > 0 else points

    def tell(self, x: np.ndarray, outcomes: Sequence[OutcomeLike]) -> None:
        """Take the outcomes of the points (n, dim) asked for last, or of others made before the first ask."""
        usable = [usable_part(outcome) for outcome in outcomes]
        self._evaluated += zip(np.array(x, float), usable, strict=True)
        if self._plan is not None:
            self._answers += usable

    def stop(self) -> str | None:
        """Why there is nothing more to gain: the budget is spent, or searches by residuals agree; else None."""
        return "budget spent" if len(self._evaluated) >= self._budget else self._ends.agreement()

    def close(self) -> None:
        """Nothing to end: no threads, no files."""

    def summary(self) -> Summary:
        """Number of searches by residuals, number that agree with the best, and the basins that they reached."""
        return self._ends.summary(len(self._starts))

    def _search(self) -> Asking[None]:
        """Screen, then searches by residuals with points of expected improvement between them, without an end."""
        yield from self._screen()
        lengths = None
        while True:
            start = self._start()
            if start is not None:
                self._starts.append(start[0])
                end, outcome = yield from emulated_residuals.descend(
                    *start, self._evaluated, FIRST_EMULATED_RADIUS, self._batch, self._rng
                )
                self._ends.add(end, outcome.cost)
            for _ in range(GLOBAL_POINTS):
                points, costs = np.array([u for u, _ in self._evaluated]), self._costs()
                emulated = emulate_cost(points, costs, lengths)
                lengths = emulated.process.lengths
                yield from self._spreading(most_promising(emulated, points[np.argmin(costs)], self._batch, self._rng))

    def _screen(self) -> Asking[None]:
        """Points of a Sobol sequence until there are enough, of which some have ended."""
        wanted = self._dim + 2 if self._size is None else self._size
        if (missing := wanted - len(self._evaluated)) > 0:
            yield from self._spreading(self._drawn(missing))
        while np.isfinite(self._costs()).sum() < MIN_EMULATED_POINTS:
            yield from self._spreading(self._drawn(self._batch))
        missing = 2 * self._dim + 2 - len(self._evaluated)
        if self._size is None and missing > 0 and all(outcome.residuals is None for _, outcome in self._evaluated):
            yield from self._spreading(self._drawn(missing))

    def _spreading(self, points: np.ndarray) -> Asking[None]:
        """Points (n, dim) from which searches may start."""
        first = len(self._evaluated)
        yield points
        self._spread += range(first, first + len(points))

    def _drawn(self, size: int) -> np.ndarray:
        """The next points (size, dim) of the Sobol sequence, one by one, which keeps scipy from warning."""
        return np.concatenate([self._sobol.random(1) for _ in range(size)])

    def _costs(self) -> np.ndarray:
        return np.array([outcome.cost for _, outcome in self._evaluated])

    def _start(self) -> tuple[np.ndarray, OutcomeLike] | None:
        """The best point spread over the cube with residuals, away from all starts and ends, with its outcome."""
        known = np.concatenate([np.array(self._starts).reshape(-1, self._dim), self._ends.points])
        for u, outcome in sorted((self._evaluated[i] for i in self._spread), key=lambda each: each[1].cost):
            if outcome.residuals is not None and (np.abs(known - u).max(axis=1) > MIN_SEARCH_DISTANCE).all():
                return u, outcome
        return None
