"""One run of a study over its store: screen, then segments of asking, evaluating and telling."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, Protocol

import numpy as np
import scipy

from calib.errors import CalibError
from calib.execution.interrupt import uninterrupted
from calib.execution.pool import REFUSED, Failure, Pool
from calib.execution.pools.settings import PoolSettings
from calib.modelling.parameter import Space
from calib.store import Trial
from calib.store.trial import FORMER_CODE, best
from calib.study.choice import CostlyChoice, costly_choice
from calib.study.contracts import Optimiser, StoreContract
from calib.study.evaluation import Phase, as_trial, outcome
from calib.study.first_trials import FirstTrials

BUDGET_SPENT = "budget spent"  # why a search ended; otherwise the optimiser's own reason

OnOpened = Callable[[Sequence[Trial]], None]  # the trials of earlier runs
OnTrial = Callable[[Trial, Trial | None, int], None]  # a new trial, the best so far, the number of trials there are


@dataclass(frozen=True)
class SearchEnd:
    """How an earlier run of a study ended.

    Attributes
    ----------
    trials : number of trials there were
    best : number of the best one, None where none ended ok
    stopped, agreement : see `calib.study.SearchResult`
    """

    trials: int
    best: int | None
    stopped: str
    agreement: Mapping[str, Any] | None


class Searchable(Protocol):
    """What a search needs of a `calib.study.CalibrationStudy`."""

    @property
    def space(self) -> Space:
        """What is searched."""
        ...

    @property
    def optimiser(self) -> Callable[..., Optimiser]:
        """Makes the search method."""
        ...

    @property
    def costly_optimiser(self) -> Callable[..., Optimiser] | None:
        """Makes the search method where simulations are few and slow; None for the same."""
        ...

    @property
    def seed(self) -> int:
        """Of the screen and the optimiser."""
        ...

    @property
    def budget(self) -> int:
        """Trials in all."""
        ...

    @property
    def batch(self) -> int:
        """Points that the optimiser should ask for at a time."""
        ...

    @property
    def evaluated_by(self) -> PoolSettings:
        """Where trials are evaluated."""
        ...


class Search:
    """One run of a study over its store: what is logged, and what is going on."""

    def __init__(
        self,
        study: Searchable,
        store: StoreContract,
        pool: Pool,
        logged: list[Trial],
        on_trial: OnTrial | None,
        on_ask: Callable[[int], None] = lambda points: None,
        on_choice: Callable[[CostlyChoice], None] = lambda choice: None,
    ):
        self._on_ask, self._on_choice = on_ask, on_choice
        self._study, self._store, self._pool, self._on_trial = study, store, pool, on_trial
        self.trials = {trial.number: trial for trial in logged}
        self._best = best(logged)
        self._first = FirstTrials(study.evaluated_by.jobs or 1)
        self.agreement: dict[str, Any] | None = None

    @property
    def choice(self) -> CostlyChoice | None:
        """That emulators search, for want of an optimiser that is named; None where the study's own does."""
        if self._study.costly_optimiser is None:
            return None
        return costly_choice(self._store.header.hint, self.trials.values())

    def to_the_end(self, earlier: SearchEnd | None = None) -> str:
        """Evaluate the screen, then one segment after the other; return why it ended.

        Where the `earlier` end is that of these trials and of this budget, nothing is asked of the optimiser.
        """
        if earlier is not None and self._ended(earlier):
            self.agreement = None if earlier.agreement is None else dict(earlier.agreement)
            return earlier.stopped
        self._screen()
        while True:
            stopped = self._segment()
            if not self._store.header.hint <= len(self.trials) < self._study.budget:
                return stopped
            self._store.begin_segment(self._study.budget)  # it ended for want of the budget that there is now

    def _ended(self, earlier: SearchEnd) -> bool:
        """Whether nothing has come or changed since that end of the search, and there is no more budget to spend."""
        number, header = len(self.trials), self._store.header
        same = earlier.trials == number and earlier.best == (None if self._best is None else self._best.number)
        begun = all(trial < header.first for trial in self.trials)  # a segment, for what has changed
        spent = number == self._study.budget
        stopped = earlier.stopped != BUDGET_SPENT and number <= min(self._study.budget, header.hint - 1)
        return same and not begun and (spent or stopped)

    def _screen(self) -> None:
        points = _screen_points(self._study.space, self._study.seed, self._store.header.screen)
        room = max(0, self._study.budget - len(self.trials))
        self._evaluate(0, points[: self._study.budget], "screen", room)

    def _segment(self) -> str:
        """Search with one optimiser from the segment's first number on."""
        first = self._store.header.first
        earlier = [trial for _, trial in sorted(self.trials.items()) if trial.number < first]
        again = _to_repeat(earlier)
        end = first + max(self._study.budget - len(earlier), len(again))
        if end <= first:
            return BUDGET_SPENT
        self._evaluate(first, np.array(again), "search")
        begin = first + len(again)
        known = [trial for trial in earlier if trial.status != FORMER_CODE]
        known += [self.trials[number] for number in range(first, begin)]
        with self._searching(len(earlier) + len(again) - len(known)) as optimiser:
            if known:
                optimiser.tell(np.array([trial.u for trial in known]), [outcome(trial) for trial in known])
            return self._search(optimiser, begin, end)

    @contextmanager
    def _searching(self, superseded: int) -> Iterator[Optimiser]:
        """Make the optimiser, whose budget is without the trials that it is not told: they are superseded."""
        study, choice = self._study, self.choice
        make = study.optimiser
        if choice is not None and study.costly_optimiser is not None:
            make = study.costly_optimiser
            self._on_choice(choice)
        budget = max(1, self._store.header.hint - superseded)
        optimiser = make(dim=study.space.dim, seed=study.seed, budget=budget, batch=study.batch)
        try:
            yield optimiser
        finally:
            self.agreement = _summary(optimiser)
            optimiser.close()

    def _search(self, optimiser: Optimiser, number: int, end: int) -> str:
        """Ask, evaluate and tell; trials are numbered from `number` to below `end`."""
        while True:
            reason = optimiser.stop()
            if reason is not None:
                return reason
            if number >= end:
                return BUDGET_SPENT
            points = _checked(optimiser.ask(), self._study.space.dim)
            self._on_ask(len(points))
            self._replayed(number, points)
            count = min(len(points), end - number)
            self._evaluate(number, points[:count], "search")
            number += count
            if count < len(points):
                return BUDGET_SPENT
            trials = [self.trials[n] for n in range(number - count, number)]
            optimiser.tell(points, [outcome(trial) for trial in trials])

    def _replayed(self, number: int, points: np.ndarray) -> None:
        """Compare the points asked for with those logged under the same numbers."""
        for at, u in enumerate(points, start=number):
            trial = self.trials.get(at)
            if trial is not None and trial.u != u.tolist():
                raise CalibError(
                    f"the log cannot be replayed: trial {at} was asked for at {trial.u}, now at {u.tolist()}; the "
                    "optimiser or the program was changed since; undo that, or begin afresh (--fresh)"
                )

    def _evaluate(self, first: int, points: np.ndarray, phase: Phase, most: int | None = None) -> None:
        """Evaluate those of the points, numbered from `first`, that are not logged; at most so many."""
        todo = [(n, u) for n, u in enumerate(points, start=first) if n not in self.trials][:most]
        if todo and not self.trials:
            # alone: a mistake of usage is found before it fills the log, and kernels are compiled only once
            self._evaluate_all(todo[:1], phase)
            todo = todo[1:]
        if todo:  # a pool that is asked for nothing still starts its server
            self._evaluate_all(todo, phase)

    def _evaluate_all(self, todo: list[tuple[int, np.ndarray]], phase: Phase) -> None:
        values = [self._study.space.values(u) for _, u in todo]
        self._first.ask(number for number, _ in todo)
        for index, result in self._pool.map(values):
            if isinstance(result, Failure) and result.status == REFUSED and not self.trials:
                raise CalibError(result.reason)
            number, u = todo[index]
            trial = as_trial(number, u.tolist(), values[index], result, phase, self._store.header.segment)
            with uninterrupted():
                trial = self._store.append(trial, None if isinstance(result, Failure) else result.records)
            self.trials[trial.number] = trial
            self._best = best([trial] if self._best is None else [self._best, trial])
            if self._on_trial is not None:
                self._on_trial(trial, self._best, len(self.trials))
            if isinstance(result, Failure) and self._best is None and self._left:
                self._first.check(self.trials, number, result)

    @property
    def _left(self) -> bool:
        """Whether budget is left beside the trials of the present code."""
        return sum(trial.status != FORMER_CODE for trial in self.trials.values()) < self._study.budget


def _to_repeat(trials: list[Trial]) -> list[list[float]]:
    """Points that the present code evaluates first: the best by former code, or its screen before a first search."""
    former = [trial for trial in trials if trial.status == FORMER_CODE]
    present = [trial for trial in trials if trial.status != FORMER_CODE]
    scored = [trial for trial in former if math.isfinite(trial.former_cost)]
    top = min(scored, key=lambda trial: (trial.former_cost, trial.number), default=None)
    if top is not None:
        points = [top.u]
    elif any(math.isfinite(trial.cost) for trial in present if trial.phase == "search"):
        points = []
    else:
        points = [trial.u for trial in former if trial.phase == "screen"]
    evaluated = [trial.u for trial in present]
    return [point for point in points if point not in evaluated]


def _screen_points(space: Space, seed: int, size: int) -> np.ndarray:
    """The points (size, dim) of the screen: the starting point, where there is one, and a Sobol sequence."""
    start = space.starting_point
    if start is None or not size:
        return _sobol(space.dim, seed, size)
    return np.concatenate([start[None], _sobol(space.dim, seed, size - 1)])


def _sobol(dim: int, seed: int, size: int) -> np.ndarray:
    """Scrambled Sobol points (size, dim): the first `size` of the power of two that holds them."""
    if not size:
        return np.empty((0, dim))
    return scipy.stats.qmc.Sobol(dim, rng=np.random.default_rng([seed, 0])).random_base2((size - 1).bit_length())[:size]


def _checked(asked: Any, dim: int) -> np.ndarray:
    points = np.asarray(asked, dtype=float)
    if points.ndim != 2 or points.shape[1] != dim or not len(points):
        raise ValueError(f"the optimiser should ask for points of shape (n, {dim}), got {points.shape}")
    if not ((points >= 0.0) & (points <= 1.0)).all():
        raise ValueError(f"the optimiser should ask for points in [0, 1], got {points.tolist()}")
    return points


def _summary(optimiser: Optimiser) -> dict[str, Any] | None:
    """Return what the optimiser says of its search, as a dict; None where it says nothing."""
    if not hasattr(optimiser, "summary"):
        return None
    summary = optimiser.summary()
    return asdict(summary) if is_dataclass(summary) and not isinstance(summary, type) else summary
