"""A bounded least-squares search on the residual vector, as a generator that yields the points it wants evaluated."""

import numpy as np
from scipy.optimize import lsq_linear

from calib.optimisers.outcome import Asking, OutcomeLike

MIN_STEP_RADIUS = 1e-5  # of the window: a trust region below it ends the search
MAX_DIFFERENCE_STEP = 1e-2  # of the window: the widest finite difference
DIFFERENCE_OVER_RADIUS = 0.1  # finite difference, over the trust region's radius  [1]
MIN_RELATIVE_REDUCTION = 1e-4  # of the sum of squares, relative: a step that is predicted to bring less is not tried
MIN_BROYDEN_GAIN_RATIO = 0.5  # actual over predicted reduction, from which the Jacobian is only updated


def comparable_residuals(outcome: OutcomeLike, kind: str | None) -> np.ndarray | None:
    """Residuals of an outcome; None where it has none, or where its motion is of another kind."""
    return outcome.residuals if outcome.kind == kind else None


def descend(u: np.ndarray, outcome: OutcomeLike, radius: float = 0.1) -> Asking[tuple[np.ndarray, OutcomeLike]]:
    """Search from a point u (dim,) with its outcome, by a trust region in the maximum norm.

    The step is least in the linear model of the residuals within box and trust region (Voglis & Lagaris 2004,
    WSEAS conf. Corfu; Nocedal & Wright 2006, ch. 4 and 10.3). It is accepted by its cost, not by its residuals,
    since a wrong kind of motion costs more than its residuals say. Where the model predicts well, Broyden's update
    (1965, Math. Comp. 19, 577, eq. 4.5) stands in for a new Jacobian. Finite differences shrink with the trust
    region, so that on a cost with noise the first steps follow its wide slopes.

    Yields points (n, dim), is sent their n outcomes, returns the last point and its outcome.
    """
    residuals, jacobian, fresh = outcome.residuals, None, False
    while radius > MIN_STEP_RADIUS and residuals is not None:
        if jacobian is None:
            jacobian, fresh = (yield from differences(u, residuals, outcome.kind, radius)), True
        step = linear_step(jacobian, residuals, np.maximum(-u, -radius), np.minimum(1 - u, radius))
        new = np.clip(u + step, 0, 1)
        step = new - u
        now, predicted = square(residuals), square(residuals + jacobian @ step)
        if now - predicted <= MIN_RELATIVE_REDUCTION * now or np.abs(step).max() < MIN_STEP_RADIUS:
            if fresh:
                break
            jacobian = None
            continue
        (ahead,) = yield new[None]
        there = comparable_residuals(ahead, outcome.kind)
        if there is not None:
            ratio = (now - square(there)) / (now - predicted)
            jacobian = jacobian + np.outer(there - residuals - jacobian @ step, step) / (step @ step)
        else:
            ratio = -np.inf
        if ahead.cost < outcome.cost:
            u, outcome, residuals = new, ahead, ahead.residuals
            radius = next_radius(radius, ratio, np.abs(step).max())
            jacobian, fresh = (jacobian if ratio >= MIN_BROYDEN_GAIN_RATIO else None), False
        else:
            radius = 0.25 * min(radius, np.abs(step).max())
            jacobian = jacobian if fresh else None
    return u, outcome


def square(vector: np.ndarray) -> float:
    """Sum of squares."""
    return vector @ vector


def next_radius(radius: float, ratio: float, length: float) -> float:
    """Trust region after an accepted step of a given length and ratio of actual to predicted reduction."""
    if ratio > 0.7 and length > 0.9 * radius:
        return min(2 * radius, 0.5)
    return radius if ratio >= 0.25 else 0.5 * radius


def linear_step(jacobian: np.ndarray, residuals: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Step (dim,) within low..high that makes residuals + jacobian step least."""
    q, r = np.linalg.qr(jacobian)
    room = 1e-15  # lsq_linear wants low < high also on the bound
    return lsq_linear(r, -q.T @ residuals, bounds=(np.minimum(low, -room), np.maximum(high, room)), method="bvls").x


def differences(u: np.ndarray, residuals: np.ndarray, kind: str | None, radius: float) -> Asking[np.ndarray]:
    """Jacobian (residual, dim) by one-sided differences about a point of these residuals, one batch of points.

    The step is a share of the trust region and is compared with no other: the gain ratio of the next step shows whether
    the Jacobian is good, and a rejected step shrinks region and differences together. Where a derivative is the result
    itself, two steps are compared instead (`calib.confidence.derivatives`, `calib.diagnosis.signature`).

    A column whose point failed or moves in another way than the centre is tried once more on the other side, and is
    zero if that is no better: the search then leaves this parameter alone until the next Jacobian.
    """
    h = np.clip(DIFFERENCE_OVER_RADIUS * radius, MIN_STEP_RADIUS, MAX_DIFFERENCE_STEP)
    side = np.where(u + h > 1, -h, h)
    jacobian = np.zeros((residuals.size, u.size))
    open_columns = np.arange(u.size)
    for _ in range(2):
        points = np.repeat(u[None], open_columns.size, axis=0)
        points[np.arange(open_columns.size), open_columns] += side[open_columns]
        ahead = [comparable_residuals(outcome, kind) for outcome in (yield points)]
        for i, point, there in zip(open_columns, points, ahead, strict=True):
            if there is not None:
                jacobian[:, i] = (there - residuals) / (point[i] - u[i])
        failed = np.array([there is None for there in ahead])
        open_columns, side = open_columns[failed], -side
        open_columns = open_columns[(u + side >= 0)[open_columns] & (u + side <= 1)[open_columns]]
        if not open_columns.size:
            break
    return jacobian
