"""Subset simulation: points of the unit cube that lie the denser the higher a score, and the volumes they stand for.

Where the score is high may be a tiny share of the cube: levels of the score are raised step by step, each reached by a
fixed share of the points that are spread evenly above the one before, and a volume is the product of these conditional
shares (Au & Beck 2001, Probabilistic Engineering Mechanics 16, 263). Points go on by differences of other points (ter
Braak 2006, Statistics and Computing 16, 239), so that steps take the shape of the part, however thin and oblique it is.
Points that stay below a level stand for what is between it and the one before.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

LEVEL_SHARE = 0.15  # of the points of a level that reach the next one  [1]
MAX_LEVELS = 12  # a part of 0.15^12 of the cube, 1e-10
SWEEPS = 6  # in which each point of a level is moved
STEP_FACTORS = (0.3, 0.6, 1.0)  # of the optimal length of a step in a normal distribution, drawn at random  [1]
OPTIMAL_STEP = 2.38  # of it, over the square root of twice the parameters  [1]
JITTER = 1e-6  # edges of the cube, added to steps lest they stay on a lattice of differences
NEGLIGIBLE_SHARE = 0.01  # of an integral over the cube, that the part above a level may hold unseen  [1]


@dataclass(frozen=True, eq=False)
class WeightedPoints:
    """Points of the unit cube, each with the volume that it stands for.

    Attributes
    ----------
    points : (m, dim)
    weights : (m,), their sum is 1
    relative_variance : of the volume above the last level, over its square, were all points of a level independent  [1]
    """

    points: np.ndarray
    weights: np.ndarray
    relative_variance: float


def subset_simulation(
    score: Callable[[np.ndarray], np.ndarray],
    integrand: Callable[[np.ndarray], np.ndarray],
    dim: int,
    highest: float,
    enough: float,
    number: int,
    seed: int,
) -> WeightedPoints:
    """Raise the level until a share `enough` of the points above it scores `highest` at least.

    It is not raised further where the part above it is too small to matter for the integral over the cube.

    Parameters
    ----------
    score : of points (m, dim) -> (m,), finite or -inf
    integrand : of points (m, dim) -> (m,), 0 to 1
    highest : score that the level never exceeds
    enough : share of the points  [1]
    number : of points of a level, a power of two
    seed : of everything random
    """
    rng = np.random.default_rng(seed)
    points = qmc.Sobol(dim, seed=seed).random(number)
    scores = score(points)
    passed, weights = list[np.ndarray](), list[np.ndarray]()
    volume, below, variance = 1.0, 0.0, 0.0
    for _ in range(MAX_LEVELS):
        if (scores >= highest).mean() >= enough or volume < NEGLIGIBLE_SHARE * below:
            break
        level = min(float(np.quantile(scores, 1.0 - LEVEL_SHARE)), highest)
        above = scores >= level
        share = float(above.mean())
        if share > 1.0 - LEVEL_SHARE or not np.isfinite(level):  # a plateau of the score: it leads nowhere
            break
        left = points[~above]
        passed.append(left)
        weights.append(np.full(len(left), volume / number))
        below += volume / number * float(integrand(left).sum())
        volume *= share
        variance += (1.0 - share) / (share * number)
        origin = np.flatnonzero(above)[np.arange(number) % int(above.sum())]
        points, scores = _spread(score, points[origin], scores[origin], level, rng)
    weight = np.concatenate([np.full(number, volume / number), *weights[::-1]])
    return WeightedPoints(np.concatenate([points, *passed[::-1]]), weight, variance)


def _spread(
    score: Callable[[np.ndarray], np.ndarray],
    points: np.ndarray,
    scores: np.ndarray,
    level: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Move points (m, dim) about the part of the cube above the level, in which each is equally likely everywhere.

    One half is moved by differences of two points of the other half, then the other by those of the first.
    """
    points, scores = points.copy(), scores.copy()
    number, dim = points.shape
    optimal = OPTIMAL_STEP / np.sqrt(2.0 * dim)
    for _ in range(SWEEPS):
        halves = np.array_split(rng.permutation(number), 2)
        for moved, others in (halves, halves[::-1]):
            first, second = rng.integers(len(others), size=(2, len(moved)))
            factor = optimal * rng.choice(STEP_FACTORS, size=(len(moved), 1))
            step = factor * (points[others[first]] - points[others[second]])
            tried = points[moved] + step + JITTER * rng.standard_normal(step.shape)
            inside = ((tried >= 0.0) & (tried <= 1.0)).all(axis=1)
            tried, chosen = tried[inside], moved[inside]
            found = score(tried) if len(tried) else np.zeros(0)
            accepted = found >= level
            points[chosen[accepted]], scores[chosen[accepted]] = tried[accepted], found[accepted]
    return points, scores
