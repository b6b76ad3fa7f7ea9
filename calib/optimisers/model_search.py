"""A bounded search on a scalar cost by quadratic models, as a generator that yields the points it wants evaluated."""

from collections.abc import Sequence

import numpy as np

from calib.optimisers.archive import Archive
from calib.optimisers.outcome import Asking, OutcomeLike
from calib.optimisers.quadratic import Quadratic, nearest_model

MIN_TRUST_RADIUS = 1e-4  # of the window: a trust region below it ends the search
MODEL_RADII = 2.0  # radii: points farther than this do not enter the model
HESSIAN_STIFFNESS = 1e-6  # penalty of a squared unit change of the hessian, in squared shares of the points' costs
MIN_OFFSET_RADII = 0.1  # radii: of the points' offsets, from which they span all directions
MIN_STEP_RADII = 0.05  # radii: where the step is shorter the trust region is made smaller instead
MIN_REDUCTION_OVER_SPREAD = 1e-7  # predicted, over the spread of the costs: below it no step is tried  [1]


def descend(
    u: np.ndarray, outcome: OutcomeLike, archive: Archive, radius: float = 0.1
) -> Asking[tuple[np.ndarray, OutcomeLike]]:
    """Search from a point u (dim,) with its outcome, by a trust region in the maximum norm.

    The model is the quadratic nearest to its predecessor through the evaluated points around u, also those of other
    searches (`archive`, to which the caller adds every answer before sending it). Where a step fails and the points
    lie flat, the next one is spent on the flattest direction. After Powell (2009, BOBYQA, report DAMTP 2009/NA06) and
    Conn, Scheinberg & Vicente (2009, Introduction to Derivative-Free Optimization, ch. 10), much simplified.

    Yields points (n, dim), is sent their n outcomes, returns the last point and its outcome.
    """
    dim = u.size
    hessian = np.zeros((dim, dim))
    first = u + np.diag(np.where(u + radius > 1, -radius, radius))
    u, outcome = better(u, outcome, first, (yield first))
    while radius > MIN_TRUST_RADIUS:
        offsets, costs = archive.near(u, MODEL_RADII * radius, (dim + 1) * (dim + 2))
        z, fall = offsets / radius, costs - outcome.cost
        scale = max(np.abs(fall).max(initial=0.0), 1e-300)
        model = local_model(z, fall / scale, hessian * radius**2 / scale)
        hessian = model.hessian * scale / radius**2
        step = model.lowest(np.maximum(-u / radius, -1), np.minimum((1 - u) / radius, 1))
        predicted, flattest = (model.level - model(step)) * scale, flattest_direction(z)
        improved = False
        if (
            predicted > MIN_REDUCTION_OVER_SPREAD * spread(archive.costs, outcome.cost)
            and np.abs(step).max() >= MIN_STEP_RADII
        ):
            new = np.clip(u + radius * step, 0, 1)
            (ahead,) = yield new[None]
            ratio, improved = (outcome.cost - ahead.cost) / predicted, ahead.cost < outcome.cost
            if improved:
                u, outcome = new, ahead
            if ratio > 0.7 and np.abs(step).max() > 0.9:
                radius = min(2 * radius, 0.5)
            if ratio > 0.1:
                continue
        if flattest is None:
            radius *= 0.5
        elif not improved:
            new = side_step(u, radius, flattest, model)
            u, outcome = better(u, outcome, new[None], (yield new[None]))
    return u, outcome


def better(
    u: np.ndarray, outcome: OutcomeLike, points: np.ndarray, outcomes: Sequence[OutcomeLike]
) -> tuple[np.ndarray, OutcomeLike]:
    """The best of a point and others, with its outcome."""
    best = min(range(len(outcomes)), key=lambda i: outcomes[i].cost)
    return (points[best], outcomes[best]) if outcomes[best].cost < outcome.cost else (u, outcome)


def spread(costs: np.ndarray, lowest: float) -> float:
    """How far the median of the costs that did not fail lies above the lowest."""
    finite = costs[np.isfinite(costs)]
    return float(np.median(finite)) - lowest if finite.size else 0.0


def local_model(z: np.ndarray, fall: np.ndarray, hessian: np.ndarray) -> Quadratic:
    """Quadratic through the origin, nearly, and near the points z (n, dim) [radii] with costs (n,) above its own."""
    z, fall = np.vstack([np.zeros(z.shape[1]), z]), np.concatenate([[0.0], fall])
    weights = 1 / np.maximum(1, np.abs(z).max(axis=1)) ** 2
    weights[0] = 1e4
    return nearest_model(z, fall, weights, hessian, HESSIAN_STIFFNESS)


def flattest_direction(z: np.ndarray) -> np.ndarray | None:
    """Unit vector (dim,) along which the offsets z (n, dim) [radii] reach least, or None where they span all."""
    if len(z) == 0:
        return np.eye(z.shape[1])[0]
    _, singular, directions = np.linalg.svd(z, full_matrices=True)
    spans = len(z) >= z.shape[1] and singular[-1] >= MIN_OFFSET_RADII
    return None if spans else directions[-1]


def side_step(u: np.ndarray, radius: float, direction: np.ndarray, model: Quadratic) -> np.ndarray:
    """Point one radius along plus or minus a direction: the side with room in the box, then the one modelled lower."""
    step = radius * direction / np.abs(direction).max()
    sides = [np.clip(u + side * step, 0, 1) for side in (1, -1)]
    return min(sides, key=lambda p: (np.abs(p - u).max() < 0.5 * radius, model((p - u) / radius)))
