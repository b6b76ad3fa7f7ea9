"""The simulations of a diagnosis: counted, foreseen, and bounded by a budget."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.speculation import SpeculativePool
from calib.errors import CalibError
from calib.study import Pool
from calib.units import to_si


@dataclass(frozen=True)
class Budget:
    """Limits of a diagnosis, after which no further fit and no search of a next measurement begins.

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
        self.done = self.foreseen = 0

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as they end."""
        for index, result in self.pool.map(payloads):
            self.done += result.simulations if isinstance(result, SimulatedRows) else 1
            self.foreseen = max(self.foreseen, self.done)
            self._on_progress(self.done, self.foreseen)
            yield index, result

    def foresee(self, further: float) -> None:
        """Update the number of further simulations that are expected."""
        self.foreseen = self.done + round(further)
        self._on_progress(self.done, self.foreseen)

    @property
    def left(self) -> float:
        """Simulations for which the budget suffices, that of time at the pace so far; infinite without a budget."""
        simulations, seconds, passed = self._budget.simulations, self._budget.seconds, self._clock() - self._begin
        left = math.inf if simulations is None else max(0, simulations - self.done)
        if seconds is None or not passed > 0.0:
            return left
        return min(left, max(0.0, seconds - passed) * self.done / passed)

    @property
    def spent(self) -> bool:
        """Whether the budget is spent."""
        simulations, seconds = self._budget.simulations, self._budget.seconds
        over = simulations is not None and self.done >= simulations
        return over or (seconds is not None and self._clock() - self._begin >= seconds)
