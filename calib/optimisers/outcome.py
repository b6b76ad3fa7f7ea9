"""What an optimiser learns of a point that it asked for."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np


class OutcomeLike(Protocol):
    """The outcome of an evaluation, as far as optimisers use it (`calib.study.contracts.Outcome`)."""

    @property
    def cost(self) -> float:
        """What to minimise; infinity where the evaluation failed."""
        ...

    @property
    def residuals(self) -> np.ndarray | None:
        """Residuals (n,); None where the evaluation failed, or where there is only a cost."""
        ...

    @property
    def kind(self) -> str | None:
        """Kind of the simulated motion."""
        ...


R = TypeVar("R")
Asking = Generator[np.ndarray, Sequence[OutcomeLike], R]  # yields points (n, dim), is sent their n outcomes, returns R


@dataclass(frozen=True)
class UsableOutcome:
    """What a search can use of an outcome."""

    cost: float
    residuals: np.ndarray | None
    kind: str | None


def usable_part(outcome: OutcomeLike) -> UsableOutcome:
    """An outcome whose cost is finite or inf, and whose residuals, if any, are finite."""
    cost = float(outcome.cost) if np.isfinite(outcome.cost) else np.inf
    residuals = None if outcome.residuals is None or cost == np.inf else np.asarray(outcome.residuals, float)
    if residuals is not None and not np.isfinite(residuals).all():
        residuals = None
    return UsableOutcome(cost, residuals, outcome.kind)
