"""A bounded search on a scalar cost by quadratic models, as a generator that yields the points it wants evaluated."""

import numpy as np

from calib.optimisers.quadratic import nearest_model

SMALLEST_RADIUS = 1e-4  # of the window: a trust region below it ends the search
REACH = 2.0  # radii: points farther than this do not enter the model
STIFFNESS = 1e-6  # squared share of the points' costs that a unit change of the hessian is worth
FLAT = 0.1  # least singular value of the points' offsets [radii] that spans all directions
SHORT = 0.05  # radii: a step shorter than this asks for a smaller region instead
LEAST_GAIN = 1e-7  # of the archive's spread of costs: a predicted fall that is not worth asking for


def descend(u, outcome, archive, radius=0.1):
    """Search from a point u (dim,) with its outcome, by a trust region in the maximum norm.

    The model is the quadratic nearest to its predecessor through the evaluated points around u, also those of other
    searches (`archive`, to which the caller adds every answer before sending it). Where a step fails and the points
    lie flat, the next one is spent on the flattest direction. After Powell (2009, BOBYQA, report NA2009/06) and Conn,
    Scheinberg & Vicente (2009, ch. 10), much simplified.

    Yields points (n, dim), is sent their n outcomes, returns the last point and its outcome.
    """
    dim = u.size
    hessian = np.zeros((dim, dim))
    first = u + np.diag(np.where(u + radius > 1, -radius, radius))
    u, outcome = better(u, outcome, first, (yield first))
    while radius > SMALLEST_RADIUS:
        offsets, costs = archive.near(u, REACH * radius, (dim + 1) * (dim + 2))
        z, fall = offsets / radius, costs - outcome.cost
        scale = max(np.abs(fall).max(initial=0.0), 1e-300)
        model = local_model(z, fall / scale, hessian * radius**2 / scale)
        hessian = model.hessian * scale / radius**2
        step = model.lowest(np.maximum(-u / radius, -1), np.minimum((1 - u) / radius, 1))
        predicted, flattest = (model.level - model(step)) * scale, flattest_direction(z)
        improved = False
        if predicted > LEAST_GAIN * spread(archive.costs, outcome.cost) and np.abs(step).max() >= SHORT:
            new = np.clip(u + radius * step, 0, 1)
            (told,) = yield new[None]
            ratio, improved = (outcome.cost - told.cost) / predicted, told.cost < outcome.cost
            if improved:
                u, outcome = new, told
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


def better(u, outcome, points, outcomes):
    """The best of a point and others, with its outcome."""
    best = min(range(len(outcomes)), key=lambda i: outcomes[i].cost)
    return (points[best], outcomes[best]) if outcomes[best].cost < outcome.cost else (u, outcome)


def spread(costs, lowest):
    """How far the median of the costs that did not fail lies above the lowest."""
    finite = costs[np.isfinite(costs)]
    return np.median(finite) - lowest if finite.size else 0.0


def local_model(z, fall, hessian):
    """Quadratic through the origin, nearly, and near the points z (n, dim) [radii] with costs (n,) above its own."""
    z, fall = np.vstack([np.zeros(z.shape[1]), z]), np.concatenate([[0.0], fall])
    weights = 1 / np.maximum(1, np.abs(z).max(axis=1)) ** 2
    weights[0] = 1e4
    return nearest_model(z, fall, weights, hessian, STIFFNESS)


def flattest_direction(z):
    """Unit vector (dim,) along which the offsets z (n, dim) [radii] reach least, or None where they span all."""
    if len(z) == 0:
        return np.eye(z.shape[1])[0]
    _, singular, directions = np.linalg.svd(z, full_matrices=True)
    spans = len(z) >= z.shape[1] and singular[-1] >= FLAT
    return None if spans else directions[-1]


def side_step(u, radius, direction, model):
    """Point one radius along plus or minus a direction: the side with room in the box, then the one modelled lower."""
    step = radius * direction / np.abs(direction).max()
    sides = [np.clip(u + side * step, 0, 1) for side in (1, -1)]
    return min(sides, key=lambda p: (np.abs(p - u).max() < 0.5 * radius, model((p - u) / radius)))
