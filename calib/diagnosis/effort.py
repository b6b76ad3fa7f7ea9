"""The simulations of a diagnosis: counted, foreseen, and bounded by a budget."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from calib.diagnosis.bench import SimulatedRows
from calib.errors import CalibError
from calib.study import Pool
from calib.units import to_si


@dataclass(frozen=True)
class Budget:
    """What a diagnosis may take before it begins no further fit.

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
            found = cls(simulations=int(text)) if number else cls(seconds=to_si(text, "s"))
        except CalibError as error:
            wanted = "a number of simulations or a time such as '10 min'"
            raise CalibError(f"budget: expected {wanted}, got {text!r}") from error
        if not (found.simulations or found.seconds or 0) > 0:
            raise CalibError(f"budget: expected more than nothing, got {text!r}")
        return found


class Effort:
    """A pool that counts what it simulates.

    Parameters
    ----------
    pool : maps `calib.diagnosis.bench.Run` to `SimulatedRows`
    budget : see there
    on_progress : called with the simulations that are done, and those that are foreseen in all
    """

    def __init__(
        self,
        pool: Pool,
        budget: Budget | None = None,
        on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._pool, self._budget, self._on_progress, self._clock = pool, budget or Budget(), on_progress, clock
        self._begin = clock()
        self.done = self.foreseen = 0

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result or Failure) as they end."""
        for index, result in self._pool.map(payloads):
            self.done += result.simulations if isinstance(result, SimulatedRows) else 1
            self.foreseen = max(self.foreseen, self.done)
            self._on_progress(self.done, self.foreseen)
            yield index, result

    def foresee(self, further: float) -> None:
        """Take in how many further simulations are foreseen now."""
        self.foreseen = self.done + round(further)
        self._on_progress(self.done, self.foreseen)

    @property
    def spent(self) -> bool:
        """Whether the budget is used up."""
        simulations, seconds = self._budget.simulations, self._budget.seconds
        over = simulations is not None and self.done >= simulations
        return over or (seconds is not None and self._clock() - self._begin >= seconds)
