"""A bounded least-squares search on the residual vector, as a generator that yields the points it wants evaluated."""

import numpy as np
from scipy.optimize import lsq_linear

SMALLEST_STEP = 1e-5  # of the window: a trust region below it ends the search
LARGEST_DIFFERENCE = 1e-2  # of the window: the widest finite difference
DIFFERENCE = 0.1  # finite difference as a share of the trust region's radius
LEAST_GAIN = 1e-4  # relative fall of the sum of squares below which a step is not worth asking for
TRUSTED = 0.5  # ratio of gained to predicted fall above which the Jacobian is only updated


def usable(outcome, like=None):
    """Whether an outcome has residuals and, if `like` is given, the same kind of motion."""
    return outcome.residuals is not None and (like is None or outcome.kind == like.kind)


def descend(u, outcome, radius=0.1):
    """Search from a point u (dim,) with its outcome, by a trust region in the maximum norm.

    The step is least in the linear model of the residuals within box and trust region (Voglis & Lagaris 2004,
    WSEAS conf. Corfu; Nocedal & Wright 2006, ch. 4 and 10.3). It is accepted by its cost, not by its residuals,
    since a wrong kind of motion costs more than its residuals say. Where the model predicts well, Broyden's update
    (1965, Math. Comp. 19, 577, eq. 4.5) stands in for a new Jacobian. Finite differences shrink with the trust
    region, so that on a rough cost the first steps follow its wide slopes.

    Yields points (n, dim), is sent their n outcomes, returns the last point and its outcome.
    """
    jacobian, fresh = None, False
    while radius > SMALLEST_STEP:
        if jacobian is None:
            jacobian, fresh = (yield from differences(u, outcome, radius)), True
        step = linear_step(jacobian, outcome.residuals, np.maximum(-u, -radius), np.minimum(1 - u, radius))
        new = np.clip(u + step, 0, 1)
        step = new - u
        now, predicted = square(outcome.residuals), square(outcome.residuals + jacobian @ step)
        if now - predicted <= LEAST_GAIN * now or np.abs(step).max() < SMALLEST_STEP:
            if fresh:
                break
            jacobian = None
            continue
        (told,) = yield new[None]
        if usable(told, like=outcome):
            ratio = (now - square(told.residuals)) / (now - predicted)
            jacobian = jacobian + np.outer(told.residuals - outcome.residuals - jacobian @ step, step) / (step @ step)
        else:
            ratio = -np.inf
        if told.cost < outcome.cost:
            u, outcome = new, told
            if not usable(told):
                break
            radius = next_radius(radius, ratio, np.abs(step).max())
            jacobian, fresh = (jacobian if ratio >= TRUSTED else None), False
        else:
            radius = 0.25 * min(radius, np.abs(step).max())
            jacobian = jacobian if fresh else None
    return u, outcome


def square(vector):
    """Sum of squares."""
    return vector @ vector


def next_radius(radius, ratio, length):
    """Trust region after an accepted step of a given length and ratio of gained to predicted fall."""
    if ratio > 0.7 and length > 0.9 * radius:
        return min(2 * radius, 0.5)
    return radius if ratio >= 0.25 else 0.5 * radius


def linear_step(jacobian, residuals, low, high):
    """Step (dim,) within low..high that makes residuals + jacobian step least."""
    q, r = np.linalg.qr(jacobian)
    room = 1e-15  # lsq_linear wants low < high also on the bound
    return lsq_linear(r, -q.T @ residuals, bounds=(np.minimum(low, -room), np.maximum(high, room)), method="bvls").x


def differences(u, outcome, radius):
    """Jacobian (residual, dim) by one-sided differences, one batch of points.

    A column whose point failed or moves in another way than the centre is tried once more on the other side, and is
    zero if that is no better: the search then leaves this parameter alone until the next Jacobian.
    """
    h = np.clip(DIFFERENCE * radius, SMALLEST_STEP, LARGEST_DIFFERENCE)
    side = np.where(u + h > 1, -h, h)
    jacobian = np.zeros((outcome.residuals.size, u.size))
    open_columns = np.arange(u.size)
    for _ in range(2):
        points = np.repeat(u[None], open_columns.size, axis=0)
        points[np.arange(open_columns.size), open_columns] += side[open_columns]
        outcomes = yield points
        good = np.array([usable(told, like=outcome) for told in outcomes])
        for i, point, told in zip(open_columns[good], points[good], np.array(outcomes, object)[good], strict=True):
            jacobian[:, i] = (told.residuals - outcome.residuals) / (point[i] - u[i])
        open_columns, side = open_columns[~good], -side
        open_columns = open_columns[(u + side >= 0)[open_columns] & (u + side <= 1)[open_columns]]
        if not open_columns.size:
            break
    return jacobian
