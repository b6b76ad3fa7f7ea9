"""The leaders of a search, simulated again with higher fidelity before one of them is called the best."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.execution.pool import TIMEOUT, Failure, Pool
from calib.store import Trial
from calib.study.evaluation import Evaluation, as_trial

MAX_LEADERS = 4  # trials that are confirmed
MIN_SEPARATION = 1e-3  # of leaders, in the unit cube along the axis where they differ most
MIN_CHANGE, MIN_RELATIVE_CHANGE = 0.005, 0.2  # of the distance, and relative to it: a smaller one is not remarked on


@dataclass(frozen=True, eq=False)
class Leader:
    """One of the best trials of a search, simulated again.

    Attributes
    ----------
    searched : the trial as the search has it
    confirmed : the same trial as the confirming simulator has it: its score, or why there is none
    evaluation : with the records, or the Failure
    """

    searched: Trial
    confirmed: Trial
    evaluation: Evaluation | Failure


@dataclass(frozen=True, eq=False)
class Confirmation:
    """What became of the leaders of a search in the confirming simulator.

    Attributes
    ----------
    leaders : the best of the search first
    seconds : wall-clock time  [s]
    """

    leaders: tuple[Leader, ...]
    seconds: float

    @property
    def chosen(self) -> Leader:
        """The leader with the lowest confirmed cost; among equals, and where all fail, the best of the search."""
        return min(self.leaders, key=lambda leader: leader.confirmed.cost)

    @property
    def succeeded(self) -> bool:
        """Whether any leader could be confirmed."""
        return self.chosen.confirmed.scored

    @property
    def best(self) -> Trial:
        """The chosen trial with its confirmed score; as the search has it where none could be confirmed."""
        return self.chosen.confirmed if self.succeeded else self.chosen.searched

    @property
    def changed(self) -> bool:
        """Whether another trial than the best of the search was chosen."""
        return self.chosen is not self.leaders[0]

    @property
    def remarks(self) -> list[str]:
        """What to mind of it, a sentence each, without its full stop."""
        return [*self._not_confirmed(), *self._distance(), *self._order()]

    def _not_confirmed(self) -> list[str]:
        failed = [leader.confirmed for leader in self.leaders if not leader.confirmed.scored]
        if not failed:
            return []
        by_reason: dict[str, list[Trial]] = {}
        for trial in failed:
            by_reason.setdefault(f"{trial.status}: {trial.reason}", []).append(trial)
        reasons = "; ".join(f"{_numbered(trials)} ({reason})" for reason, trials in by_reason.items())
        hint = ", which a longer [study] timeout may mend" if TIMEOUT in {trial.status for trial in failed} else ""
        if self.succeeded:
            return [f"not every leader of the search could be confirmed: {reasons}{hint}"]
        return [
            "nothing is confirmed: values and distances are those of the simulator of the search, because the "
            f"confirming one failed at each of its leaders: {reasons}{hint}"
        ]

    def _distance(self) -> list[str]:
        before, after = self.chosen.searched.cost, self.best.cost
        if abs(after - before) <= max(MIN_RELATIVE_CHANGE * before, MIN_CHANGE):
            return []
        return [
            f"the best point, {_numbered([self.best])}, is at a distance of {after:.3g} in the confirming "
            f"simulator and of {before:.3g} in that of the search, which is not to be relied on there"
        ]

    def _order(self) -> list[str]:
        before = [leader.confirmed for leader in self.leaders if leader.confirmed.scored]
        after = sorted(before, key=lambda trial: trial.cost)
        if before == after:
            return []
        return [
            "the confirming simulator puts the leaders of the search in another order: "
            f"{_numbered(after)}, not {_numbered(before)}"
        ]


def _numbered(trials: Sequence[Trial]) -> str:
    return f"trial{'' if len(trials) == 1 else 's'} {', '.join(str(trial.number) for trial in trials)}"


def leaders(trials: Sequence[Trial]) -> list[Trial]:
    """Return up to `MAX_LEADERS` of the best trials, the best first, each `MIN_SEPARATION` away from better ones."""
    chosen: list[Trial] = []
    for trial in sorted((trial for trial in trials if trial.scored), key=lambda trial: trial.rank):
        if all(np.abs(np.subtract(trial.u, other.u)).max() > MIN_SEPARATION for other in chosen):
            chosen.append(trial)
        if len(chosen) == MAX_LEADERS:
            break
    return chosen


def confirm(pool: Pool, searched: Sequence[Trial], on_leader: Callable[[int, int], None] | None = None) -> Confirmation:
    """Simulate the leaders of a search again.

    Parameters
    ----------
    pool : maps values to an `Evaluation` or `Failure` by the confirming simulator
    searched : trials of the search, the best first; at least one
    on_leader : called with the number of leaders done and of all of them
    """
    begin = time.monotonic()
    evaluations: dict[int, Evaluation | Failure] = {}
    for index, evaluation in pool.map([trial.values for trial in searched]):
        evaluations[index] = evaluation
        if on_leader is not None:
            on_leader(len(evaluations), len(searched))
    confirmed = tuple(_leader(trial, evaluations[index]) for index, trial in enumerate(searched))
    return Confirmation(confirmed, time.monotonic() - begin)


def _leader(trial: Trial, evaluation: Evaluation | Failure) -> Leader:
    confirmed = as_trial(trial.number, trial.u, trial.values, evaluation, trial.phase, trial.segment)
    return Leader(trial, confirmed, evaluation)
