"""Methods of scipy.optimize, which meet the study at each evaluation."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from scipy import optimize

from calib.execution.conversation import Conversation
from calib.optimisers.outcome import OutcomeLike

Evaluate: TypeAlias = Callable[[np.ndarray], Sequence[OutcomeLike]]  # points (n, dim) -> n outcomes
COST_OF_FAILED_RUN = 1e12  # for methods that cannot take infinity  [1]
ONE_SIDED_DIFFERENCE_STEP = 1e-4  # of the window: one-sided differences of the method least_squares  [1]


class Scipy:
    """A method of scipy.optimize, until it converges.

    It starts from the best point evaluated before the first ask, or from a random one.

    Parameters
    ----------
    method : "differential_evolution" (asks a generation at a time), "dual_annealing" (one point at a time) or
        "least_squares" (on the residual vector, whose Jacobian's columns are one batch; it judges by the residuals
        alone, so a wrong kind of motion is not held against a point)
    """

    def __init__(self, dim: int, seed: int, budget: int = 1000, batch: int = 1, method: str = "differential_evolution"):
        methods: dict[str, Callable[[Evaluate], str]] = {
            "differential_evolution": self._differential_evolution,
            "dual_annealing": self._dual_annealing,
            "least_squares": self._least_squares,
        }
        if method not in methods:
            raise ValueError(f"unknown method {method!r}; known are {', '.join(methods)}")
        self._dim, self._budget, self._method, self._spent = dim, budget, methods[method], 0
        self._rng = np.random.default_rng(seed)
        self._start: np.ndarray | None = None
        self._lowest = np.inf
        self._conversation: Conversation[np.ndarray, Sequence[OutcomeLike]] | None = None
        self._outcomes: list[OutcomeLike] = []

    def ask(self) -> np.ndarray:
        """What the method waits for (n, dim), cut to what is left of the budget; its exception if it raised one."""
        if self._conversation is None:
            self._conversation = Conversation(self._method)
        event, what = self._conversation.waiting()
        if event == "raised":
            raise what
        if event == "ended":
            raise RuntimeError(f"the method has ended ({what}); look at stop() before asking")
        points, left = what[len(self._outcomes) :], self._budget - self._spent
        return points[:left] if left > 0 else points

    def tell(self, x: np.ndarray, outcomes: Sequence[OutcomeLike]) -> None:
        """Take the outcomes of the points (n, dim) asked for last, or of others made before the first ask."""
        self._spent += len(outcomes)
        if self._conversation is None:
            for u, outcome in zip(x, outcomes, strict=True):
                if outcome.cost < self._lowest:
                    self._start, self._lowest = np.array(u, float), outcome.cost
            return
        self._outcomes += outcomes
        if len(self._outcomes) == len(self._conversation.waiting()[1]):
            answer, self._outcomes = self._outcomes, []
            self._conversation.tell(answer)

    def stop(self) -> str | None:
        """The budget is spent, the method's own reason once it has ended, or None."""
        if self._spent >= self._budget:
            return "budget spent"
        if self._conversation is None:
            return None
        event, what = self._conversation.waiting()
        return what if event == "ended" else None

    def close(self) -> None:
        """End the thread in which the method runs; safe to call twice."""
        if self._conversation is not None:
            self._conversation.close()

    # ------------------------------------------------------------------------ what runs in the thread, one at a time
    def _differential_evolution(self, evaluate: Evaluate) -> str:
        def costs(x: np.ndarray) -> np.ndarray:
            outcomes = evaluate(np.clip(x.T.reshape(-1, self._dim), 0, 1))
            return np.array([cost(outcome, failed=np.inf) for outcome in outcomes])

        return optimize.differential_evolution(
            costs,
            [(0, 1)] * self._dim,
            x0=self._start,
            rng=self._rng,
            maxiter=self._budget,
            polish=False,
            vectorized=True,
            updating="deferred",
        ).message

    def _dual_annealing(self, evaluate: Evaluate) -> str:
        return ". ".join(
            optimize.dual_annealing(
                lambda u: cost(evaluate(np.clip(u, 0, 1)[None])[0]),
                [(0, 1)] * self._dim,
                x0=self._start,
                rng=self._rng,
                maxiter=10 * self._budget,
                maxfun=10 * self._budget,
            ).message
        )

    def _least_squares(self, evaluate: Evaluate) -> str:
        """Trust-region-reflective least squares from the first of start and random points that does not fail."""
        start = self._rng.random(self._dim) if self._start is None else self._start
        while (first := residuals(evaluate(start[None])[0])) is None:
            start = self._rng.random(self._dim)
        size, latest = first.size, {start.tobytes(): first}

        def fun(u: np.ndarray) -> np.ndarray:
            if u.tobytes() not in latest:
                ahead = residuals(evaluate(u[None])[0])
                latest.clear()
                latest[u.tobytes()] = np.full(size, np.nan) if ahead is None else ahead
            return latest[u.tobytes()]

        def jacobian(u: np.ndarray) -> np.ndarray:
            centre, h = fun(u), np.where(u > 0.5, -ONE_SIDED_DIFFERENCE_STEP, ONE_SIDED_DIFFERENCE_STEP)
            columns = [residuals(outcome) for outcome in evaluate(u + np.diag(h))]
            return np.array(
                [
                    np.zeros(size) if column is None else (column - centre) / step
                    for column, step in zip(columns, h, strict=True)
                ]
            ).T

        return optimize.least_squares(fun, start, jac=jacobian, bounds=(0, 1), method="trf").message


def cost(outcome: OutcomeLike, failed: float = COST_OF_FAILED_RUN) -> float:
    """Cost of an outcome, a given one if it failed."""
    return float(outcome.cost) if np.isfinite(outcome.cost) else failed


def residuals(outcome: OutcomeLike) -> np.ndarray | None:
    """Residuals of an outcome, None where it failed.

    Raises
    ------
    ValueError : the run is good but has no residuals
    """
    if not np.isfinite(outcome.cost):
        return None
    if outcome.residuals is None:
        raise ValueError(
            "scipy's least_squares needs residuals, and these outcomes have only a cost; "
            "take method = 'differential_evolution' or 'dual_annealing'"
        )
    return np.asarray(outcome.residuals, float)
