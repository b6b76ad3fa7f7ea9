"""The trend of a cost over the whole window: a quadratic fitted to the screened costs."""

import numpy as np
import scipy
from scipy.special import ndtri

from calib.optimisers.quadratic import monomials, unpack

ANISOTROPY_PENALTIES = (1e-3, 1e-2, 1e-1, 1.0)  # of the hessian, per point; the best of them is chosen  [1]


def lowest_of_trend(points: np.ndarray, costs: np.ndarray) -> np.ndarray | None:
    """Point (dim,) of the cube where a quadratic trend of evenly spread points (n, dim) with costs (n,) is least.

    A cost of many local minima within a funnel has no useful gradient, and its bottom lies near the least point of its
    trend, as in convex global underestimation (Phillips, Rosen & Walke 1995, DIMACS 23, 181). The costs enter by their
    normal scores, so that no scale and no outlier matters; failed runs do not enter. The hessian is drawn towards a
    multiple of the identity, by an amount chosen by the leave-one-out error (PRESS; Allen 1974, Technometrics 16, 125).
    None where the points are fewer than twice the unknowns of an isotropic trend.
    """
    points, costs = points[np.isfinite(costs)], costs[np.isfinite(costs)]
    dim = points.shape[1]
    if len(points) < 2 * (dim + 2):
        return None
    z, scores = 2 * points - 1, ndtri((scipy.stats.rankdata(costs) - 0.5) / len(costs))
    _, coefficients = min(
        (isotropic_fit(z, scores, stiffness) for stiffness in ANISOTROPY_PENALTIES), key=lambda fit: fit[0]
    )
    return (unpack(coefficients, dim).lowest(-np.ones(dim), np.ones(dim)) + 1) / 2


def isotropic_fit(z: np.ndarray, values: np.ndarray, stiffness: float) -> tuple[float, np.ndarray]:
    """Leave-one-out error and coefficients of the quadratic whose hessian is drawn towards the identity's multiples.

    Parameters
    ----------
    z, values : (n, dim), (n,)
    stiffness : float, per point
    """
    dim = z.shape[1]
    columns = monomials(z)
    i, j = np.triu_indices(dim)
    anisotropy = np.eye(i.size) - np.outer(i == j, i == j) / dim
    hold = np.hstack([np.zeros((i.size, 1 + dim)), np.sqrt(stiffness * len(z)) * anisotropy])
    q, r = np.linalg.qr(np.vstack([columns, hold]))
    coefficients = np.linalg.lstsq(r, q[: len(z)].T @ values, rcond=None)[0]
    leverage = np.minimum((q[: len(z)] ** 2).sum(axis=1), 1 - 1e-9)
    return float(np.mean(((values - columns @ coefficients) / (1 - leverage)) ** 2)), coefficients
