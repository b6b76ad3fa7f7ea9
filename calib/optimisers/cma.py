"""CMA-ES of the `cma` package, restarted with a growing population."""

import cma
import numpy as np

PATIENCE = 3  # generations that failed altogether before the run is begun elsewhere
SMALLEST = 1e-4  # of the window: a population no wider than this ends the run


class CmaEs:
    """Covariance matrix adaptation with restarts at twice the population (IPOP; Auger & Hansen 2005).

    The first run starts at the best point told before the first ask, or in the middle of the cube; later ones start
    anywhere. It goes on until the budget is spent.

    Parameters
    ----------
    sigma : first standard deviation  [share of the window]
    popsize : of the first run; None for the package's own 4 + 3 log(dim), or the batch if that is more
    """

    def __init__(self, dim, seed, budget=1000, batch=1, sigma=0.25, popsize=None):
        self._dim, self._budget, self._sigma, self._spent = dim, budget, sigma, 0
        self._size = max(4 + int(3 * np.log(dim)), batch) if popsize is None else popsize
        self._rng = np.random.default_rng(seed)
        self._start, self._lowest = np.full(dim, 0.5), np.inf
        self._run, self._genotypes, self._costs, self._failed = None, None, [], 0

    def ask(self):
        """The rest of the current generation (n, dim), cut to what is left of the budget."""
        if self._run is None:
            self._run = self._new_run(self._start)
        if self._genotypes is None:
            self._genotypes = self._run.ask()
        points = np.clip(np.array(self._genotypes)[len(self._costs) :, : self._dim], 0, 1)
        left = self._budget - self._spent
        return points[:left] if left > 0 else points

    def tell(self, x, outcomes):
        """Take the outcomes of the points (n, dim) asked for last, or of others made before the first ask."""
        self._spent += len(outcomes)
        costs = [float(o.cost) if np.isfinite(o.cost) else np.inf for o in outcomes]
        if self._run is None:
            best = int(np.argmin(costs))
            if costs[best] < self._lowest:
                self._start, self._lowest = np.array(x[best], float), costs[best]
            return
        self._costs += costs
        if len(self._costs) == len(self._genotypes):
            self._learn(np.array(self._costs))
            self._genotypes, self._costs = None, []

    def stop(self):
        """The budget is spent, or None."""
        return "budget spent" if self._spent >= self._budget else None

    def close(self):
        """Nothing to end: no threads, no files."""

    def _new_run(self, start):
        """A run of the package on a stream of its own; it knows no single dimension, so that gets an idle second."""
        start = np.append(start, 0.5) if self._dim == 1 else start
        options = {
            "bounds": [0, 1],
            "popsize": self._size,
            "verbose": -9,
            "verb_log": 0,
            "signals_filename": "",
            "tolx": SMALLEST,
            "seed": np.nan,
            "randn": lambda *shape: self._rng.standard_normal(shape),
        }
        return cma.CMAEvolutionStrategy(start, self._sigma, options)

    def _learn(self, costs):
        """Hand a generation's costs (n,) over: a failed run counts as its worst, one that failed altogether not."""
        finite = np.isfinite(costs)
        self._failed = 0 if finite.any() else self._failed + 1
        if finite.any():
            self._run.tell(self._genotypes, np.where(finite, costs, costs[finite].max()))
        if self._failed >= PATIENCE:
            self._failed, self._run = 0, self._new_run(self._rng.random(self._dim))
        elif finite.any() and self._run.stop():
            self._size *= 2
            self._run = self._new_run(self._rng.random(self._dim))
