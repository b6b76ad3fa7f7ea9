"""A study: points are asked for, simulated, scored, logged and told."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
import xarray as xr
from scipy.stats.qmc import Sobol

from calib.errors import CalibError, nearest
from calib.model import Model
from calib.objective import Objective, Score
from calib.parameter import Space, values_for
from calib.pool import REFUSED, Failure, LocalPool
from calib.store import Trial
from calib.store.trial import best

SCREEN = 64  # points of the screen, unless the budget is below four times as many
BUDGET, INTERRUPTED = "budget spent", "interrupted"  # Result.stopped; otherwise the optimiser's own reason


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an optimiser learns of a point.

    Attributes
    ----------
    cost : what to minimise; infinity where the evaluation failed
    residuals : (n,) float64 with one n for the whole study, or None where the evaluation failed
    status : "ok" or why there is no score
    kind : kind of the simulated motion, or None
    """

    cost: float
    residuals: np.ndarray | None
    status: str
    kind: str | None


class Optimiser(Protocol):
    """What a study needs of a search method.

    To write one:

    1. It is made as ``optimiser(dim=, seed=, budget=, batch=)``, all further arguments being options with a default.
       `budget` is the number of trials of the whole study, those told before the first ask included.
    2. Everything random comes from `seed`. The same outcomes told in the same order give the same asks, bit for bit, in
       another process too: a study is resumed by asking and telling all over again.
    3. `ask` returns points (n, dim) in [0, 1], n of your choice; about `batch` points keep the processes busy.
    4. `tell` brings the outcomes of exactly the points asked for last, in their order. Before the first `ask` it may
       bring others: the study's screen, or the trials of an earlier stretch.
    5. An outcome may be infinite and without residuals: the simulation failed there. All of them may be.
    6. `stop` is looked at before every `ask`: a reason to end in plain words, or None to go on.
    7. `close` ends threads and files; it comes once, whatever happened.
    8. Optionally `summary()`: a dict (or dataclass) on how far the search may be trusted, after the last `tell`.

    `calib.testing.OptimiserSuite` checks all this.
    """

    def ask(self) -> np.ndarray:
        """Return the next points (n, dim)."""
        ...

    def tell(self, x: np.ndarray, outcomes: Sequence[Outcome]) -> None:
        """Take the outcomes of the points `x` (n, dim)."""
        ...

    def stop(self) -> str | None:
        """Return why the search has ended, or None."""
        ...

    def close(self) -> None:
        """End what runs beside."""
        ...


class StoreContract(Protocol):
    """What a study needs of the place its trials are kept in.

    To write one:

    1. `open` takes the header (name, definition, screen, budget), refuses another definition than the one the trials
       there belong to, and returns those trials. It keeps a second writer out until `close`.
    2. `header` is then the one in force: with `screen` of the first opening, and of the present segment `segment`, its
       `hint` (the budget it began with) and `first` (its first search number). A segment begins at first opening, when
       libraries or the processor have changed since, and at `begin_segment`, with the number after the highest logged
       (or the screen).
    3. `append` returns when the trial is safe: after a power failure, `open` returns it with the same bits.
    4. Whatever it cannot write is a CalibError.
    """

    @property
    def header(self) -> Mapping[str, Any]:
        """The header in force."""
        ...

    def open(self, header: Mapping[str, Any], fresh: bool = False) -> list[Trial]:
        """Return the trials there; with `fresh`, set them aside and return none."""
        ...

    def begin_segment(self, budget: int) -> None:
        """Begin a new segment."""
        ...

    def append(self, trial: Trial, records: Mapping[str, xr.Dataset] | None) -> None:
        """Log a trial, with its simulated records where there are any."""
        ...

    def close(self) -> None:
        """Let go of the place."""
        ...


class Pool(Protocol):
    """Where evaluations happen; see `calib.pool`."""

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as they end."""
        ...


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A point simulated and scored.

    Attributes
    ----------
    score : of all records together
    records : simulated record of each scored reference
    features : scalar features as dicts: label, record, body, unit, measured, simulated, tolerance
    seconds : wall-clock time  [s]
    """

    score: Score
    records: Mapping[str, xr.Dataset]
    features: list[dict[str, Any]]
    seconds: float


@dataclass(frozen=True)
class Reach:
    """How near the trials come to one measured scalar feature.

    Attributes
    ----------
    label, record, body, unit : which feature, of which record and body, in which unit
    measured, tolerance : what was measured, to be met within the tolerance  [unit]
    low, high : range of the simulated values over the trials that ended ok; None where none shows the feature  [unit]
    nearest : the simulated value nearest to the measured one, or None  [unit]
    off : how far the measured value lies outside the range, 0 inside it, None without one  [unit]
    reached : whether it lies in the range within its tolerance
    """

    label: str
    record: str
    body: str
    unit: str
    measured: float
    tolerance: float
    low: float | None
    high: float | None
    nearest: float | None
    off: float | None
    reached: bool

    @property
    def percent(self) -> float | None:
        """`off` in per cent of the measured value, None where there is no such number."""
        return None if self.off is None or not self.measured else 100.0 * self.off / abs(self.measured)


@dataclass(frozen=True, eq=False)
class Result:
    """What a study has found so far.

    Attributes
    ----------
    best : trial with the lowest total, the earliest among equals; None where none ended ok
    trials : all trials in asking order, resumed ones included
    reach : of each measured scalar feature
    agreement : the optimiser's summary, None where it has none
    stopped : "budget spent", "interrupted" (by Ctrl-C; resumable), or the optimiser's reason
    """

    best: Trial | None
    trials: list[Trial]
    reach: list[Reach]
    agreement: dict | None
    stopped: str


@dataclass(frozen=True, eq=False)
class Study:
    """A search for the parameters with which a model fits its references best.

    Attributes
    ----------
    name : of the study
    model, space, objective : what is simulated, searched and minimised
    optimiser : makes the search method; see `Optimiser`
    budget : trials in all, those of the screen and of earlier runs included; may grow from run to run
    seed : of the screen and the optimiser
    batch : points that the optimiser should ask for at a time; belongs to the study, unlike `jobs`
    jobs, timeout : child processes, and the wall-clock limit of one trial [s]; both may change from run to run
    screen : Sobol points evaluated first; None for 64, or less with a budget below 256
    definition : what else the study is, as JSON: another one in the same folder is refused
    """

    name: str
    model: Model
    space: Space
    objective: Objective
    optimiser: Callable[..., Optimiser]
    budget: int
    seed: int = 0
    batch: int = 1
    jobs: int = 1
    timeout: float | None = None
    screen: int | None = None
    definition: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self):
        for name, low in (("budget", 1), ("batch", 1), ("jobs", 1), ("screen", 0), ("seed", 0)):
            value = getattr(self, name)
            if name == "screen" and value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise CalibError(f"{name} is a whole number from {low} on, got {value!r}")
        if not self.space.dim:
            raise CalibError("there is nothing to search: give at least one parameter a window")
        for name in (*self.space.windows, *self.space.fixed):
            record = name.partition("@")[2]
            if "@" in name and record not in self.objective.references:
                known = list(self.objective.references)
                raise CalibError(f"{name!r} belongs to an unknown record{nearest(record, known)}; there are {known}")

    @property
    def header(self) -> dict[str, Any]:
        """What a store is opened with: name, definition, screen and budget.

        Budget, jobs, time-out and what concerns the store are not part of the definition.
        """
        screen = self.screen
        if screen is None:
            most = min(SCREEN, self.budget // 4)
            screen = 1 << (most.bit_length() - 1) if most else 0  # a power of two keeps Sobol's points balanced
        windows = {n: {"low": w.low, "high": w.high, "scale": w.scale} for n, w in self.space.windows.items()}
        own = {"seed": self.seed, "batch": self.batch, "screen": self.screen, "windows": windows}
        definition = {**own, "fixed": dict(self.space.fixed), **self.definition}
        return {"name": self.name, "definition": definition, "screen": min(screen, self.budget), "budget": self.budget}

    def run(
        self,
        store: StoreContract,
        pool: Pool | None = None,
        on_trial: Callable[[Trial, Trial | None, int], None] | None = None,
        fresh: bool = False,
    ) -> Result:
        """Search until the budget is spent, the optimiser stops, or Ctrl-C; take up what the store has already.

        The trials logged are replayed: the optimiser, made anew, asks again for the same points and is told what was
        logged. So a run that was killed and resumed, with any number of jobs, gives what one run would have given. If
        libraries or processor have changed meanwhile, or an optimiser has ended because its budget was spent and the
        study's is larger now, a new optimiser is told the trials so far as if they were a screen.

        Parameters
        ----------
        store : see `StoreContract`; closed at the end
        pool : maps values to an `Evaluation` or `Failure`; a `LocalPool` of `jobs` child processes unless given
        on_trial : called with each new trial, the best so far, and the number of trials there are
        fresh : set aside what the store has

        Raises
        ------
        CalibError : the store belongs to another study; a replayed point differs from the logged one; the model refuses
            the first point
        """
        own = LocalPool(partial(evaluate, self.without_search()), self.jobs, self.timeout) if pool is None else None
        logged = store.open(self.header, fresh)
        run = _Run(self, store, pool or own, logged, on_trial)
        try:
            stopped = run.to_the_end()
        except KeyboardInterrupt:
            stopped = INTERRUPTED
        finally:
            if own is not None:
                own.close()
            store.close()
        trials = sorted(run.trials.values(), key=lambda trial: trial.number)
        return Result(best(trials), trials, reach(trials), run.agreement, stopped)

    def without_search(self) -> "Study":
        """Return what an evaluation needs of the study: it crosses to the child processes."""
        return replace(self, optimiser=None, definition={})


def evaluate(study: Study, values: Mapping[str, float]) -> Evaluation:
    """Simulate every record that the study's objective scores at `values` (SI), and score them.

    Raises
    ------
    CalibError : an unknown parameter, or an excitation that the simulator cannot take
    """
    start = time.perf_counter()
    objective = study.objective
    records = {
        name: study.model.run(
            values_for(values, name), objective.references[name].excitation, objective.references[name].request
        )
        for name in objective.scored
    }
    score = objective(records)
    features = [asdict(feature) for feature in objective.features(records)] if score.status == "ok" else []
    return Evaluation(score, records, features, time.perf_counter() - start)


def reach(trials: Iterable[Trial]) -> list[Reach]:
    """How near the trials that ended ok come to each measured scalar feature."""
    found: dict[tuple[str, str, str], list[dict]] = {}
    for trial in trials:
        for feature in trial.features:
            if feature["measured"] is not None:
                found.setdefault((feature["label"], feature["record"], feature["body"]), []).append(feature)
    return [_reach(features) for features in found.values()]


def _reach(features: list[dict]) -> Reach:
    first = features[0]
    known = {key: first[key] for key in ("label", "record", "body", "unit", "measured")}
    measured, tolerance = first["measured"], first["tolerance"] or 0.0
    simulated = [feature["simulated"] for feature in features if feature["simulated"] is not None]
    if not simulated:
        return Reach(**known, tolerance=tolerance, low=None, high=None, nearest=None, off=None, reached=False)
    off = max(0.0, min(simulated) - measured, measured - max(simulated))
    return Reach(
        **known,
        tolerance=tolerance,
        low=min(simulated),
        high=max(simulated),
        nearest=min(simulated, key=lambda value: abs(value - measured)),
        off=off,
        reached=off <= tolerance,
    )


class _Run:
    """One run of a study over its store: what is logged, and what is going on."""

    def __init__(self, study: Study, store: StoreContract, pool: Pool, logged: list[Trial], on_trial):
        self._study, self._store, self._pool, self._on_trial = study, store, pool, on_trial
        self.trials = {trial.number: trial for trial in logged}
        self._best = best(logged)
        self.agreement: dict | None = None

    def to_the_end(self) -> str:
        """Evaluate the screen, then one segment after the other; return why it ended."""
        self._screen()
        while True:
            stopped = self._segment()
            if not self._store.header["hint"] <= len(self.trials) < self._study.budget:
                return stopped
            self._store.begin_segment(self._study.budget)  # it ended for want of the budget that there is now

    def _screen(self) -> None:
        size = min(self._store.header["screen"], self._study.budget)
        points = _sobol(self._study.space.dim, self._study.seed, self._store.header["screen"])[:size]
        missing = sum(number not in self.trials for number in range(size))
        room = max(0, self._study.budget - len(self.trials))
        self._evaluate(0, points, "screen", min(missing, room))

    def _segment(self) -> str:
        """Search with one optimiser from the segment's first number on."""
        first = self._store.header["first"]
        told = [trial for _, trial in sorted(self.trials.items()) if trial.number < first]
        end = first + self._study.budget - len(told)
        if end <= first:
            return BUDGET
        with self._searching() as optimiser:
            if told:
                optimiser.tell(np.array([trial.u for trial in told]), [outcome(trial) for trial in told])
            return self._search(optimiser, first, end)

    @contextmanager
    def _searching(self) -> Iterator[Optimiser]:
        study = self._study
        optimiser = study.optimiser(
            dim=study.space.dim, seed=study.seed, budget=self._store.header["hint"], batch=study.batch
        )
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
                return BUDGET
            points = _points(optimiser.ask(), self._study.space.dim)
            self._replayed(number, points)
            count = min(len(points), end - number)
            self._evaluate(number, points[:count], "search")
            number += count
            if count < len(points):
                return BUDGET
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

    def _evaluate(self, first: int, points: np.ndarray, phase: str, most: int | None = None) -> None:
        """Evaluate those of the points, numbered from `first`, that are not logged; at most so many."""
        todo = [(n, u) for n, u in enumerate(points, start=first) if n not in self.trials][:most]
        if todo and not self.trials:
            # alone: a mistake of usage is found before it fills the log, and kernels are compiled only once
            self._evaluate_all(todo[:1], phase)
            todo = todo[1:]
        self._evaluate_all(todo, phase)

    def _evaluate_all(self, todo: list[tuple[int, np.ndarray]], phase: str) -> None:
        values = [self._study.space.values(u) for _, u in todo]
        for index, result in self._pool.map(values):
            if isinstance(result, Failure) and result.status == REFUSED and not self.trials:
                raise CalibError(result.reason)
            trial = _trial(*todo[index], values[index], result, phase, self._store.header["segment"])
            self._store.append(trial, None if isinstance(result, Failure) else result.records)
            self.trials[trial.number] = trial
            self._best = best([trial] if self._best is None else [self._best, trial])
            if self._on_trial is not None:
                self._on_trial(trial, self._best, len(self.trials))


def _sobol(dim: int, seed: int, size: int) -> np.ndarray:
    """Scrambled Sobol points (size, dim): the first `size` of the power of two that holds them."""
    if not size:
        return np.empty((0, dim))
    return Sobol(dim, rng=np.random.default_rng([seed, 0])).random_base2((size - 1).bit_length())[:size]


def _points(asked: Any, dim: int) -> np.ndarray:
    points = np.asarray(asked, dtype=float)
    if points.ndim != 2 or points.shape[1] != dim or not len(points):
        raise ValueError(f"the optimiser should ask for points of shape (n, {dim}), got {points.shape}")
    if not ((points >= 0.0) & (points <= 1.0)).all():
        raise ValueError(f"the optimiser should ask for points in [0, 1], got {points.tolist()}")
    return points


def _trial(number: int, u: np.ndarray, values: dict, result: Evaluation | Failure, phase: str, segment: int) -> Trial:
    known = {"number": number, "u": u.tolist(), "values": values, "seconds": result.seconds, "phase": phase}
    if isinstance(result, Failure):
        return Trial(**known, total=math.inf, status=result.status, reason=result.reason, segment=segment)
    score = result.score
    scored = math.isfinite(score.total)
    return Trial(
        **known,
        total=float(score.total) if scored else math.inf,
        terms={label: float(distance) for label, distance in score.terms.items()},
        status=score.status,
        reason=score.reason,
        kind=score.kind,
        features=result.features,
        residuals=np.asarray(score.residuals, dtype=float) if scored and score.residuals is not None else None,
        segment=segment,
    )


def outcome(result: Trial | Score | Failure) -> Outcome:
    """What an optimiser, or whoever differentiates, learns of a trial, a score or a call that failed."""
    if isinstance(result, Failure):
        return Outcome(math.inf, None, result.status, None)
    return Outcome(result.total, result.residuals, result.status, result.kind)


def _summary(optimiser: Optimiser) -> dict | None:
    """Return what the optimiser says of its search, as a dict; None where it says nothing."""
    if not hasattr(optimiser, "summary"):
        return None
    summary = optimiser.summary()
    return asdict(summary) if is_dataclass(summary) else summary
