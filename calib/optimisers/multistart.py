"""The default optimiser: a Sobol screen, local searches from its best basins, and a population beside them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from calib.optimisers import least_squares, model_search
from calib.optimisers.archive import Archive
from calib.optimisers.basins import SearchEnds, Summary
from calib.optimisers.evolution import Evolution
from calib.optimisers.outcome import Asking, OutcomeLike, usable_part
from calib.optimisers.trend import lowest_of_trend

FIRST_RADIUS = 0.1  # of the window: first trust region of a search from a screened point  [1]
FIRST_RADIUS_NEAR_MINIMUM = 0.02  # of the window: of one from the least point of the trend or from the population  [1]
MIN_START_DISTANCE = 0.35  # over the mean spacing of the screen: a start nearer to another is not tried  [1]
MAX_SCREEN_FRACTION = 3  # one part in so many of the budget is screened at most


@dataclass
class SearchTask:
    """A generator that yields points it wants evaluated, with its open request and the answers so far."""

    purpose: str
    generator: Asking[None]
    request: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    answers: list[OutcomeLike] = field(default_factory=list)

    def advance(self) -> bool:
        """Hand the answers over and take the next request; False once the generator has ended."""
        try:
            self.request = self.generator.send(self.answers) if self.answers else next(self.generator)
        except StopIteration:
            return False
        self.answers = []
        return True


class Multistart:
    """Rounds of screening and local search, and CMA-ES beside them for what local searches cannot do.

    A round adds Sobol points, twice as many in each as in the one before, and searches locally from the best of them
    that lie away from earlier searches: by least squares on the residuals (`least_squares`), by quadratic models of
    the cost where there are none (`model_search`). From the second round on it also searches from where the trend of
    all screened costs is least (`trend`) and from the centre of the population; a cost with a million minima is
    solved there. The population (`evolution`) spends half as much as the rest, and as much while the best is its own.
    A search that could not reach the best cost at its present rate is given up.

    The screen takes at most a third of the budget; what is evaluated before the first ask counts as part of it.

    Evaluations to target with default options, seeds 0..19, budget 4000
    (``python tests/benchmarks/compare_optimisers.py --peers "calib multistart" --problems ...``):

    ============  =======  ======  =====      ==============  =======  ======  =====
    problem       reached  median  worst      problem         reached  median  worst
    ============  =======  ======  =====      ==============  =======  ======  =====
    impact6       20       41      93         failing6        20       116     361
    ringdown6     20       114     214        receptance8     20       76      187
    hartmann6     20       72      327        kinds6          20       44      570
    rastrigin6    20       952     1786       creep5          20       62      142
    rotated6      20       1590    3605       ackley6         20       994     1829
    rosenbrock6   20       315     696        double_funnel6  3        -       -
    ringdown9     20       154     411
    ============  =======  ======  =====      ==============  =======  ======  =====

    Parameters
    ----------
    dim, seed : of the unit cube, and of everything random
    budget : evaluations in all, those before the first ask included
    batch : points wanted at a time; several searches go on side by side where one asks for fewer
    screen : points of the first round; None for four times the dimension
    """

    def __init__(self, dim: int, seed: int, budget: int = 1000, batch: int = 1, screen: int | None = None):
        self._dim, self._budget, self._batch = dim, budget, batch
        self._first = max(1, min(4 * dim if screen is None else screen, budget // MAX_SCREEN_FRACTION))
        self._sobol = scipy.stats.qmc.Sobol(dim, rng=np.random.default_rng([seed, 1]))
        self._rng = np.random.default_rng([seed, 2])
        self._archive = Archive(dim)
        self._screened: list[tuple[np.ndarray, OutcomeLike]] = []
        self._tasks: list[SearchTask] = []
        self._starts: list[np.ndarray] = []
        self._ends = SearchEnds(dim)
        self.spent = dict.fromkeys(("screen", "search", "population"), 0)
        self._best = (np.full(dim, np.nan), np.inf, "screen")  # point, cost, purpose of its task
        self._round = 0
        self._candidates: Iterator[tuple[np.ndarray, OutcomeLike | None, float]] = iter(())
        self._evolution: Evolution | None = None
        self._runs = 0
        self._asked = self._has_residuals = False

    # ------------------------------------------------------------------------------------------------- contract
    def ask(self) -> np.ndarray:
        """Points (n, dim): all that the tasks under way want, cut to what is left of the budget."""
        if not self._asked and len(self._screened) >= self._first:
            self._open_round()
        self._asked = True
        self._fill()
        points = np.concatenate([task.request[len(task.answers) :] for task in self._tasks])
        left = self._budget - self._total()
        return points[:left] if left > 0 else points

    def tell(self, x: np.ndarray, outcomes: Sequence[OutcomeLike]) -> None:
        """Take the outcomes of the points (n, dim) asked for last, or of others made before the first ask."""
        x, usable = np.asarray(x, float), [usable_part(outcome) for outcome in outcomes]
        self._archive.add(x, [outcome.cost for outcome in usable])
        self._has_residuals = self._has_residuals or any(outcome.residuals is not None for outcome in usable)
        if not self._asked:
            self._note("screen", x, usable)
            self._screened += zip(x, usable, strict=True)
            return
        first = 0
        for task in self._tasks:
            mine = slice(first, first + len(task.request) - len(task.answers))
            task.answers += usable[mine]
            self._note(task.purpose, x[mine], usable[mine])
            first = mine.stop
        self._tasks = [task for task in self._tasks if len(task.answers) < len(task.request) or task.advance()]

    def stop(self) -> str | None:
        """Why there is nothing more to gain, or None.

        Either the budget is spent, or the searches on a residual vector agree (`SearchEnds.agreement`). A cost without
        residuals is searched until the budget is spent.
        """
        if self._total() >= self._budget:
            return "budget spent"
        return self._ends.agreement() if self._has_residuals else None

    def close(self) -> None:
        """Nothing to end: no threads, no files."""

    def summary(self) -> Summary:
        """Number of local searches, number that agree with the best, and the basins that they reached."""
        return self._ends.summary(len(self._starts))

    # ---------------------------------------------------------------------------------------------- what to do next
    def _total(self) -> int:
        return sum(self.spent.values())

    def _fill(self) -> None:
        """Start tasks until they want at least a batch of points, or none can be started beside those under way."""
        while sum(len(task.request) for task in self._tasks) < self._batch:
            task = self._next_task()
            if task is None:
                return
            if task.advance():
                self._tasks.append(task)

    def _next_task(self) -> SearchTask | None:
        """Population generation, search or screen, whichever is due; None if it must wait for those under way."""
        busy = {task.purpose for task in self._tasks}
        if "population" not in busy and self._population_due():
            return SearchTask("population", self._generation())
        if "screen" not in busy:
            start = next(self._candidates, None)
            if start is None and (size := self._round_size()):
                return SearchTask("screen", self._screen(size))
            if start is None:
                self._open_round()  # the screen is spent: go on from what it left unexplored
                start = next(self._candidates, None)
            if start is not None:
                self._starts.append(start[0])
                return SearchTask("search", self._search(*start))
        return SearchTask("population", self._generation()) if "population" not in busy and self._round else None

    def _round_size(self) -> int:
        """Points of the next screen: the first, as many again, then twice as many, within a third of the budget.

        Where every run failed there is nothing else to do, and it goes on.
        """
        wanted = max(self._first, len(self._screened)) if self._round else self._first - len(self._screened)
        if not np.isfinite(self._best[1]):
            return wanted
        return max(0, min(wanted, self._budget // MAX_SCREEN_FRACTION - len(self._screened)))

    def _population_due(self) -> bool:
        """Whether the population is due: it spends half as much as the rest, or as much where the best is its own."""
        if self._round < 2 or not np.isfinite(self._best[1]):
            return False
        share = 1.0 if self._best[2] == "population" else 0.5
        return self.spent["population"] < share * (self.spent["search"] + self.spent["screen"])

    # -------------------------------------------------------------------------------------------------------- tasks
    def _screen(self, size: int) -> Asking[None]:
        points = self._draw(size)
        self._screened += zip(points, (yield points), strict=True)
        self._open_round()

    def _draw(self, size: int) -> np.ndarray:
        """The next points (size, dim) of the Sobol sequence; drawing the first alone keeps scipy from warning."""
        head = self._sobol.random(1)
        return np.concatenate([head, self._sobol.random(size - 1)]) if size > 1 else head

    def _open_round(self) -> None:
        self._round += 1
        self._candidates = self._round_starts()

    def _round_starts(self) -> Iterator[tuple[np.ndarray, OutcomeLike | None, float]]:
        """Starts of a round, as (point, outcome or None), each chosen in the light of the searches before it."""
        if self._round > 1:
            point, _, purpose = self._best
            if purpose == "population":
                yield point, None, FIRST_RADIUS_NEAR_MINIMUM
            trend = lowest_of_trend(*self._screen_costs())
            if trend is not None and not any(np.allclose(trend, start) for start in self._starts):
                yield trend, None, FIRST_RADIUS_NEAR_MINIMUM
            if self._evolution and self._evolution.generation > self._dim:
                yield self._evolution.centre.copy(), None, FIRST_RADIUS_NEAR_MINIMUM
        for _ in range(1 + self._round):
            start = self._best_unexplored()
            if start is None:
                return
            yield *start, FIRST_RADIUS

    def _screen_costs(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([u for u, _ in self._screened]), np.array([o.cost for _, o in self._screened])

    def _best_unexplored(self) -> tuple[np.ndarray, OutcomeLike] | None:
        """The best screened point away from all starts and ends, with its outcome; None if there is none."""
        points, costs = self._screen_costs()
        known = np.concatenate([np.array(self._starts).reshape(-1, self._dim), self._ends.points])
        away = MIN_START_DISTANCE * len(points) ** (-1 / self._dim)
        for i in np.argsort(costs, kind="stable"):
            if np.isfinite(costs[i]) and (np.abs(known - points[i]).max(axis=1) > away).all():
                return self._screened[i]
        return None

    def _search(self, u: np.ndarray, outcome: OutcomeLike | None, radius: float) -> Asking[None]:
        """A local search from a point, on residuals if there are any, until it ends or cannot reach the best cost."""
        if outcome is None:
            (outcome,) = yield u[None]
        if not np.isfinite(outcome.cost):
            return
        search = (
            least_squares.descend(u, outcome, radius)
            if outcome.residuals is not None
            else model_search.descend(u, outcome, self._archive, radius)
        )
        window, spent, costs = 5 * (self._dim + 1), 0, [outcome.cost]
        lowest = (u, outcome.cost)
        request = next(search)
        while True:
            outcomes = yield request
            for point, answer in zip(request, outcomes, strict=True):
                spent += 1
                if answer.cost < lowest[1]:
                    lowest = (point, answer.cost)
                if spent % window == 0:
                    costs.append(lowest[1])
            if len(costs) > 1 and lowest[1] - self._best[1] > (costs[-2] - costs[-1]) * spent / window:
                break
            try:
                request = search.send(outcomes)
            except StopIteration:
                break
        self._ends.add(*lowest)

    def _generation(self) -> Asking[None]:
        """One generation of the population; a run that has converged is followed by one twice as large (IPOP)."""
        if self._evolution is None or self._evolution.over():
            self._evolution = self._new_evolution()
        points = self._evolution.sample()
        outcomes = yield points
        self._evolution.learn(points, np.array([o.cost for o in outcomes]))

    def _new_evolution(self) -> Evolution:
        """The first run starts from the better quarter of the screen, later ones anywhere (Auger & Hansen 2005)."""
        size = 2 * (4 + int(3 * np.log(self._dim))) * 2**self._runs
        self._runs += 1
        if self._runs == 1:
            points, costs = self._screen_costs()
            order = np.argsort(costs, kind="stable")[: max(1, np.isfinite(costs).sum() // 4)]
            centre = points[order].mean(axis=0)
        else:
            centre = self._rng.random(self._dim)
        return Evolution(centre, 0.25, size, self._rng)

    # ------------------------------------------------------------------------------------------------------- results
    def _note(self, purpose: str, points: np.ndarray, outcomes: Sequence[OutcomeLike]) -> None:
        self.spent[purpose] += len(outcomes)
        for u, outcome in zip(points, outcomes, strict=True):
            if outcome.cost < self._best[1]:
                self._best = (np.array(u), outcome.cost, purpose)
