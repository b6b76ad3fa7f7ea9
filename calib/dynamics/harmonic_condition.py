"""Conditions on the first harmonic H_1 of a body, which stand beside the equations of a harmonic balance."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from calib.dynamics.level_curve import LevelCurve


class HarmonicCondition(NamedTuple):
    """Value of a condition, without a unit, and its changes.

    Attributes
    ----------
    slope : change of the value with small changes (k,) of the first harmonic [m]
    by_frequency, by_level : the same with frequency and level, the harmonic held  [1/Hz], [1 over its unit]
    """

    value: float
    slope: Callable[[np.ndarray], np.ndarray]
    by_frequency: float = 0.0
    by_level: float = 0.0


Condition = Callable[[complex, float, float], HarmonicCondition]  # of H_1 [m], frequency [Hz] and level


class ReadHarmonic(NamedTuple):
    """First harmonic that is measured of a body: motion(f) H_1 + level(f) A, at the frequency f and the level A.

    Attributes
    ----------
    motion, level : complex, over the frequency [Hz]  [1], [m over the unit of the level]
    """

    motion: CubicSpline
    level: CubicSpline

    def __call__(self, first: complex, frequency: float, level: float, order: int = 0) -> complex:
        """Measured harmonic [m], or its derivative by the frequency, of an order."""
        return complex(self.motion(frequency, order) * first + self.level(frequency, order) * level)


def quadrature(first: complex, frequency: float, level: float) -> HarmonicCondition:
    """Cosine of the angle by which the first harmonic lags."""
    size = abs(first) or 1.0
    return HarmonicCondition(first.real / size, lambda change: (change / first).imag * -first.imag / size)


def modulus(amplitude: LevelCurve, read: ReadHarmonic | None = None, share: float = 1.0) -> Condition:
    """Logarithm of the modulus that is measured over a share of the amplitude that is held.

    read : what is measured; None: the first harmonic itself
    """

    def condition(first: complex, frequency: float, level: float) -> HarmonicCondition:
        measured, turned, moved, of_level = first, 1.0 + 0.0j, 0.0j, 0.0j
        if read is not None:
            measured, turned = read(first, frequency, level), complex(read.motion(frequency))
            moved, of_level = read(first, frequency, level, 1), complex(read.level(frequency))
        if not measured:
            return HarmonicCondition(-math.inf, lambda change: np.full(change.shape, np.nan))
        return HarmonicCondition(
            math.log(abs(measured) / (share * amplitude(frequency))),
            lambda change: (turned * change / measured).real,
            (moved / measured).real - amplitude.logarithmic_slope(frequency),
            (of_level / measured).real,
        )

    return condition
