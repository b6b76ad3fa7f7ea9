"""The share of the box that is admissible, with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from calib.confidence.window.design import start_points
from calib.confidence.window.observed import Observed
from calib.confidence.window.region import Region
from calib.confidence.window.sampling import RegionSample

DRAWS = 400  # joint draws of the margins
MAX_JOINT_POINTS = 800  # of uncertain membership that are drawn jointly
QUANTILES = (0.025, 0.975)  # of a 95 % interval


@dataclass(frozen=True)
class VolumeShare:
    """Share of the box that is admissible  [1], with its 95 % interval, and the share that may be misclassified.

    Attributes
    ----------
    value, low, high : of the box
    misclassified : expected share of the box that is taken for the wrong side
    """

    value: float
    low: float
    high: float
    misclassified: float


def volume_share(region: Region, sample: RegionSample, observed: Observed, seed: int) -> VolumeShare:
    """Share of the box that is admissible.

    Of the points `MAX_JOINT_POINTS` are drawn jointly, chosen in proportion to what they add to the uncertainty; they
    stand for all. The sample's own error multiplies each draw. As long as no admissible point was observed, emulators
    only extrapolate: the share may be what the space-filling points, none of them admissible, leave open.
    """
    rng = np.random.default_rng(seed)
    value = float(sample.weight @ sample.probability)
    spread = sample.weight * np.sqrt(sample.probability * (1.0 - sample.probability))
    shares = np.full(DRAWS, value)
    if spread.any():
        chosen, times = np.unique(
            rng.choice(len(spread), MAX_JOINT_POINTS, p=spread / spread.sum()), return_counts=True
        )
        factor = times * sample.weight[chosen] * spread.sum() / (MAX_JOINT_POINTS * spread[chosen])
        inside = region.draws(sample.points[chosen], DRAWS, seed)
        shares = shares + (inside - sample.probability[chosen]) @ factor
    low, high = np.quantile(np.maximum(shares * _sampling_factors(sample, rng), 0.0), QUANTILES)
    if not observed.admissible.any():
        low, high = 0.0, max(float(high), _unseen(min(start_points(observed.points.shape[1]), len(observed.points))))
    return VolumeShare(
        value, min(float(low), value), max(float(high), value), float(sample.weight @ sample.uncertainty)
    )


def _unseen(number: int) -> float:
    """Share that so many independent points all miss with the probability that an interval has at its upper end."""
    return 1.0 - float((1.0 - QUANTILES[1]) ** (1.0 / number))


def _sampling_factors(sample: RegionSample, rng: np.random.Generator) -> np.ndarray:
    """Factors (draws,) by which a volume may differ, as the points are so many only.

    Of independent simulations their differences tell, with Student's distribution as they are few; but no less than
    each says of itself, lest a few that agree by chance pass for certain.
    """
    volumes = np.bincount(sample.replicate, weights=sample.weight * sample.probability)
    replicates = len(volumes)
    mean = float(volumes.mean())
    if not mean:
        return np.ones(DRAWS)
    if replicates > 1:
        variance = float(volumes.var(ddof=1)) / replicates / mean**2
        std = np.sqrt(max(variance, sample.relative_variance))
        return np.maximum(1.0 + std * rng.standard_t(replicates - 1, DRAWS), 0.0)
    std = float(sample.probability.std()) / np.sqrt(len(sample.points)) / mean
    return np.maximum(1.0 + std * rng.standard_normal(DRAWS), 0.0)
