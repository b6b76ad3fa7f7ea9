"""Stable stretches of a sweep by harmonic balance, where a simulator tells its modal system.

A stretch is followed along its curve (`calib.dynamics.series_curve`) to where it loses its stability or touches a rigid
stop. The number of harmonics is doubled until those left out hardly move the bodies.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calib.dynamics.arclength import Mark, run
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.response import AMPLITUDE, FREQUENCY, harmonics_of_cycle
from calib.dynamics.series_curve import (
    MAX_RESCALINGS,
    MAX_SIZE_RATIO,
    MIN_SIZE_RATIO,
    SeriesCurve,
    SeriesMotion,
    linear_size,
)
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.modal_system import ModalMap, ModalSystem

SERIES_HARMONICS = 7, 15, 31, 63  # of the series, the next where those left out are more than MAX_LEFT_OUT
MAX_LEFT_OUT = 3e-4  # velocity by the harmonics left out over that of the motion  [1]
MAX_STRETCH_POINTS = 400  # of one stable stretch
SAME_MOTION = 0.02  # between the harmonics of a cycle and the series found from them, over its size  [1]


class SeriesStretch(NamedTuple):
    """A stable stretch: frequencies (m,) [Hz], complex amplitudes (m, body) [m], states (m, dimension), and its end.

    end : kind of the special point at its end; "" at the edge of the window
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    states: np.ndarray
    end: str


class _StableCurve(SeriesCurve):
    """A curve that ends at its first special point."""

    def marks(self, base: SeriesMotion, ahead: SeriesMotion) -> list[Mark[SeriesMotion]] | None:
        found = super().marks(base, ahead)
        return None if found is None else [mark._replace(last=True) for mark in found[:1]]


@dataclass(frozen=True, eq=False)
class SeriesSweep:
    """Stretches of one sweep.

    Attributes
    ----------
    system : of the simulator at the level `unit_level`
    window : lowest and highest frequency  [Hz]
    direction : 1.0 up, -1.0 down
    level : amplitude of the excitation at a frequency [Hz]
    """

    setting: Setting
    system: ModalSystem
    unit_level: float
    window: tuple[float, float]
    direction: float
    level: Callable[[float], float]

    @cached_property
    def _begin(self) -> float:
        """Phase of the excitation at the section  [rad]."""
        return self.setting.excitation.phase + 2.0 * math.pi * self.setting.phase

    def _drive(self, frequency: float) -> float:
        return self.system.amplitude / self.unit_level * self.level(frequency)

    def _curve(self, balance: HarmonicBalance, scale: float) -> _StableCurve:
        return _StableCurve(balance, *self.window, scale, self._drive)

    @cached_property
    def _linear_size(self) -> float:
        return linear_size(HarmonicBalance(self.system, 1), self.window, self._drive)

    def first(self, frequency: float) -> np.ndarray | None:
        """State (dimension,) of the stable motion that Newton's method finds from the linear one; None without one."""
        balance = HarmonicBalance(self.system, SERIES_HARMONICS[0])
        guess = balance.linear_motion(2.0 * math.pi * frequency, self._drive(frequency))
        curve = self._curve(balance, self._linear_size)
        y = curve.solved(guess, frequency)
        start = None if y is None else curve.start(y, frequency)
        return curve.state(start.z) if start is not None and start.stable and start.clearance >= 0.0 else None

    def stretch(self, frequency: float, state: np.ndarray) -> SeriesStretch | None:
        """Follow the stable motion through a state of the section to its end; None where no series describes it."""
        for harmonics in SERIES_HARMONICS:
            curve, motions, end = self._followed(HarmonicBalance(self.system, harmonics), frequency, state)
            if not motions:
                return None
            largest = max(motions, key=lambda motion: float(np.abs(motion.z[:-1]).max()))
            looked_at = (curve.unpacked(motion.z) for motion in (motions[0], largest, motions[-1]))
            if all(curve.balance.left_out(*motion) <= MAX_LEFT_OUT for motion in looked_at):
                return SeriesStretch(
                    np.array([curve.parameter(motion.z) for motion in motions]),
                    np.array([curve.complex_amplitudes(motion.z, self._begin)[:, 1] for motion in motions]),
                    np.array([curve.state(motion.z) for motion in motions]),
                    end,
                )
        return None

    def _followed(
        self, balance: HarmonicBalance, frequency: float, state: np.ndarray
    ) -> tuple[_StableCurve, list[SeriesMotion], str]:
        """Curve, its stable motions with the special one at its end, and the kind of that; no motions without them."""
        y = self._coefficients(balance, frequency, state)
        curve = self._curve(balance, self._linear_size)
        for _ in range(MAX_RESCALINGS):
            found = curve.solved(y, frequency)
            start = None if found is None else curve.start(found, frequency)
            if found is None or start is None or not start.stable or start.clearance < 0.0:
                return curve, [], ""
            if np.abs(found - y).max() > SAME_MOTION * np.abs(y).max():
                return curve, [], ""
            way = run(curve, start._replace(tangent=self.direction * start.tangent), MAX_STRETCH_POINTS)
            size = max(float(np.abs(motion.z[:-1]).max()) for motion in way.points)
            if MIN_SIZE_RATIO <= size <= MAX_SIZE_RATIO:
                break
            curve = self._curve(balance, size * curve.scale)
        marked = [(index, mark.kind) for index, mark in way.marks]
        own = way.points[: marked[0][0]] if marked else way.points
        if way.lost or not all(motion.stable for motion in own):
            return curve, [], ""
        return curve, way.points, marked[0][1] if marked else ""

    def _coefficients(self, balance: HarmonicBalance, frequency: float, state: np.ndarray) -> np.ndarray:
        """Coefficients (n, 2 H + 1) of the cycle through a state of the section."""
        level = self.level(frequency)
        amplitudes = harmonics_of_cycle(self.setting, 1, balance.harmonics, frequency, level, state)[0]
        turn = np.exp(-1j * np.arange(balance.harmonics + 1) * (self.system.phase - self._begin))
        return balance.of_bodies(balance.series(amplitudes * turn), self._drive(frequency))


def modal_system(setting: Setting, frequency: float, level: float) -> ModalSystem | None:
    """Return the modal system of a setting at a frequency [Hz] and level; None where it tells none."""
    map = setting.map({FREQUENCY: frequency, AMPLITUDE: level})
    if not isinstance(map, ModalMap):
        return None
    try:
        return map.modal_system()
    except CalibError:  # of forces that harmonic balance does not serve
        return None
