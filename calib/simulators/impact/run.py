"""From a problem to its motion: settle, then record."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.records import MIN_SECTION_PERIODS, OK
from calib.simulators.impact import kernel
from calib.simulators.impact.impact_record import advance_with_impacts
from calib.simulators.impact.initial_state import memory
from calib.simulators.impact.problem import AT_PERIOD, SECTIONS, STEPS, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch, scratch
from calib.simulators.impact.shooting import shoot

SETTLING_TOLERANCE = 1e-10  # relative change of the section
MAX_SETTLING_PERIODS = 1000  # after which a motion that has not settled is taken as it is
INITIAL_CAPACITY = 4096  # impacts that a record has room for; where there are more, it is made again with room for all
STATUS = {kernel.DIVERGED: "diverged", kernel.SPENT: "step budget", kernel.STALLED: "step budget"}


class SimulatedMotion(NamedTuple):
    """What a run gives.

    Attributes
    ----------
    status, reason : "ok", "diverged" or "step budget"
    settled : periods dropped before the recorded ones
    samples : (k, 2 n + 2) q [m], q' [m/s], U, U' at the requested times; U without its harmonic part
    sections : (MIN_SECTION_PERIODS or more, 2 n + 2) the same at the end of each of the last periods
    impacts : (k, 2 + 2 n) of the recorded periods: time since their start [s], closing speed [m/s], (q, q') before
    contact : share of the recorded time in permanent contact, or in compliant contact under a force  [1]
    steps : that the run took
    memory : at the end, see `initial_state.memory`
    """

    status: str
    reason: str
    settled: int
    samples: np.ndarray
    sections: np.ndarray
    impacts: np.ndarray
    contact: float
    steps: int
    memory: np.ndarray


@dataclass(frozen=True, eq=False)
class _Run:
    """A run in progress.

    Attributes
    ----------
    state : written by the kernel
    budget : steps that it may take in all
    """

    problem: Problem
    state: ImpactState
    w: Scratch
    budget: int

    @property
    def no_rows(self) -> np.ndarray:
        """No sections or samples (0, 2 n + 2), no impacts (0, 2 + 2 n)."""
        return np.zeros((0, 2 * len(self.state.y) + 2))

    def advance(self, periods: int, tolerance: float = 0.0) -> tuple[int, np.ndarray]:
        """Go on by so many periods, or until the section has settled; the outcome, and the sections taken."""
        rows, none = self._sections(periods), self.no_rows
        before = int(self.state.counters[SECTIONS])
        outcome = kernel.advance(
            self.problem, self.state, self.w, periods, tolerance, self.budget, rows, np.zeros(0), none, none
        )
        return outcome, rows[: int(self.state.counters[SECTIONS]) - before]

    def record(self, periods: int, times: np.ndarray, samples: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Go on by so many periods, writing `samples` at `times`; the outcome, the sections taken, all impacts."""
        rows, before = self._sections(periods), int(self.state.counters[SECTIONS])
        outcome, impacts = advance_with_impacts(
            self.problem, self.state, self.w, periods, self.budget, rows, times, samples, INITIAL_CAPACITY
        )
        return outcome, rows[: int(self.state.counters[SECTIONS]) - before], impacts

    def _sections(self, periods: int) -> np.ndarray:
        return np.zeros((periods, 2 * len(self.state.y) + 2))


def simulate(
    problem: Problem,
    state: ImpactState,
    times: np.ndarray,
    periods: int = 1,
    settle: int | None = None,
    sections: int = MIN_SECTION_PERIODS,
    budget: int = 50_000_000,
    near: bool = False,
) -> SimulatedMotion:
    """Settle, then record `periods` periods.

    Parameters
    ----------
    state : from `initial_state.start`; written
    times : (k,) when to sample, since the recorded periods' start  [s]
    settle : periods to drop; None: until the section changes by less than 1e-10 (of its largest displacement, velocity)
        against one of the 16 sections before, at most 1000 periods, and on until with the recorded periods there are
        `sections` of them
    sections : that the motion gives at least; where `settle` is given, the run goes on after the recorded periods for
        those that are missing
    near : whether the state lies near a motion that returns after one period: where shooting finds that motion, one
        period of it stands for all, whose `times` are the same, and there are no more sections than recorded periods
    """
    if near and problem.exact:
        periodic = shoot(problem, state, scratch(problem), budget)
        if periodic is not None:
            first = times[: len(times) // periods]
            return _repeated(simulate(problem, periodic, first, 1, 0, 1, budget), periods, problem.period)
    run = _Run(problem, state, scratch(problem), budget)
    outcome, dropped = _settled(run, settle, max(0, sections - periods))
    samples = np.zeros((len(times), 2 * len(state.y) + 2))
    recorded, impacts, contact = run.no_rows, run.no_rows, 0.0
    if outcome in (kernel.DONE, kernel.SETTLED):
        outcome, recorded, impacts, contact = _recorded(run, periods, times, samples)
    missing, after = sections - len(dropped) - len(recorded), run.no_rows
    if outcome == kernel.DONE and missing > 0:
        outcome, after = run.advance(missing)
    return SimulatedMotion(
        STATUS.get(outcome, OK), _reason(outcome, run), len(dropped), samples,
        np.concatenate([dropped, recorded, after])[-max(sections, periods, 1) :],
        impacts, contact, int(state.counters[STEPS]), memory(problem, state),
    )  # fmt: skip


def _settled(run: _Run, settle: int | None, more: int) -> tuple[int, np.ndarray]:
    """Let the motion settle; the outcome, and the sections on the way. `more` follow where it settles by itself."""
    if settle is not None:
        return run.advance(settle) if settle > 0 else (kernel.DONE, run.no_rows)
    outcome, dropped = run.advance(MAX_SETTLING_PERIODS, SETTLING_TOLERANCE)
    if outcome == kernel.SETTLED and more:
        outcome, rows = run.advance(more)
        dropped = np.concatenate([dropped, rows])
    return outcome, dropped


def _recorded(
    run: _Run, periods: int, times: np.ndarray, samples: np.ndarray
) -> tuple[int, np.ndarray, np.ndarray, float]:
    """Record periods, writing `samples` at `times`; the outcome, sections, impacts and the share of time in contact."""
    state, period = run.state, run.problem.period
    begins = int(state.counters[SECTIONS]) * period
    elapsed = periods * period - (state.clock[0] if begins == 0.0 else 0.0)  # a recorded input may begin before time 0
    contact_before = float(state.clock[1])
    outcome, sections, impacts = run.record(periods, np.array(times, dtype=float), samples)
    impacts[:, 0] -= begins
    return outcome, sections, impacts, (state.clock[1] - contact_before) / elapsed


def _reason(outcome: int, run: _Run) -> str:
    """Say why a run has ended, "" where it came to its end."""
    period = int(run.state.counters[AT_PERIOD])
    if outcome == kernel.DIVERGED:
        return f"the motion grew beyond bounds in period {period}"
    if outcome == kernel.STALLED:
        return f"the internal states of the force laws converge over no time step in period {period}"
    return f"{run.budget} steps were spent by period {period}" if outcome == kernel.SPENT else ""


def _repeated(one: SimulatedMotion, periods: int, period: float) -> SimulatedMotion:
    """Return the motion of so many periods that a motion of one makes when it returns."""
    impacts = np.tile(one.impacts, (periods, 1))
    impacts[:, 0] += np.repeat(np.arange(periods) * period, len(one.impacts))
    samples, sections = np.tile(one.samples, (periods, 1)), np.tile(one.sections, (periods, 1))
    return one._replace(samples=samples, sections=sections, impacts=impacts)
