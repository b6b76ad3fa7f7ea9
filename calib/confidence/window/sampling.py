"""Points of the unit cube that are dense where the region is: quasi-random in boxes that close in on it."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from calib.confidence.window.region import Region

LEVEL_POINTS = 1 << 13  # of each box
MAX_LEVELS = 6  # boxes, each inside the one before
MIN_POSSIBLE_POINTS = 400  # in a box, from which it is not narrowed further
POSSIBLE = 1e-3  # probability of being admissible, below which a point counts as outside  [1]
BOX_MARGIN = 0.25  # by which a box is wider than the points that it is drawn about, of their extent at each end  [1]
MIN_BOX_WIDTH = 0.01  # edges of the cube


@dataclass(frozen=True, eq=False)
class RegionSample:
    """Quasi-random points of a box that holds the region.

    Attributes
    ----------
    low, high : (dim,) of the box
    points : (m, dim)
    probability : (m,) of being admissible
    """

    low: np.ndarray
    high: np.ndarray
    points: np.ndarray
    probability: np.ndarray

    @property
    def volume(self) -> float:
        """Volume of the box, of the cube's."""
        return float(np.prod(self.high - self.low))

    @property
    def uncertainty(self) -> np.ndarray:
        """Probability (m,) that a point is on the other side than it is taken for."""
        return np.minimum(self.probability, 1.0 - self.probability)


def region_sample(region: Region, inside: np.ndarray, seed: int, number: int = LEVEL_POINTS) -> RegionSample:
    """Sample the cube, or a box of it where the region is small.

    Parameters
    ----------
    inside : (k, dim) points that the box has to hold
    number : of points, a power of two
    """
    dim = inside.shape[1]
    low, high = np.zeros(dim), np.ones(dim)
    for level in range(MAX_LEVELS):
        unit = qmc.Sobol(dim, seed=seed + level).random(number)
        points = low + (high - low) * unit
        probability = region.probability(points)
        possible = probability > POSSIBLE
        if possible.sum() >= MIN_POSSIBLE_POINTS or level == MAX_LEVELS - 1:
            break
        held = np.vstack([points[possible], inside])
        if not len(held):
            break
        least, most = held.min(axis=0), held.max(axis=0)
        around = np.maximum(BOX_MARGIN * (most - least), MIN_BOX_WIDTH)
        next_low, next_high = np.maximum(low, least - around), np.minimum(high, most + around)
        if np.prod(next_high - next_low) > 0.7 * np.prod(high - low):
            break
        low, high = next_low, next_high
    return RegionSample(low, high, points, probability)
