"""Subset simulation: points of the unit cube that lie the denser the higher a score, and the volumes they stand for.

Where the score is high may be a tiny share of the cube: levels of the score are raised step by step, each reached by a
fixed share of the points that are spread evenly above the one before, and a volume is the product of these conditional
shares (Au & Beck 2001, Probabilistic Engineering Mechanics 16, 263). Points go on by differences of other points (ter
Braak 2006, Statistics and Computing 16, 239), so that steps take the shape of the part, however thin and oblique it is.
Points that stay below a level stand for what is between it and the one before. The product of so many shares, of levels
that the points themselves decide, is too large on average by as much as its relative variance; in the end the volume of
the last part is told anew, by importance sampling from a kernel density of its points, and the others scale with it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist
from scipy.special import logsumexp

LEVEL_SHARE = 0.15  # of the points of a level that reach the next one  [1]
MAX_LEVELS = 12  # a part of 0.15^12 of the cube, 1e-10
SWEEPS = 6  # in which each point of a level is moved
STEP_FACTORS = (0.3, 0.6, 1.0)  # of the optimal length of a step in a normal distribution, drawn at random  [1]
OPTIMAL_STEP = 2.38  # of it, over the square root of twice the parameters  [1]
JITTER = 1e-6  # edges of the cube, added to steps lest they stay on a lattice of differences
IMPORTANCE_POINTS = 4  # of the kernel density, for each point of the last level
BANDWIDTH = 0.6  # of the kernels, over the covariance of the points  [1]
NEGLIGIBLE_SHARE = 0.01  # of an integral over the cube, that the part above a level may hold unseen  [1]


@dataclass(frozen=True, eq=False)
class WeightedPoints:
    """Points of the unit cube, each with the volume that it stands for.

    Attributes
    ----------
    points : (m, dim)
    weights : (m,), their sum is 1
    relative_variance : of the volume above the last level, over its square  [1]
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
    points = scipy.stats.qmc.Sobol(dim, seed=seed).random(number)
    scores, level = score(points), -np.inf
    passed, volumes, below, variance = list[np.ndarray](), [1.0], 0.0, 0.0
    for _ in range(MAX_LEVELS):
        if (scores >= highest).mean() >= enough or volumes[-1] < NEGLIGIBLE_SHARE * below:
            break
        next_level = min(float(np.quantile(scores, 1.0 - LEVEL_SHARE)), highest)
        above = scores >= next_level
        share = float(above.mean())
        if share > 1.0 - LEVEL_SHARE or not np.isfinite(next_level):  # a plateau of the score: it leads nowhere
            break
        level = next_level
        passed.append(points[~above])
        below += volumes[-1] / number * float(integrand(passed[-1]).sum())
        volumes.append(volumes[-1] * share)
        variance += (1.0 - share) / (share * number)
        origin = np.flatnonzero(above)[np.arange(number) % int(above.sum())]
        points, scores = _spread(score, points[origin], scores[origin], level, rng)
    volume, relative_variance = _importance_volume(score, level, points, rng) if passed else (1.0, 0.0)
    if relative_variance > variance:  # the density suits the part badly
        volume, relative_variance = volumes[-1], variance
    return WeightedPoints(
        np.concatenate([points, *passed[::-1]]), _weights(volumes, volume, number, passed), relative_variance
    )


def _weights(volumes: list[float], volume: float, number: int, passed: list[np.ndarray]) -> np.ndarray:
    """Weights of the last points and of those that stayed below each level, the last level first.

    Parameters
    ----------
    volumes : above each level, the first of which is the cube, as their shares tell
    volume : above the last one, better known: its logarithm's difference is shared out evenly among the levels
    """
    steps = len(volumes) - 1
    better = np.array(volumes) * (volume / volumes[-1]) ** (np.arange(steps + 1) / max(steps, 1))
    shells = [np.full(len(left), (better[k] - better[k + 1]) / len(left)) for k, left in enumerate(passed)]
    return np.concatenate([np.full(number, better[-1] / number), *shells[::-1]])


def _importance_volume(
    score: Callable[[np.ndarray], np.ndarray], level: float, points: np.ndarray, rng: np.random.Generator
) -> tuple[float, float]:
    """Volume of the part of the cube above a level, and its variance over its square.

    Parameters
    ----------
    points : (m, dim) spread over that part
    """
    number, dim = points.shape
    root = BANDWIDTH * np.linalg.cholesky(np.cov(points, rowvar=False))
    drawn = np.repeat(points, IMPORTANCE_POINTS, axis=0)
    drawn = drawn + rng.standard_normal(drawn.shape) @ root.T
    kept = drawn[((drawn >= 0.0) & (drawn <= 1.0)).all(axis=1)]
    kept = kept[score(kept) >= level]
    own, centres = (solve_triangular(root, each.T, lower=True).T for each in (kept, points))
    kernels = logsumexp(-0.5 * cdist(own, centres, "sqeuclidean"), axis=1)
    normalised = np.log(number) + 0.5 * dim * np.log(2.0 * np.pi) + np.log(np.diag(root)).sum()
    ratios = np.exp(normalised - kernels)
    mean = float(ratios.sum()) / len(drawn)
    return mean, (float((ratios**2).sum()) / len(drawn) / mean**2 - 1.0) / len(drawn)


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
