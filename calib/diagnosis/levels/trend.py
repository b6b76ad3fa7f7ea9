"""Trends of the equivalent damping and of the resonance frequency over the amplitude.

At resonance the excitation balances the damping force: A = c omega X, with the equivalent viscous damping c of the
motion of amplitude X (Nayfeh & Mook, Nonlinear Oscillations, 1979, chapter 3; Ewins, Modal Testing, 2nd ed. 2000,
chapter 4, of the peak of the receptance X / A). So c is 1 / (omega X / A) but for a factor that a mode shape makes,
which its power of the amplitude does not depend on: 0 of viscous damping, -1 of dry friction, 1 of quadratic drag.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.levels.peak import Peak

MIN_RELATIVE_ERROR = 1e-12  # of what is exact but for rounding  [1]


@dataclass(frozen=True)
class LevelTrend:
    """A slope, and its standard error."""

    slope: float
    error: float

    @property
    def significant(self) -> bool:
        """Whether the slope exceeds three of its standard errors."""
        return abs(self.slope) > CRITERIA.significance_std * self.error


def damping_trend(level: Sequence[float], peaks: Sequence[Peak], group: Sequence[int], held: bool) -> LevelTrend | None:
    """Power of the amplitude that the equivalent damping goes with; None where the amplitude does not rise.

    The level, which has no error, is the instrument of the regression on the amplitude, whose error is that of the
    damping too.

    Parameters
    ----------
    level : of each sweep; of one at a held amplitude that
    peaks : of each sweep, resolved ones
    group : number of the level of each sweep, which repeated sweeps share
    held : whether the levels are amplitudes
    """
    receptance = _slope(level, [math.log(p.receptance) for p in peaks], [p.relative_error for p in peaks], group)
    relative = [p.frequency_error / p.frequency for p in peaks]
    frequency = _slope(level, [math.log(p.frequency) for p in peaks], relative, group)
    if held:
        return LevelTrend(-receptance.slope - frequency.slope, math.hypot(receptance.error, frequency.error))
    amplitude = 1.0 + receptance.slope  # d ln X / d ln A
    if not amplitude > 0.0:
        return None
    error = math.hypot((1.0 - frequency.slope) / amplitude**2 * receptance.error, frequency.error / amplitude)
    return LevelTrend(-(receptance.slope + frequency.slope) / amplitude, error)


def resonance_trend(level: Sequence[float], peaks: Sequence[Peak], group: Sequence[int]) -> LevelTrend:
    """Change of the resonance frequency from the least to the greatest level [Hz], by a line over their logarithm."""
    trend = _slope(level, [p.resonance for p in peaks], [p.frequency_error for p in peaks], group)
    span = math.log(max(level) / min(level))
    return LevelTrend(span * trend.slope, span * trend.error)


def _slope(
    level: Sequence[float], values: Sequence[float], errors: Sequence[float], group: Sequence[int]
) -> LevelTrend:
    """Slope of values of these standard errors over the logarithm of the level.

    All sweeps count alike: where the values bend, weights that are estimated themselves would move the slope. Repeated
    sweeps that differ by more than their errors enlarge these (pure error).
    """
    x, y, error, groups = np.log(level), np.asarray(values), np.asarray(errors), np.asarray(group)
    error = np.maximum(error, MIN_RELATIVE_ERROR * np.abs(y).max())
    pure, freedom = 0.0, y.size - np.unique(groups).size
    for own in (groups == number for number in np.unique(groups)):
        pure += float((((y[own] - y[own].mean()) / error[own]) ** 2).sum())
    away = (x - x.mean()) / float(((x - x.mean()) ** 2).sum())
    scale = math.sqrt(max(1.0, pure / freedom)) if freedom else 1.0
    return LevelTrend(float(away @ y), scale * float(np.linalg.norm(away * error)))
