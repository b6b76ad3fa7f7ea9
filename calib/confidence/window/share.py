"""The share of the box that is admissible, with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from calib.confidence.window.region import Region
from calib.confidence.window.sampling import RegionSample
from calib.confidence.window.subset import clustered_variance

DRAWS = 200  # joint draws of the margins
MAX_JOINT_POINTS = 800  # of uncertain membership that are drawn jointly
CERTAIN = 1e-3  # probability of being on the other side, below which a point is taken for what it is  [1]
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


def volume_share(region: Region, sample: RegionSample, seed: int) -> VolumeShare:
    """Share of the box that is admissible.

    Points of certain membership count as they are; the others are drawn jointly, at most `MAX_JOINT_POINTS` of them,
    and stand for all.
    """
    rng = np.random.default_rng(seed)
    unsure = np.flatnonzero(sample.uncertainty > CERTAIN)
    number = len(sample.probability)
    certain = int((sample.probability > 1.0 - CERTAIN).sum())
    counts = np.full(DRAWS, float(certain))
    if unsure.size:
        joint = rng.choice(unsure, min(unsure.size, MAX_JOINT_POINTS), replace=False)
        inside = region.draws(sample.points[joint], DRAWS, seed).mean(axis=1)
        counts += unsure.size * inside
        sampled = np.sqrt(sample.probability[joint].var() / joint.size) * unsure.size * (joint.size < unsure.size)
        counts += sampled * rng.standard_normal(DRAWS)
    fractions = np.clip(counts / number, 0.0, 1.0)
    fractions = fractions + np.sqrt(_sampling_variance(fractions, sample)) * rng.standard_normal(DRAWS)
    volumes = sample.volume * np.exp(sample.relative_std * rng.standard_normal(DRAWS))
    low, high = np.quantile(volumes * np.clip(fractions, 0.0, 1.0), QUANTILES)
    value = sample.volume * float(sample.probability.mean())
    return VolumeShare(
        value + sample.outside, min(float(low), value), max(float(high), value) + sample.outside,
        sample.volume * float(sample.uncertainty.mean()) + sample.outside,
    )  # fmt: skip


def _sampling_variance(fractions: np.ndarray, sample: RegionSample) -> np.ndarray:
    """Variance (draws,) of admissible fractions (draws,) of the sample's points, as it is of so many points only."""
    independent = fractions * (1 - fractions) / len(sample.points)
    if sample.chain is None:
        return independent
    inside = (sample.probability >= 0.5).astype(float)
    alike = float(inside.var()) / len(inside)
    return independent * (clustered_variance(inside, sample.chain) / alike if alike else 1.0)
