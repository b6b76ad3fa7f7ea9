"""A calibration study: its search from the first trial to the result of the search."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

from calib.errors import CalibError, nearest
from calib.execution.pool import OpenPool, Pool
from calib.execution.pools.local import check_jobs
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers
from calib.modelling.model import Model
from calib.modelling.parameter import Space
from calib.objective import Objective
from calib.store import StudyHeader, Trial
from calib.store.trial import best
from calib.study.choice import CostlyChoice
from calib.study.contracts import Optimiser, StoreContract
from calib.study.evaluation import evaluate
from calib.study.initial_state import check_searched, check_solvable, check_stated
from calib.study.reachability import Reach, reach
from calib.study.search import OnOpened, OnTrial, Search, SearchEnd

MAX_SCREEN_POINTS = 64  # points of the screen, unless the budget is below four times as many
INTERRUPTED = "interrupted"  # why a study stopped, by Ctrl-C


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search has found so far.

    Attributes
    ----------
    best : trial with the lowest cost, the earliest among equals; None where none ended ok
    trials : all trials in asking order, resumed ones included
    reach : of each measured scalar feature
    agreement : the optimiser's summary, None where it has none
    stopped : "budget spent", "interrupted" (by Ctrl-C; resumable), or the optimiser's reason
    choice : that emulators searched for want of an optimiser that is named; None where the study's own did
    """

    best: Trial | None
    trials: list[Trial] = field(repr=False)
    reach: list[Reach]
    agreement: dict[str, Any] | None
    stopped: str
    choice: CostlyChoice | None = None


@dataclass(frozen=True, eq=False)
class CalibrationStudy:
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
    pool : where trials are evaluated, which may change from run to run too; None: in `jobs` child processes here
    screen : Sobol points evaluated first, after the starting point of the space where it has one; None for 64, or less
        with a budget below 256
    definition : what else the study is, as JSON: another one in the same folder is refused
    code : module outside calib that the study uses -> digest or version; trials by other code do not count
    costly_optimiser : takes the place of `optimiser` where simulations are few and slow (`calib.study.choice`); or None
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
    pool: PoolSettings | None = None
    timeout: float | None = None
    screen: int | None = None
    definition: Mapping[str, Any] = field(default_factory=dict)
    code: Mapping[str, str] = field(default_factory=dict)
    costly_optimiser: Callable[..., Optimiser] | None = None

    def __post_init__(self) -> None:
        for name, low in (("budget", 1), ("batch", 1), ("jobs", 1), ("screen", 0), ("seed", 0)):
            value = getattr(self, name)
            if name == "screen" and value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise CalibError(f"{name} is a whole number from {low} on, got {value!r}")
        check_jobs(self.jobs)
        if not self.space.dim:
            raise CalibError("there is nothing to search: give at least one parameter a window")
        for reference in self.objective.references.values():
            check_solvable(self.model, reference)
        for name in (*self.space.windows, *self.space.fixed):
            check_stated(name, self.model, self.objective.references)
        for name in self.space.windows:
            check_searched(name, self.model, self.objective.references)
        for name in self.space.windows:  # a value that is fixed may belong to a record that is held out
            record = name.partition("@")[2]
            if "@" in name and record not in self.objective.references:
                known = list(self.objective.references)
                raise CalibError(f"{name!r} belongs to an unknown record{nearest(record, known)}; there are {known}")

    @property
    def evaluated_by(self) -> PoolSettings:
        """Where trials are evaluated: `pool`, or `jobs` child processes of this machine."""
        return PoolSettings(jobs=self.jobs) if self.pool is None else self.pool

    @property
    def header(self) -> StudyHeader:
        """What a store is opened with.

        Budget, jobs, pool, time-out and what concerns the store are not part of the definition.
        """
        screen = self.screen
        if screen is None:
            most = min(MAX_SCREEN_POINTS, self.budget // 4)
            screen = 1 << (most.bit_length() - 1) if most else 0  # a power of two keeps Sobol's points balanced
        screen += bool(self.space.start)
        windows = {name: asdict(window) for name, window in self.space.windows.items()}
        own: dict[str, Any] = {"seed": self.seed, "batch": self.batch, "screen": self.screen, "windows": windows}
        if self.space.start:
            own["start"] = dict(self.space.start)
        definition = {**own, "fixed": dict(self.space.fixed), **self.definition}
        return StudyHeader(self.name, definition, min(screen, self.budget), self.budget, self.code)

    def run(
        self,
        store: StoreContract,
        pool: Pool | None = None,
        on_trial: OnTrial | None = None,
        fresh: bool = False,
        on_opened: OnOpened | None = None,
        on_ask: Callable[[int], None] = lambda points: None,
        on_choice: Callable[[CostlyChoice], None] = lambda choice: None,
        ended: SearchEnd | None = None,
    ) -> SearchResult:
        """Search until the budget is spent, the optimiser stops, or Ctrl-C; take up what the store has already.

        The trials logged are replayed: the optimiser, made anew, asks again for the same points and is told what was
        logged. So a run that was killed and resumed, with any number of jobs, gives what one run would have given. If
        libraries or processor have changed meanwhile, or an optimiser has ended because its budget was spent and the
        study's is larger now, a new optimiser is told the trials so far as if they were a screen. If the code that the
        study uses has changed, earlier trials no longer count, and the best of them is evaluated again first, or those
        of the screen where none had a score.

        Parameters
        ----------
        store : see `StoreContract`; closed at the end
        pool : maps values to an `Evaluation` or `Failure`; those of `workers` unless given
        on_trial : called with each new trial, the best so far, and the number of trials there are
        fresh : set aside what the store has
        on_opened : called with the trials that the store has already
        on_ask : called with the number of points of which the optimiser asks the values at a time
        on_choice : called where emulators search for want of an optimiser that is named
        ended : how an earlier run ended; where nothing has changed since, the trials are not replayed

        Raises
        ------
        CalibError : the store belongs to another study; a replayed point differs from the logged one; the model refuses
            the first point
        FirstTrialsFailed : the first trials failed with one and the same exception
        """
        self.optimiser(dim=self.space.dim, seed=self.seed, budget=self.budget, batch=self.batch).close()  # refuses here
        own: OpenPool | None = None
        if pool is None:
            pool = own = workers(
                partial(evaluate, self.without_search()), self.evaluated_by, self.timeout, modules=self.code
            )
        logged = store.open(self.header, fresh)
        run = Search(self, store, pool, logged, on_trial, on_ask, on_choice)
        try:
            if on_opened is not None:
                on_opened(logged)
            stopped = run.to_the_end(ended)
        except KeyboardInterrupt:
            stopped = INTERRUPTED
        finally:
            if own is not None:
                own.close()
            store.close()
        trials = sorted(run.trials.values(), key=lambda trial: trial.number)
        return SearchResult(best(trials), trials, reach(trials), run.agreement, stopped, run.choice)

    def without_search(self) -> "CalibrationStudy":
        """Return what an evaluation needs of the study: it crosses to the child processes."""
        return replace(self, optimiser=_no_optimiser, costly_optimiser=None, definition={})


def _no_optimiser(**contract: int) -> Optimiser:
    """Stand in for the optimiser of a study that is only evaluated."""
    raise CalibError("this study was sent to be evaluated: it has no optimiser")
