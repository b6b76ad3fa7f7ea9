"""The level of the excitation over its frequency, or an amplitude that is held, as measured point by point."""

import math
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator, make_smoothing_spline

MIN_SMOOTHED_READINGS = 5  # of an amplitude that was held [count]; fewer are taken as they are
POWERS_BEYOND = -4.0, 2.0  # of the frequency, beyond the ends of a held amplitude: acceleration has -2  [1]
SAME_LEVEL = 1e-12  # relative difference of levels, by rounding  [1]


class LevelCurve:
    """A smooth curve through levels over the frequency, monotone between them.

    It is a curve without corners (Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238) of the logarithm, so that
    the level stays above 0; beyond the ends it goes on with its slope there. At a frequency that was measured several
    times it is the mean of the levels there. Corners would be corners of the response, at which its continuation ends.

    Parameters
    ----------
    frequency, level : (n,)  [Hz], in the unit of the level

    Attributes
    ----------
    constant : the level, where it is one; else None
    """

    def __init__(self, frequency: np.ndarray, level: np.ndarray) -> None:
        known, values = _means(frequency, level)
        self.constant: float | None = None
        # the equations at one frequency are asked for several times, one after the other
        self._near = lru_cache(maxsize=8)(self._logarithm)
        if known.size == 1 or np.ptp(values) <= SAME_LEVEL:
            self.constant = float(level[0]) if np.ptp(level) <= SAME_LEVEL * level[0] else math.exp(values[0])
            return
        self._low, self._high = float(known[0]), float(known[-1])
        self._curve = PchipInterpolator(known, self._smoothed(known, values))
        self._slope = self._curve.derivative()

    def __call__(self, frequency: float) -> float:
        """Level at a frequency  [Hz]."""
        return self._near(frequency)[0] if self.constant is None else self.constant

    def logarithmic_slope(self, frequency: float) -> float:
        """Derivative of the logarithm of the level by the frequency, at a frequency [Hz]  [1/Hz]."""
        return self._near(frequency)[1] if self.constant is None else 0.0

    def _logarithm(self, frequency: float) -> tuple[float, float]:
        inside = min(max(frequency, self._low), self._high)
        slope = float(self._slope(inside))
        if inside != frequency:
            slope = self._slope_beyond(inside, slope)
        return math.exp(float(self._curve(inside)) + slope * (frequency - inside)), slope

    def _smoothed(self, frequency: np.ndarray, logarithms: np.ndarray) -> np.ndarray:
        """Logarithms (k,) of the levels at frequencies (k,) through which the curve runs: the measured ones."""
        return logarithms

    def _slope_beyond(self, frequency: float, slope: float) -> float:
        """Slope with which the logarithm goes on beyond an end [Hz]: the one there  [1/Hz]."""
        return slope


class HeldAmplitude(LevelCurve):
    """The amplitude at which a controller held a body over the frequency: readings of it without their noise.

    The logarithm over that of the frequency is a smoothing spline by generalised cross-validation (Wahba, Spline Models
    for Observational Data, 1990, chapter 4), of which a constant displacement, velocity or acceleration is the
    smoothest. Beyond the ends it goes on with its slope there, as far as readings that drift may have it.

    frequency, level : (n,) readings  [Hz], [m]
    """

    def _smoothed(self, frequency: np.ndarray, logarithms: np.ndarray) -> np.ndarray:
        if frequency.size < MIN_SMOOTHED_READINGS:
            return logarithms
        place = np.log(frequency)
        return np.asarray(make_smoothing_spline(place, logarithms)(place))

    def _slope_beyond(self, frequency: float, slope: float) -> float:
        return min(max(slope * frequency, POWERS_BEYOND[0]), POWERS_BEYOND[1]) / frequency


def _means(frequency: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (k,) that differ, and the logarithm of the mean level at each."""
    known, place = np.unique(frequency, return_inverse=True)
    return known, np.log(np.bincount(place, weights=level) / np.bincount(place))
