"""Estimated error of the reduced kernel, from the differences between levels of rising fineness."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.simulators.delaminated_beam.reduction import Fineness
from calib.simulators.delaminated_beam.stationary import FailedMotion, StationaryMotion

LEVELS = {
    "straight": (Fineness(40, 512, 16, 2), Fineness(64, 1024, 16, 1), Fineness(128, 1024, 32, 1)),
    "arched": (Fineness(48, 512, 12, 1), Fineness(64, 1024, 16, 1), Fineness(128, 1024, 32, 1)),
}
ERROR_OVER_DIFFERENCE = 1.2  # of a level, over its difference from the next one  [1]
# of the last level, over the weighted geometric mean of the last two differences, with the weight of the last but one
LAST_ERROR_OVER_DIFFERENCE, LAST_BUT_ONE_WEIGHT = 0.65, 0.25  # [1], [1]
MIN_VARIANCE = 1e-300  # m^2 or (m/s)^2, of a motion at rest


@dataclass(frozen=True, eq=False)
class EstimatedMotion:
    """A motion of the reduced kernel with its estimated error.

    Attributes
    ----------
    motion : of the level taken
    level : that level
    error : root mean square of the phase curve's error over that of the curve about its mean [1]; NaN where there is
        no estimate
    """

    motion: StationaryMotion
    level: Fineness
    error: float


def refined(
    motion: StationaryMotion,
    levels: Sequence[Fineness],
    simulated: Callable[[Fineness], StationaryMotion | FailedMotion],
    tolerance: float,
    samples: int,
) -> EstimatedMotion:
    """Raise the level until the estimated error of the phase curve is within the tolerance, or there is no higher one.

    Parameters
    ----------
    motion : of the first level
    simulated : level -> its motion, from the end of `motion`
    tolerance : [1]
    samples : a period

    Notes
    -----
    With the differences d1, d2 of phase curves between one level and the next, the error is estimated at 1.2 times that
    to the next level, and at 0.65 d2^(3/4) d1^(1/4) for the last, which has no next.
    """
    level, error, differences = levels[0], math.nan, []
    for finer in levels[1:]:
        if motion.returns is None:
            break
        better = simulated(finer)
        if isinstance(better, FailedMotion) or better.returns is None:
            break
        differences.append(loop_difference(motion, better, samples))
        error = ERROR_OVER_DIFFERENCE * differences[-1]
        if error <= tolerance:
            break
        level, motion = finer, better
        before = differences[-2:][0]
        error = (
            LAST_ERROR_OVER_DIFFERENCE * differences[-1] ** (1.0 - LAST_BUT_ONE_WEIGHT) * before**LAST_BUT_ONE_WEIGHT
        )
    return EstimatedMotion(motion, level, error)


def loop_difference(one: StationaryMotion, other: StationaryMotion, samples: int) -> float:
    """Root mean square difference of the layer's phase curves, over the second one's about its mean  [1].

    The mean of the squares of displacement and velocity, as the feature `phase_curve` has it; over the periods after
    which both return.
    """
    count = samples * min(math.lcm(one.returns or 1, other.returns or 1), len(one.samples) // samples)
    total = 0.0
    for channel in (1, 3):
        a, b = one.samples[:count, channel], other.samples[:count, channel]
        total += 0.5 * np.mean((a - b) ** 2) / max(np.var(b), MIN_VARIANCE)
    return float(np.sqrt(total))
