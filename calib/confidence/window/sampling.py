"""Points of the unit cube that are dense where the region is, by subset simulation where that is small."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from calib.confidence.window.region import Region
from calib.confidence.window.subset import subset_simulation

LEVEL_POINTS = 1 << 13  # quasi-random ones of the cube
SPLIT_POINTS = 1 << 10  # by subset simulation, which moves them many times
POSSIBLE = 1e-3  # probability of being admissible, below which a point counts as outside  [1]
MIN_POSSIBLE_POINTS = 400  # in the cube, from which it is not narrowed
POSSIBLE_SHARE = 0.3  # of the points of a part of the cube, from which that is not narrowed further  [1]
BOX_MARGIN = 0.25  # by which a box is wider than the points that it is drawn about, of their extent at each end  [1]
MIN_BOX_WIDTH = 0.01  # edges of the cube


@dataclass(frozen=True, eq=False)
class RegionSample:
    """Points spread evenly over a part of the cube that holds the region.

    Attributes
    ----------
    points : (m, dim)
    probability : (m,) of being admissible
    volume : of the part, of the cube's  [1]
    relative_std : standard deviation of the volume's estimate, over it; 0 for the whole cube  [1]
    outside : expected admissible volume outside the part  [1]
    chain : (m,) points of different chains are independent; None where all are quasi-random
    low, high : (dim,) of a box about the points that may be admissible
    """

    points: np.ndarray
    probability: np.ndarray
    volume: float
    relative_std: float
    outside: float
    chain: np.ndarray | None
    low: np.ndarray
    high: np.ndarray

    @property
    def uncertainty(self) -> np.ndarray:
        """Probability (m,) that a point is on the other side than it is taken for."""
        return np.minimum(self.probability, 1.0 - self.probability)


def region_sample(
    region: Region, inside: np.ndarray, seed: int, number: int = LEVEL_POINTS, split: int = SPLIT_POINTS
) -> RegionSample:
    """Sample the cube, or the part of it in which the region may be, where that is small.

    Parameters
    ----------
    inside : (k, dim) points that the box has to hold
    number, split : of points of the cube and of a part of it, powers of two
    """
    dim = inside.shape[1]
    points = qmc.Sobol(dim, seed=seed).random(number)
    probability = region.probability(points)
    if (probability > POSSIBLE).sum() >= MIN_POSSIBLE_POINTS:
        return RegionSample(points, probability, 1.0, 0.0, 0.0, None, *_box(points, probability, inside))
    part = subset_simulation(region.log_probability, np.exp, dim, np.log(POSSIBLE), POSSIBLE_SHARE, split, seed)
    probability = np.exp(part.scores)
    return RegionSample(
        part.points, probability, part.volume, part.relative_std, part.below, part.chain,
        *_box(part.points, probability, inside),
    )  # fmt: skip


def _box(points: np.ndarray, probability: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (dim,) of a box about the points that may be admissible; the cube without any."""
    held = np.vstack([points[probability > POSSIBLE], inside])
    if not len(held):
        return np.zeros(points.shape[1]), np.ones(points.shape[1])
    least, most = held.min(axis=0), held.max(axis=0)
    around = np.maximum(BOX_MARGIN * (most - least), MIN_BOX_WIDTH)
    return np.maximum(0.0, least - around), np.minimum(1.0, most + around)
