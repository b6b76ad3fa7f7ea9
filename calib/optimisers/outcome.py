"""What an optimiser learns of a point that it asked for."""

from collections.abc import Generator, Sequence
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
