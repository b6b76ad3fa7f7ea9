"""Progress of a running study on stderr: a live line on a terminal, elsewhere a line at intervals."""

import time
from collections.abc import Callable, Sequence

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bars

from calib.execution.progress import LINE_INTERVAL, clock_time
from calib.records import OK
from calib.store import Trial
from calib.store.trial import best
from calib.study.reachability import reach
from calib.units import count

MIN_SPREAD_TRIALS = 2  # of a screen that ended well, of which it is said what they reach
RATE_SECONDS = 20.0  # s over which the rate of trials is taken


class Progress:
    """Follows a study: `stage` by stage and, within screen and search, `trial` by trial. Use it in a with block.

    Parameters
    ----------
    budget : of trials
    draws : of the noise, which are propagated to the residuals after the search
    """

    def __init__(
        self,
        budget: int,
        quiet: bool = False,
        console: Console | None = None,
        clock: Callable[[], float] = time.monotonic,
        draws: int = 0,
    ):
        self._console = console or Console(stderr=True, highlight=False)
        self._quiet = quiet
        self._clock = clock
        self._budget, self._draws = budget, draws
        self._stage = "starting"
        self._done = self._failed = 0
        self._part = ""  # of the stage under way that is done
        self._compiling = False
        self._best: Trial | None = None
        self._ends: list[tuple[float, int]] = []  # when, how many trials by then
        self._screened: list[Trial] = []
        self._told = self._drawing = clock()
        self._bars: Bars | None = None

    def __enter__(self) -> "Progress":
        if self._console.is_terminal and not self._quiet:
            self._bars = Bars(
                SpinnerColumn(),
                TextColumn("{task.fields[stage]:<10}"),
                BarColumn(bar_width=20),
                TextColumn("{task.fields[text]}"),
                console=self._console,
                transient=True,
                refresh_per_second=8,
            )
            self._task = self._bars.add_task("study", total=self._budget, stage=self._stage, text="")
            self._bars.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        if self._bars is not None:
            self._bars.stop()
            self._bars = None
        if kind is KeyboardInterrupt and self._stage == "confidence" and self._draws:
            self.note("the draws of the noise are not kept: the next run makes them again")

    def note(self, text: str) -> None:
        """Say something in a line of its own."""
        if not self._quiet:
            self._console.print(escape(text), soft_wrap=True)

    def stage(self, name: str) -> None:
        """Say what begins: "dry run", "screen", "search", "confirm", "confidence", "hold-out", "report"."""
        if name != self._stage:
            self._stage, self._part = name, ""
            self._show(now=True)

    def earlier(self, trials: Sequence[Trial]) -> None:
        """Take in the trials of earlier runs, which are not made again."""
        self._done = len(trials)
        self._failed = sum(trial.status != OK for trial in trials)
        self._best = best(trials)
        self._screened = [trial for trial in trials if trial.phase == "screen"]
        if trials and not self._quiet:
            self._console.print(f"going on from {count(len(trials), 'trial')}")

    def trial(self, trial: Trial, top: Trial | None, count: int) -> None:
        """Take in a trial that has ended, the best one so far, and the number of trials there are."""
        self._done, self._best = count, top
        self._failed += trial.status != OK
        self._ends.append((self._clock(), count))
        if trial.phase == "screen":
            self._screened.append(trial)
        elif self._stage == "screen":
            self._say_reach()
        self._stage = trial.phase
        self._show()

    def compiling(self, compiling: bool) -> None:
        """Take in that kernels begin to be compiled, or that they are."""
        self._compiling = compiling
        self._show(now=True)

    def leader(self, done: int, total: int) -> None:
        """Take in that `done` of `total` leaders of the search have been simulated again."""
        self._part = f"{done}/{total} leaders"
        self._show(now=True)

    def draw(self, done: int, total: int) -> None:
        """Take in that `done` of `total` draws of the noise have been propagated to the residuals."""
        if not done:
            self._drawing = self._clock()
        self._part = f"{done}/{total} draws of the noise"
        if done:
            self._part += f"  {clock_time((self._clock() - self._drawing) / done * (total - done))} left of them"
        self._show()

    def _say_reach(self) -> None:
        """Say, before the search, which measured features no point of the screen comes to."""
        features = reach(self._screened)
        if self._quiet or not features:
            return
        if sum(trial.status == OK for trial in self._screened) < MIN_SPREAD_TRIALS:
            self._console.print("the screen is too small to say which measured features it reaches")
            return
        away = [r for r in features if not r.reached]
        for r in away:
            self._console.print(f"[yellow]no point of the screen reaches[/] {escape(str(r.summary()))}", soft_wrap=True)
        if not away:
            self._console.print("the screen reaches every measured feature")

    def line(self) -> str:
        """Best score, kind of motion, rate, failures and time left, as one line; whether kernels are compiled."""
        parts = [*(["compiling"] if self._compiling else []), f"{self._done}/{self._budget} trials"]
        if self._best is not None:
            parts.append(f"best {self._best.cost:.4g} ({self._best.kind})")
        rate = self._rate()
        if rate:
            parts.append(f"{rate:.3g} trials/s")
        parts.append(f"{self._failed} failed")
        if self._part:
            parts.append(self._part)
        if rate and self._stage in ("screen", "search"):
            then = f", then {self._draws} draws of the noise" if self._draws else ""
            parts.append(f"at most {clock_time((self._budget - self._done) / rate)} left{then}")
        return "  ".join(parts)

    def _rate(self) -> float:
        now = self._clock()
        while self._ends and now - self._ends[0][0] > RATE_SECONDS:
            self._ends.pop(0)
        if len(self._ends) < 2 or self._ends[-1][0] == self._ends[0][0]:
            return 0.0
        (first, before), (last, after) = self._ends[0], self._ends[-1]
        return (after - before) / (last - first)

    def _show(self, now: bool = False) -> None:
        if self._quiet:
            return
        if self._bars is not None:
            self._bars.update(self._task, completed=self._done, stage=self._stage, text=self.line())
        elif now or self._clock() - self._told >= LINE_INTERVAL:
            self._told = self._clock()
            self._console.print(f"{self._stage}: {self.line()}", soft_wrap=True)
