"""Doubts of the unit in which the phases of a frequency response are stated."""

import math
from collections.abc import Sequence

import numpy as np

from calib.units import plain_number

RADIANS_PER_DEGREE = math.pi / 180.0  # rad
MAX_UNWRAPPED_PHASE = 4.0 * math.pi  # rad: larger ones, which jump from point to point, may be degrees
MAX_UNWRAPPED_STEP = math.pi  # rad: of an unwrapped phase between neighbouring points of a sweep
MAX_RADIANS = 2.0 * math.pi  # numbers in degrees that are all smaller, over a resonance, may be radians  [1]
HALF_POWER = 1.0 / math.sqrt(2.0)  # of the peak of a resonance, on either side of which the phase turns by 45 deg  [1]


def doubtful_phase_unit(
    phase: np.ndarray, unit: float, receptance: np.ndarray, sweeps: Sequence[np.ndarray]
) -> str | None:
    """Say why the phases of a body may be in another unit than the one stated; None where nothing contradicts it.

    Parameters
    ----------
    phase : (point,) by the unit stated  [rad]
    unit : that unit  [rad]
    receptance : (point,) amplitude of the displacement over that of the excitation
    sweeps : indices of the points of each, in the order measured
    """
    largest = float(np.abs(phase).max())
    if unit == 1.0 and largest > MAX_UNWRAPPED_PHASE:
        steps = [np.abs(np.diff(phase[points])).max(initial=0.0) for points in sweeps]
        if max(steps) > MAX_UNWRAPPED_STEP:
            return (
                f"the phases reach {plain_number(largest)} rad and change by up to {plain_number(float(max(steps)))} "
                "rad from one point to the next: if they are degrees, state the unit deg"
            )
    if (
        math.isclose(unit, RADIANS_PER_DEGREE)
        and largest / unit <= MAX_RADIANS
        and any(_has_resonance(receptance[points]) for points in sweeps)
    ):
        return (
            f"no phase exceeds {plain_number(largest / unit)} deg though the response has a resonance, at which it "
            "turns by 90 deg: if they are radians, state the unit rad"
        )
    return None


def _has_resonance(receptance: np.ndarray) -> bool:
    """Whether a sweep goes through a peak that falls below half of its power on both sides."""
    top = int(np.argmax(receptance))
    sides = receptance[:top], receptance[top + 1 :]
    return all(side.min(initial=np.inf) < HALF_POWER * receptance[top] for side in sides)
