"""The simulations of a diagnosis: counted, foreseen, and bounded by a budget."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.speculation import SpeculativePool
from calib.errors import CalibError
from calib.study import Pool
from calib.units import to_si

MIN_SECONDS = 1e-6  # between two readings of a clock: below it a pace means nothing
SCORE, SUSPECT, SEARCH = "score of a parameter", "refit of a suspect", "refits of a search"  # kinds of step
PAIR, SETTINGS = "fit of a pair", "search of a next measurement"

T = TypeVar("T")


class BudgetSpent(Exception):
    """A step of a search asks for more simulations than the budget leaves it."""


@dataclass(frozen=True)
class Budget:
    """Limits within which the search of a diagnosis ends, be it in the middle of a fit.

    After them a search for a force begins no further fit.

    Attributes
    ----------
    simulations : number; None: any
    seconds : wall-clock time  [s]; None: any
    """

    simulations: int | None = None
    seconds: float | None = None

    @classmethod
    def of(cls, text: str | None) -> "Budget":
        """Read a number of simulations, or a time with its unit.

        Raises
        ------
        CalibError : neither, or not above zero
        """
        if text is None:
            return cls()
        number = text.strip().lstrip("+-").isdigit()
        try:
            budget = cls(simulations=int(text)) if number else cls(seconds=to_si(text, "s"))
        except CalibError as error:
            wanted = "a number of simulations or a time such as '10 min'"
            raise CalibError(f"budget: expected {wanted}, got {text!r}") from error
        if not (budget.simulations or budget.seconds or 0) > 0:
            raise CalibError(f"budget: expected a number or a time above zero, got {text!r}")
        return budget


class Effort:
    """A pool that counts what is asked of it: known answers too, and nothing that is run ahead.

    Parameters
    ----------
    pool : maps `calib.diagnosis.bench.Run` to `SimulatedRows`
    budget : see there
    on_progress : called with the number of simulations done, and of those expected in all

    Attributes
    ----------
    done, foreseen : number of simulations, and of those expected in all
    later : stage -> number and kind of the steps that are expected in it, of stages that have not begun
    priors : kind of step -> simulations that one is expected to take before any is measured
    reserve : simulations that the search leaves to what follows it in any case
    spent : whether a step of the search was left out or broken off for the budget: then no further one begins
    """

    def __init__(
        self,
        pool: Pool,
        budget: Budget | None = None,
        on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.pool = pool if isinstance(pool, SpeculativePool) else SpeculativePool(pool)
        self._budget, self._on_progress, self._clock = budget or Budget(), on_progress, clock
        self._begin = clock()
        self._runs = self._attempts = 0
        self._ended: list[tuple[int, float]] = []  # simulations done and the time, as runs end
        self.done = self.foreseen = 0
        self.later: dict[str, tuple[float, str]] = {}
        self.priors: dict[str, float] = {}
        self._measured: dict[str, tuple[float, int]] = {}  # kind of step -> number of them, and their simulations
        self.reserve = 0.0
        self.spent = False

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as they end.

        Raises
        ------
        BudgetSpent : in an attempt for which the budget does not suffice; before any of them is run
        """
        asked = list(payloads)
        if self._attempts and not self.suffices(len(asked) * (self.done / self._runs if self._runs else 1.0)):
            raise BudgetSpent
        for index, result in self.pool.map(asked):
            self._runs += 1
            self.done += result.simulations if isinstance(result, SimulatedRows) else 1
            self.foreseen = max(self.foreseen, self.done + self._later)
            self._ended.append((self.done, self._clock()))
            self._on_progress(self.done, self.foreseen)
            yield index, result

    def attempt(self, step: Callable[[], T]) -> T | None:
        """Result of a step of the search; None where the budget does not suffice for all of it."""
        if not self.suffices():
            return None
        self._attempts += 1
        try:
            return step()
        except BudgetSpent:
            return None
        finally:
            self._attempts -= 1

    def suffices(self, simulations: float = 1.0) -> bool:
        """Whether the budget suffices for a step of the search of so many simulations; if not, it is spent."""
        self.spent = self.spent or self.left < simulations
        return not self.spent

    def foresee(self, further: float) -> None:
        """Update the number of further simulations that are expected in this stage."""
        self.foreseen = self.done + round(further + self.reserve) + self._later
        self._on_progress(self.done, self.foreseen)

    @contextmanager
    def measuring(self, kind: str, count: float = 1.0) -> Iterator[None]:
        """Measure the simulations of steps of a kind, by which further ones are foreseen."""
        begin = self.done
        yield
        number, simulations = self._measured.get(kind, (0.0, 0))
        self._measured[kind] = number + count, simulations + self.done - begin

    def expected(self, kind: str, count: float = 1.0) -> float:
        """Simulations of so many steps of a kind, by the mean of those so far, among which the prior counts as one."""
        number, simulations = self._measured.get(kind, (0.0, 0))
        return count * (self.priors.get(kind, 0.0) + simulations) / (1.0 + number)

    @property
    def _later(self) -> int:
        """Simulations that are expected in stages that have not begun."""
        return round(sum(self.expected(kind, count) for count, kind in self.later.values()))

    @property
    def left(self) -> float:
        """Simulations that the budget leaves to the search; infinite without one.

        That of time at the pace of the latter half of those so far: before, kernels may have been compiled.
        """
        simulations, seconds, now = self._budget.simulations, self._budget.seconds, self._clock()
        left = math.inf if simulations is None else simulations - self.done
        if seconds is not None and now > self._begin:
            begin, then = self._ended[len(self._ended) // 2] if len(self._ended) > 1 else (0, self._begin)
            pace = max(1, self.done - begin) / max(now - then, MIN_SECONDS)
            left = min(left, (seconds - (now - self._begin)) * pace)
        return max(0.0, left - self.reserve)
