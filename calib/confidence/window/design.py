"""The points that are evaluated next: where they make the boundary of the window most certain."""

import numpy as np
import scipy

from calib.confidence.window.observed import KIND_MARGIN, Observed
from calib.confidence.window.region import Region, emulated
from calib.confidence.window.sampling import region_sample

START_POINTS_A_PARAMETER = 8  # of the space-filling design that comes first
TARGETS = 600  # uncertain points of which the certainty is sought
CANDIDATES = 300  # among which a batch is chosen
EXPLORING_SHARE = 8  # one point in so many of a batch goes on with the space-filling design
MIN_MARGIN_VARIANCE = 1e-14  # of a margin, lest a known one be divided by zero  [1]
SEED_STRIDE = 1000  # between the random numbers of two batches


def space_filling(dim: int, number: int, seed: int) -> np.ndarray:
    """First points (number, dim) of a scrambled Sobol sequence."""
    sequence = scipy.stats.qmc.Sobol(dim, seed=seed)
    return sequence.random(1 << max(number - 1, 1).bit_length())[:number]


def start_points(dim: int) -> int:
    """Number of points of the space-filling design that comes first."""
    return START_POINTS_A_PARAMETER * dim


class WindowDesign:
    """Asks for points in batches, the same after the same points, whether they were observed in one run or in several.

    Hyperparameters are estimated anew whenever the points are a third more, at numbers that no history decides.

    Parameters
    ----------
    dim : of the cube
    seed : of everything random
    """

    def __init__(self, dim: int, seed: int):
        self.dim, self.seed = dim, seed
        self._held: Region | None = None
        self._estimated = 0

    def region(self, observed: Observed) -> Region | None:
        """Region emulated from what was observed; None where it tells nothing yet."""
        number = estimated_at(len(observed.points), start_points(self.dim))
        if number != self._estimated:
            self._held, self._estimated = emulated(observed.first(number)), number
        return emulated(observed, self._held)

    def next_points(self, observed: Observed, batch: int) -> np.ndarray:
        """Points (batch, dim) to evaluate after those that were observed."""
        number, missing = len(observed.points), start_points(self.dim) - len(observed.points)
        if missing > 0:
            return space_filling(self.dim, number + min(batch, missing), self.seed)[number:]
        region = self.region(observed)
        if region is None:
            return space_filling(self.dim, number + batch, self.seed)[number:]
        exploring = max(1, batch // EXPLORING_SHARE) if batch > 1 else 0
        filling = space_filling(self.dim, number + exploring, self.seed)[number:]
        seed = self.seed + SEED_STRIDE * number
        return np.vstack([_targeted(region, observed, batch - exploring, seed), filling])


def estimated_at(number: int, first: int) -> int:
    """Number of points at which hyperparameters were estimated last: the first one, then each time a third more."""
    if number <= first:
        return number
    at = first
    while at * 4 // 3 <= number:
        at = at * 4 // 3
    return at


def _targeted(region: Region, observed: Observed, batch: int, seed: int) -> np.ndarray:
    """Points that lower the uncertainty of the region most, each given those before it.

    The variance of a margin that a new point takes away from a target is its squared posterior covariance with it over
    the variance of the new observation; targets are drawn in proportion to their probability of being misclassified
    (targeted integrated mean square error: Picheny et al. 2010, J. Mech. Des. 132, 071008).
    """
    rng = np.random.default_rng(seed)
    sample = region_sample(region, observed.points[observed.admissible], seed)
    weight = sample.weight * (sample.uncertainty + 1e-12)
    size = min(TARGETS + CANDIDATES, len(weight))
    chosen = rng.choice(len(weight), size, replace=False, p=weight / weight.sum())
    rng.shuffle(chosen)
    points = sample.points[chosen]
    candidates, targets = slice(0, CANDIDATES), slice(CANDIDATES, None)
    blame, revealed = _blame(region, points[targets]), region.kind(points[candidates])
    covariances = [margin.covariance(points) for margin in region.margins]
    scales = [np.maximum(np.diag(covariance), MIN_MARGIN_VARIANCE) for covariance in covariances]
    noises = [margin.noise_variance for margin in region.margins]
    taken = list[int]()
    for _ in range(batch):
        gain = np.zeros(CANDIDATES)
        for k, covariance in enumerate(covariances):
            variance = np.diag(covariance)[candidates] + noises[k] + MIN_MARGIN_VARIANCE
            share = (covariance[candidates, targets] ** 2 / scales[k][targets]) @ blame[:, k] / variance
            gain += share if region.labels[k] == KIND_MARGIN else revealed * share
        gain[taken] = -np.inf
        taken.append(int(np.argmax(gain)))
        covariances = [_given(own, taken[-1], noise) for own, noise in zip(covariances, noises, strict=True)]
    return points[taken]


def _blame(region: Region, points: np.ndarray) -> np.ndarray:
    """Share (m, margins) that each margin has in the uncertainty of points (m, dim)."""
    met = region.met(points)
    uncertain = met * (1.0 - met) + MIN_MARGIN_VARIANCE
    return uncertain / uncertain.sum(axis=1, keepdims=True)


def _given(covariance: np.ndarray, index: int, noise: float) -> np.ndarray:
    """Posterior covariance (m, m) once the point of that index is observed, with a noise of that variance."""
    column = covariance[:, index]
    return covariance - np.outer(column, column) / (column[index] + noise + MIN_MARGIN_VARIANCE)
