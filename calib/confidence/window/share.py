"""The share of the box that is admissible, with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from calib.confidence.window.region import Region
from calib.confidence.window.sampling import RegionSample

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
    fractions = fractions + np.sqrt(fractions * (1 - fractions) / number) * rng.standard_normal(DRAWS)
    low, high = np.quantile(np.clip(fractions, 0.0, 1.0), QUANTILES)
    value = float(sample.probability.mean())
    volume = sample.volume
    return VolumeShare(
        volume * value, volume * min(float(low), value), volume * max(float(high), value),
        volume * float(sample.uncertainty.mean()),
    )  # fmt: skip
