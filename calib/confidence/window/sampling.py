"""Points of the unit cube that are dense where the region is, by subset simulation where that is small."""

from dataclasses import dataclass

import numpy as np
import scipy

from calib.confidence.window.region import BOUNDARY_PERFORMANCE, Region
from calib.confidence.window.subset import subset_simulation

LEVEL_POINTS = 1 << 13  # quasi-random ones of the cube
SPLIT_POINTS = 1 << 9  # of each level of a subset simulation, which moves them many times
REPLICATES = 2  # independent subset simulations
FINE_LEVEL_POINTS, FINE_SPLIT_POINTS, FINE_REPLICATES = 1 << 14, 1 << 10, 4  # those of which shares are estimated
MIN_INSIDE_POINTS = 100  # in the cube and more probably admissible than not, from which no levels are raised
INSIDE_SHARE = 0.3  # of the points above a level, from which it is not raised further  [1]
POSSIBLE = 1e-3  # probability of being admissible, below which a point counts as outside  [1]
BOX_MARGIN = 0.25  # by which a box is wider than the points that it is drawn about, of their extent at each end  [1]
MIN_BOX_WIDTH = 0.01  # edges of the cube


@dataclass(frozen=True, eq=False)
class RegionSample:
    """Points of the cube, densest where the region is; the first ones are in the densest part.

    Attributes
    ----------
    points : (m, dim)
    probability : (m,) of being admissible
    weight : (m,) volume that each point stands for, of the cube's  [1]; their sum is 1
    replicate : (m,) number of the independent simulation that each point is of; all 0 where they are quasi-random
    relative_variance : of the volume of the densest part, over its square  [1]; 0 where they are quasi-random
    low, high : (dim,) of a box about the points that may be admissible
    """

    points: np.ndarray
    probability: np.ndarray
    weight: np.ndarray
    replicate: np.ndarray
    relative_variance: float
    low: np.ndarray
    high: np.ndarray

    @property
    def uncertainty(self) -> np.ndarray:
        """Probability (m,) that a point is on the other side than it is taken for."""
        return np.minimum(self.probability, 1.0 - self.probability)


def region_sample(
    region: Region,
    inside: np.ndarray,
    seed: int,
    number: int = LEVEL_POINTS,
    split: int = SPLIT_POINTS,
    replicates: int = REPLICATES,
) -> RegionSample:
    """Sample the cube evenly, or the denser the more probably admissible where that is a small part of it.

    Parameters
    ----------
    inside : (k, dim) points that the box has to hold
    number, split : of points of the cube and of each level of a subset simulation, powers of two
    replicates : subset simulations
    """
    dim = inside.shape[1]
    points = scipy.stats.qmc.Sobol(dim, seed=seed).random(number)
    weight, replicate = np.full(number, 1.0 / number), np.zeros(number, dtype=int)
    probability, variance = region.probability(points), 0.0
    if (probability >= 0.5).sum() < MIN_INSIDE_POINTS:
        seeds = np.random.SeedSequence(seed).generate_state(replicates)
        parts = [
            subset_simulation(
                region.performance, region.probability, dim, BOUNDARY_PERFORMANCE, INSIDE_SHARE, split, int(own)
            )
            for own in seeds
        ]
        weight = np.concatenate([part.weights for part in parts]) / replicates
        order = np.argsort(weight, kind="stable")
        points, weight = np.concatenate([part.points for part in parts])[order], weight[order]
        replicate = np.repeat(np.arange(replicates), [len(part.points) for part in parts])[order]
        probability = region.probability(points)
        variance = float(np.mean([part.relative_variance for part in parts])) / replicates
    return RegionSample(points, probability, weight, replicate, variance, *_box(points, probability, inside))


def fine_sample(region: Region, inside: np.ndarray, seed: int) -> RegionSample:
    """Sample of which shares and shapes are estimated (see `region_sample`)."""
    return region_sample(region, inside, seed, FINE_LEVEL_POINTS, FINE_SPLIT_POINTS, FINE_REPLICATES)


def _box(points: np.ndarray, probability: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (dim,) of a box about the points that may be admissible; the cube without any."""
    held = np.vstack([points[probability > POSSIBLE], inside])
    if not len(held):
        return np.zeros(points.shape[1]), np.ones(points.shape[1])
    least, most = held.min(axis=0), held.max(axis=0)
    around = np.maximum(BOX_MARGIN * (most - least), MIN_BOX_WIDTH)
    return np.maximum(0.0, least - around), np.minimum(1.0, most + around)
