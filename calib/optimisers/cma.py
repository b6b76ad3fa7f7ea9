"""CMA-ES of the `cma` package, restarted with a growing population."""

from collections.abc import Sequence
from typing import Any

import cma
import numpy as np

from calib.optimisers.evolution import MIN_POPULATION_WIDTH
from calib.optimisers.outcome import OutcomeLike

MAX_FAILED_GENERATIONS = 3  # in a row, after which the run is begun elsewhere  [count]


class CmaEs:
    """Covariance matrix adaptation with restarts at twice the population (IPOP; Auger & Hansen 2005).

    The first run starts at the best point evaluated before the first ask, or in the middle of the cube; later ones
    start anywhere. It goes on until the budget is spent.

    Parameters
    ----------
    sigma : first standard deviation  [share of the window]
    popsize : of the first run; None for the package's own 4 + 3 log(dim), or the batch if that is more
    """

    def __init__(
        self,
        dim: int,
        seed: int,
        budget: int = 1000,
        batch: int = 1,
        sigma: float = 0.25,
        popsize: int | None = None,
    ):
        self._dim, self._budget, self._sigma, self._spent = dim, budget, sigma, 0
        self._size = max(4 + int(3 * np.log(dim)), batch) if popsize is None else popsize
        self._rng = np.random.default_rng(seed)
        self._start, self._lowest = np.full(dim, 0.5), np.inf
        self._run: Any = None  # of the package, which has no types
        self._genotypes: list[np.ndarray] | None = None
        self._costs: list[float] = []
        self._failed = 0

    def ask(self) -> np.ndarray:
        """The rest of the current generation (n, dim), cut to what is left of the budget."""
        if self._run is None:
            self._run = self._new_run(self._start)
        if self._genotypes is None:
            self._genotypes = self._run.ask()
        points = np.clip(np.array(self._genotypes)[len(self._costs) :, : self._dim], 0, 1)
        left = self._budget - self._spent
        return points[:left] if left > 0 else points

    def tell(self, x: np.ndarray, outcomes: Sequence[OutcomeLike]) -> None:
        """Take the outcomes of the points (n, dim) asked for last, or of others made before the first ask."""
        self._spent += len(outcomes)
        costs = [float(o.cost) if np.isfinite(o.cost) else np.inf for o in outcomes]
        if self._genotypes is None:
            best = int(np.argmin(costs))
            if costs[best] < self._lowest:
                self._start, self._lowest = np.array(x[best], float), costs[best]
            return
        self._costs += costs
        if len(self._costs) == len(self._genotypes):
            self._learn(self._genotypes, np.array(self._costs))
            self._genotypes, self._costs = None, []

    def stop(self) -> str | None:
        """The budget is spent, or None."""
        return "budget spent" if self._spent >= self._budget else None

    def close(self) -> None:
        """Nothing to end: no threads, no files."""

    def _new_run(self, start: np.ndarray) -> Any:
        """A run of the package on its own random stream; it needs two dimensions, so that one gets an idle second."""
        start = np.append(start, 0.5) if self._dim == 1 else start
        options = {
            "bounds": [0, 1],
            "popsize": self._size,
            "verbose": -9,
            "verb_log": 0,
            "signals_filename": "",
            "tolx": MIN_POPULATION_WIDTH,
            "seed": np.nan,
            "randn": lambda *shape: self._rng.standard_normal(shape),
        }
        return cma.CMAEvolutionStrategy(start, self._sigma, options)

    def _learn(self, genotypes: list[np.ndarray], costs: np.ndarray) -> None:
        """Report a generation's costs (n,): a failed point counts as the worst; a failed generation is dropped."""
        finite = np.isfinite(costs)
        self._failed = 0 if finite.any() else self._failed + 1
        if finite.any():
            self._run.tell(genotypes, np.where(finite, costs, costs[finite].max()))
        if self._failed >= MAX_FAILED_GENERATIONS:
            self._failed, self._run = 0, self._new_run(self._rng.random(self._dim))
        elif finite.any() and self._run.stop():
            self._size *= 2
            self._run = self._new_run(self._rng.random(self._dim))
