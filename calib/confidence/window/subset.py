"""Subset simulation: points spread evenly over the part of the unit cube in which a score is high, and its volume.

The part may be a tiny share of the cube: levels of the score are raised step by step, each reached by a fixed share of
the points that are spread evenly above the one before, and the volume is the product of these conditional shares (Au &
Beck 2001, Probabilistic Engineering Mechanics 16, 263). Points go on by differences of other points (ter Braak 2006,
Statistics and Computing 16, 239), so that steps take the shape of the part, however thin and oblique it is.
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


@dataclass(frozen=True, eq=False)
class Subset:
    """Points spread evenly over the part of the unit cube in which a score exceeds a level.

    Attributes
    ----------
    points, scores : (m, dim) and (m,)
    volume : of the part  [1]
    relative_std : standard deviation of the volume's estimate, over it  [1]
    below : integral over the rest of the cube of the weights that were asked for  [1]
    chain : (m,) of each point: points of one chain began at the same point, and depend on each other
    """

    points: np.ndarray
    scores: np.ndarray
    volume: float
    relative_std: float
    below: float
    chain: np.ndarray


def subset_simulation(
    score: Callable[[np.ndarray], np.ndarray],
    weight: Callable[[np.ndarray], np.ndarray],
    dim: int,
    highest: float,
    enough: float,
    number: int,
    seed: int,
) -> Subset:
    """Raise the level until a share `enough` of the points above it scores `highest` at least.

    Parameters
    ----------
    score : of points (m, dim) -> (m,), finite or -inf
    weight : of scores (m,) -> (m,), whose integral below the last level is told
    highest : score that the level never exceeds
    enough : share of the points  [1]
    number : of points, a power of two
    seed : of everything random
    """
    rng = np.random.default_rng(seed)
    points = qmc.Sobol(dim, seed=seed).random(number)
    scores, chain = score(points), np.arange(number)
    volume, variance, below = 1.0, 0.0, 0.0
    for _ in range(MAX_LEVELS):
        if (scores >= highest).mean() >= enough:
            break
        level = min(float(np.quantile(scores, 1.0 - LEVEL_SHARE)), highest)
        above = scores >= level
        share = float(above.mean())
        if share > 1.0 - LEVEL_SHARE or not np.isfinite(level):  # a plateau of the score: it leads nowhere
            break
        below += volume * float(np.where(above, 0.0, weight(scores)).mean())
        variance += clustered_variance(above.astype(float), chain) / share**2
        volume *= share
        origin = np.flatnonzero(above)[np.arange(number) % int(above.sum())]
        (points, scores), chain = _spread(score, points[origin], scores[origin], level, rng), origin
    return Subset(points, scores, volume, float(np.sqrt(variance)), below, chain)


def clustered_variance(values: np.ndarray, chain: np.ndarray) -> float:
    """Variance of the mean of values (m,) of which those of one chain (m,) depend on each other."""
    departures = np.bincount(chain, weights=values - values.mean())
    return float((departures**2).sum()) / len(values) ** 2


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
