"""The least sum of squares of the residuals where some parameters are held."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize

from calib.confidence.derivatives import Evaluate
from calib.objective.objective import MIN_COST_OF_WRONG_KIND
from calib.records import OK
from calib.study import Outcome

MIN_EDGE_DISTANCE = 1e-9  # of the window: the search of free parameters stays inside by it  [1]
MAX_DESCENT_EVALUATIONS = 30  # of the residuals in one descent, without differences  [count]
MIN_STEP = 1e-8  # relative change of the parameters that ends a descent  [1]
DIFFERENCE_STEP_ERRORS = 0.1  # one-sided difference, in standard errors of the parameter  [1]
DIFFERENCE_STEP_BOUNDS = (1e-5, 1e-2)  # of the window  [1]
SIMPLEX_STEP_BOUNDS = (1e-3, 0.1)  # of the window  [1]: about half a standard error
SIMPLEX_EVALUATIONS = 40  # of a search without derivatives, for each free parameter  [count]
MAX_SIMPLEX_COST = 1e12  # of a failed simulation: a simplex cannot take infinity  [1]
COST_WITHOUT_SQUARE = 1e6  # times the sum of squares at the best point  [1]: of a point that cannot be compared


@dataclass(frozen=True)
class FittedPoint:
    """The best point where some parameters are held.

    Attributes
    ----------
    u : in the unit cube
    square : least sum of squares of the residuals; infinite where no point can be compared with the measurement
    cost : of the objective; infinite where the simulation fails
    kind : of the simulated motion
    reason : why no point can be compared; "" where one can
    evaluations : that it took
    """

    u: tuple[float, ...]
    square: float
    cost: float
    kind: str | None = None
    reason: str = ""
    evaluations: int = 0


@dataclass(frozen=True, eq=False)
class ConstrainedFit:
    """Fits the free parameters where the others are held.

    By SciPy's trust-region reflective least squares from the best of several starts. Where no start can be compared
    with the measurement (the simulation fails, or moves in a wrong way), or where residuals have no derivatives, Nelder
    and Mead's simplex searches on the cost of the objective, which has a slope there too.

    Attributes
    ----------
    evaluate : points (n, dim) -> n outcomes
    residuals, cost : (m,) of the best point, and the cost of the objective there
    errors : (dim,) standard errors in the unit cube, the scale of the steps
    accuracy : of the least sum of squares
    differentiable : whether the residuals have derivatives at the best point
    """

    evaluate: Evaluate
    residuals: np.ndarray
    cost: float
    errors: np.ndarray
    accuracy: float
    differentiable: bool = True

    def __call__(self, starts: Sequence[np.ndarray], free: np.ndarray) -> FittedPoint:
        """Fit from the best of the starts (n, dim), of which those not `free` (dim, bool) are equal."""
        points = np.array(starts, dtype=float)
        points[:, free] = np.clip(points[:, free], MIN_EDGE_DISTANCE, 1.0 - MIN_EDGE_DISTANCE)
        search = _Descent(self, free, np.unique(points, axis=0))
        if not free.any():
            return search.best()
        if not math.isfinite(search.square):
            search.simplex(until_comparable=True)
        if math.isfinite(search.square):
            search.descend()
            if not self.differentiable:
                search.simplex()
        return search.best()

    def at(self, points: np.ndarray) -> list[FittedPoint]:
        """Evaluate points (n, dim) in which all parameters are held."""
        return [self._point(u, outcome) for u, outcome in zip(points, self.evaluate(points), strict=True)]

    def _point(self, u: np.ndarray, outcome: Outcome) -> FittedPoint:
        _, square, reason = self.compared(outcome)
        return FittedPoint(tuple(u.tolist()), square, float(outcome.cost), outcome.kind, reason, 1)

    def compared(self, outcome: Outcome) -> tuple[np.ndarray | None, float, str]:
        """Residuals (m,) of a point, their sum of squares, and why it cannot be compared: None and infinity then."""
        if reason := self.why_incomparable(outcome):
            return None, math.inf, reason
        residuals = np.asarray(outcome.residuals, dtype=float)
        return residuals, float(residuals @ residuals), ""

    def why_incomparable(self, outcome: Outcome) -> str:
        """Why a point cannot be compared with the best one; "" where it can, be its kind of motion another or not."""
        if outcome.status != OK:
            return f"the simulation ends with status {outcome.status!r}"
        if outcome.residuals is None or not np.all(np.isfinite(outcome.residuals)):
            return "the simulation gives no finite residuals"
        if outcome.residuals.shape != self.residuals.shape:
            return f"the simulation gives {outcome.residuals.size} residuals, not {self.residuals.size}"
        if outcome.cost >= MIN_COST_OF_WRONG_KIND > self.cost:
            return f"the motion is {outcome.kind}, which is not the measured kind"
        return ""


class _Flat(Exception):
    """No free parameter changes any residual: there is nothing to descend."""


class _Answer(NamedTuple):
    """Residuals (m,) of a point, None where it cannot be compared, and the cost of the objective, a finite one."""

    residuals: np.ndarray | None
    cost: float


class _Descent:
    """One fit: the best point so far, and what improves it."""

    def __init__(self, fit: ConstrainedFit, free: np.ndarray, starts: np.ndarray):
        self.fit, self.free, self.number = fit, free, 0
        self.u, self.square, self.cost = starts[0], math.inf, math.inf
        self.kind: str | None = None
        self.reason = ""
        self.residuals = np.empty(0)
        self._evaluated(starts)

    def best(self) -> FittedPoint:
        return FittedPoint(tuple(self.u.tolist()), self.square, self.cost, self.kind, self.reason, self.number)

    def _evaluated(self, points: np.ndarray) -> list[_Answer]:
        """Evaluate points (n, dim); the best one is remembered."""
        self.number += len(points)
        answers = list[_Answer]()
        for u, outcome in zip(points, self.fit.evaluate(points), strict=True):
            residuals, square, reason = self.fit.compared(outcome)
            closer = not math.isfinite(self.square) and (outcome.cost < self.cost or not self.reason)
            if square < self.square or closer:
                self.u, self.square, self.cost, self.kind, self.reason = u, square, outcome.cost, outcome.kind, reason
                self.residuals = np.empty(0) if residuals is None else residuals
            answers.append(_Answer(residuals, min(outcome.cost, MAX_SIMPLEX_COST)))
        return answers

    def descend(self) -> None:
        """Least squares from the best point so far."""
        start, size = self.u[self.free], self.fit.residuals.size
        latest = {start.tobytes(): self.residuals}

        def fun(x: np.ndarray) -> np.ndarray:
            if x.tobytes() not in latest:
                [ahead] = self._evaluated(self._whole(x)[None])
                latest.clear()
                residuals = np.full(size, np.nan) if ahead.residuals is None else ahead.residuals
                latest[x.tobytes()] = residuals  # SciPy shortens a step that leads to NaN
            return latest[x.tobytes()]

        def jacobian(x: np.ndarray) -> np.ndarray:
            columns = self._jacobian(x, fun(x))
            if not columns.any():
                raise _Flat
            return columns

        scale = np.clip(self.fit.errors[self.free], *DIFFERENCE_STEP_BOUNDS)
        with suppress(_Flat):
            optimize.least_squares(
                fun, start, jac=jacobian, bounds=(0.0, 1.0), method="trf", x_scale=scale,
                max_nfev=MAX_DESCENT_EVALUATIONS, xtol=MIN_STEP, gtol=None,
                ftol=float(np.clip(self.fit.accuracy / max(self.square, 1e-300), 1e-14, 0.1)),
            )  # fmt: skip

    def _jacobian(self, x: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """One-sided differences (m, free); a column that fails is tried on the other side, else it is zero."""
        steps = np.clip(DIFFERENCE_STEP_ERRORS * self.fit.errors[self.free], *DIFFERENCE_STEP_BOUNDS)
        side = np.where(x + steps > 1.0, -steps, steps)
        jacobian = np.zeros((centre.size, x.size))
        missing = np.arange(x.size)
        for sign in (1.0, -1.0):
            ahead = x + np.diag(sign * side)[missing]
            inside = np.all((ahead >= 0.0) & (ahead <= 1.0), axis=1)
            missing, ahead = missing[inside], ahead[inside]
            if not missing.size:
                break
            answers = self._evaluated(np.array([self._whole(one) for one in ahead]))
            for k, answer in zip(missing, answers, strict=True):
                if answer.residuals is not None:
                    jacobian[:, k] = (answer.residuals - centre) / (sign * side[k])
            missing = missing[[answer.residuals is None for answer in answers]]
        return jacobian

    def simplex(self, until_comparable: bool = False) -> None:
        """Nelder and Mead's search from the best point so far; where it is asked, until a point can be compared."""
        penalty = COST_WITHOUT_SQUARE * max(float(self.fit.residuals @ self.fit.residuals), self.fit.accuracy)
        start = self.u[self.free]
        steps = np.clip(0.5 * self.fit.errors[self.free], *SIMPLEX_STEP_BOUNDS)
        corners = start + np.vstack([np.zeros(start.size), np.diag(np.where(start + steps > 1.0, -steps, steps))])

        def value(x: np.ndarray) -> float:
            [answer] = self._evaluated(self._whole(x)[None])
            if answer.residuals is None:
                return penalty + answer.cost
            return float(answer.residuals @ answer.residuals)

        def stop(intermediate_result: optimize.OptimizeResult) -> None:
            if until_comparable and (math.isfinite(self.square) or not math.isfinite(self.cost)):
                raise StopIteration  # found, or every corner fails: there is no slope to follow

        optimize.minimize(
            value, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * start.size, callback=stop,
            options={
                "initial_simplex": corners, "maxfev": SIMPLEX_EVALUATIONS * start.size, "fatol": self.fit.accuracy,
                "xatol": MIN_EDGE_DISTANCE,
            },
        )  # fmt: skip

    def _whole(self, x: np.ndarray) -> np.ndarray:
        whole = self.u.copy()
        whole[self.free] = x
        return whole
