"""The share of the box that is admissible, with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from calib.confidence.window.design import space_filling, start_points
from calib.confidence.window.observed import Observed
from calib.confidence.window.region import Region
from calib.confidence.window.sampling import RegionSample

DRAWS = 400  # joint draws of the margins
MAX_JOINT_POINTS = 800  # of uncertain membership that are drawn jointly
QUANTILES = (0.025, 0.975)  # of a 95 % interval


@dataclass(frozen=True)
class VolumeShare:
    """Share of the box that is admissible  [1], with its 95 % interval, and the share that may be misclassified.

    All of the parts of the window that points have met; one that none has met is in none of them.

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


@dataclass(frozen=True)
class UndiscoveredShare:
    """Upper bound of the share of the box in parts of the window that no point has met, held with 97.5 % probability.

    Attributes
    ----------
    high : of the box  [1]
    points : space-filling ones outside the region, on which it rests
    """

    high: float
    points: int


def undiscovered_share(region: Region, sample: RegionSample, observed: Observed, seed: int) -> UndiscoveredShare:
    """Bound what admissible parts the emulators may know nothing of.

    Emulators only extrapolate where no point has met a part of the window. Space-filling points were chosen without
    them: had one met a part, it would be inside the region. Those outside it bound the share of what is outside that
    may be admissible.

    Parameters
    ----------
    seed : of the design that chose the points
    """
    number, dim = observed.points.shape
    chosen = {row.tobytes() for row in space_filling(dim, number, seed)}
    filling = np.array([row.tobytes() in chosen for row in observed.points], dtype=bool)
    missed = observed.points[filling & ~observed.admissible]
    count = int((region.probability(missed) < 0.5).sum()) if len(missed) else 0
    outside = float(sample.weight[sample.probability < 0.5].sum())
    return UndiscoveredShare(outside * _unseen(count), count)


def _unseen(number: int) -> float:
    """Share that so many independent points all miss with the probability that an interval has at its upper end."""
    return 1.0 - float((1.0 - QUANTILES[1]) ** (1.0 / number)) if number else 1.0


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
