"""Stable stretches of a sweep by harmonic balance, where a simulator tells its modal system.

A stretch is followed along its curve (`calib.dynamics.series_curve`) to where it loses its stability or touches a rigid
stop. The number of harmonics is doubled until those left out hardly move the bodies.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from calib.dynamics.arclength import EDGE_ROUNDING, MAX_ARCLENGTH_STEP, Mark, OneWay, run
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.neighbour_curve import MAX_SPACING_RATIO, first_order_curve, neighbour_curve
from calib.dynamics.response import AMPLITUDE, FREQUENCY, harmonics_of_cycle
from calib.dynamics.series_curve import (
    MAX_SIZE_RATIO,
    MIN_SIZE_RATIO,
    SeriesCurve,
    SeriesMotion,
    at_own_scale,
    linear_size,
    modal_system,
)
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.modal_system import ModalSystem
from calib.records.response import HIGHEST_ORDER

SERIES_HARMONICS = HIGHEST_ORDER, 15, 31, 63  # of the series, the next where those left out are more than MAX_LEFT_OUT
MAX_LEFT_OUT = 3e-4  # velocity by the harmonics left out over that of the motion  [1]
MAX_STRETCH_LENGTH = 20.0  # of one stable stretch along its curve, in scaled coordinates
STEP_SHARE = 0.5  # of the mean step between stops, where the level changes from one to the next  [1]
SAME_MOTION = 0.02  # between the harmonics of a cycle and the series found from them, over its size  [1]


class SeriesStretch(NamedTuple):
    """A stable stretch of m motions.

    Attributes
    ----------
    frequency : (m,)  [Hz]
    harmonics : (m, body, k) complex amplitudes of the displacement, the mean and those of the shortest series  [m]
    coefficients : (m, n, 2 H + 1) of the modal motion  [kg^1/2 m]
    scale : of these by which the steps along it were chosen  [kg^1/2 m]
    last : state (dimension,) of the section at its last motion
    end : kind of the special point at its end; "" at the edge of the window
    """

    frequency: np.ndarray
    harmonics: np.ndarray
    coefficients: np.ndarray
    scale: float
    last: np.ndarray
    end: str

    @property
    def periods(self) -> int:
        """Of the excitation, in one of the motion."""
        return 1


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
    longest_step : along the curve, in its scaled coordinates
    """

    setting: Setting
    system: ModalSystem
    unit_level: float
    window: tuple[float, float]
    direction: float
    level: Callable[[float], float]
    longest_step: float = MAX_ARCLENGTH_STEP

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
        """Follow the stable motion through a state of the section to its end; None where no series describes it.

        With more harmonics a stretch to the edge of the window is sought beside that of fewer. Not so where forces have
        internal states: that the instants do not resolve those shows in ever shorter steps along the curve, and not in
        the harmonics left out.
        """
        fewer = None
        for harmonics in SERIES_HARMONICS:
            balance = HarmonicBalance(self.system, harmonics)
            found = self._beside(balance, fewer) if fewer else None
            if found is None:
                y = self._coefficients(balance, frequency, state)
                followed = at_own_scale(self._linear_size, partial(self._followed, balance, y, frequency))
                if followed is None or not _is_stable(followed[1]):
                    return None
                curve, way = followed
                z, end = np.array([motion.z for motion in way.points]), way.marks[0][1].kind if way.marks else ""
            else:
                (curve, z), end = found, ""
            if _is_described(curve, z):
                return self._stretch(curve, z, end)
            alone = len(z) == 1  # a sweep that ends where it begins
            fewer = None if end or alone or self.system.marched else self._stretch(curve, z, end)
        return None

    def beside(self, known: SeriesStretch) -> SeriesStretch | None:
        """Stable stretch over the window beside one of other parameters; None where it is sought without that.

        That is where the known one ends before the window does or has other modes, and where the new one loses its
        stability, comes to a stop, or needs other steps or more harmonics.
        """
        _, modes, size = known.coefficients.shape
        if not self._is_whole(known) or modes != len(self.system.stiffness):
            return None
        found = self._beside(HarmonicBalance(self.system, (size - 1) // 2), known)
        return self._stretch(*found, "") if found and _is_described(*found) else None

    def beside_to_first_order(self, known: SeriesStretch) -> SeriesStretch | None:
        """Stretch beside a known one as `beside`, to first order in the change of parameters, as derivatives need it.

        It is as stable as the known one, and is described by as many harmonics.
        """
        _, modes, size = known.coefficients.shape
        if not self._is_whole(known) or modes != len(self.system.stiffness):
            return None
        curve = self._curve(HarmonicBalance(self.system, (size - 1) // 2), known.scale)
        z = first_order_curve(curve, curve.packed_all(known.coefficients, known.frequency))
        return None if z is None else self._stretch(curve, z, "")

    def backward(self, there: SeriesStretch) -> SeriesStretch | None:
        """Stretch back over the motions of a sweep the other way; None where that does not begin with its last one.

        A curve that is stable from edge to edge has no fold, so that whoever is on it stays on it both ways.
        """
        first = self.first(float(there.frequency[-1])) if self._is_whole(there) else None
        if first is None:
            return None
        begin = float(there.frequency[-1])
        scale = self.setting.map({FREQUENCY: begin, AMPLITUDE: self.level(begin)}).scale
        if np.abs((first - there.last) / scale).max() > SAME_MOTION * np.abs(there.last / scale).max():
            return None
        curve = self._curve(HarmonicBalance(self.system, (there.coefficients.shape[-1] - 1) // 2), there.scale)
        return self._stretch(curve, curve.packed_all(there.coefficients, there.frequency)[::-1], "")

    def _is_whole(self, stretch: SeriesStretch) -> bool:
        """Whether a stretch goes from edge to edge of the window."""
        return not stretch.end and {*stretch.frequency[[0, -1]].tolist()} == {*self.window}

    def _beside(self, balance: HarmonicBalance, known: SeriesStretch) -> tuple[_StableCurve, np.ndarray] | None:
        """Curve, and points (m, d) of its stable stretch beside a known one of at most as many harmonics."""
        curve = self._curve(balance, known.scale)
        further = [(0, 0), (0, 0), (0, balance.size - known.coefficients.shape[-1])]
        found = neighbour_curve(curve, curve.packed_all(np.pad(known.coefficients, further), known.frequency))
        if found is None:
            return None
        z, forces = found
        coefficients, omega, amplitude = curve.unpacked_all(z)
        suits = MIN_SIZE_RATIO <= np.abs(z[:, :-1]).max() <= MAX_SIZE_RATIO
        close = np.linalg.norm(np.diff(z, axis=0), axis=1).max() <= MAX_SPACING_RATIO * self.longest_step
        stable = all(
            abs(balance.multipliers_by(*own)[0]) < 1.0 for own in zip(forces, omega.tolist(), strict=True)
        ) and all(balance.clearance(*own) >= 0.0 for own in zip(coefficients, amplitude.tolist(), strict=True))
        return (curve, z) if suits and close and stable else None

    def _stretch(self, curve: SeriesCurve, z: np.ndarray, end: str) -> SeriesStretch:
        """Stretch of the motions at points (m, d) of a curve."""
        begin = self.setting.section_phase
        return SeriesStretch(
            np.array([curve.parameter(own) for own in z]),
            np.array([curve.complex_amplitudes(own, begin)[:, : SERIES_HARMONICS[0] + 1] for own in z]),
            curve.unpacked_all(z)[0],
            curve.scale,
            curve.state(z[-1]),
            end,
        )

    def _followed(
        self, balance: HarmonicBalance, y: np.ndarray, frequency: float, scale: float
    ) -> tuple[tuple[_StableCurve, OneWay[SeriesMotion]], list[SeriesMotion]] | None:
        """Curve from the stable motion near coefficients, with steps by a scale; None where there is no such motion."""
        curve = self._curve(balance, scale)
        found = curve.solved(y, frequency)
        if found is None or np.abs(found - y).max() > SAME_MOTION * np.abs(y).max():
            return None
        start = curve.start(found, frequency)
        if start is None or not start.stable or start.clearance < 0.0:
            return None
        most = math.ceil(MAX_STRETCH_LENGTH / self.longest_step)
        way = run(curve, start._replace(tangent=self.direction * start.tangent), most, self.longest_step)
        return (curve, way), way.points

    def _coefficients(self, balance: HarmonicBalance, frequency: float, state: np.ndarray) -> np.ndarray:
        """Coefficients (n, 2 H + 1) of the cycle through a state of the section."""
        begin = self.setting.section_phase
        amplitudes = harmonics_of_cycle(self.setting, 1, balance.harmonics, frequency, self.level(frequency), state)[0]
        return balance.of_body_amplitudes(amplitudes, self._drive(frequency), begin)


def _is_described(curve: SeriesCurve, z: np.ndarray) -> bool:
    """Whether the harmonics left out hardly move the bodies at the ends of a stretch (m, d) and where it is largest."""
    largest = int(np.argmax(np.abs(z[:, :-1]).max(axis=1)))
    return all(curve.balance.left_out(*curve.unpacked(z[at])) <= MAX_LEFT_OUT for at in (0, largest, -1))


def _is_stable(way: OneWay[SeriesMotion]) -> bool:
    """Whether a way was followed to a special point or the edge of the window, and is stable up to there."""
    before = way.points[: way.marks[0][0]] if way.marks else way.points
    at = float(way.points[-1].z[-1])
    ended = bool(way.marks) or min(abs(at), abs(1.0 - at)) <= EDGE_ROUNDING
    return ended and not way.lost and all(motion.stable for motion in before)


def series_sweep(setting: Setting, level: Callable[[float], float], stops: np.ndarray) -> SeriesSweep | None:
    """Harmonic balance over the stops (n,) [Hz] of a sweep; None where it does not serve the simulator.

    level : amplitude of the excitation at a frequency [Hz]
    """
    begin = float(stops[0])
    try:
        system = modal_system(setting, begin, level(begin))
    except CalibError:
        return None
    window = float(stops.min()), float(stops.max())
    levels = {level(stop) for stop in stops.tolist()}
    # a level that was measured point by point makes the curve bend from point to point
    longest = MAX_ARCLENGTH_STEP if len(levels) == 1 else min(MAX_ARCLENGTH_STEP, STEP_SHARE / stops.size)
    return SeriesSweep(setting, system, level(begin), window, float(np.sign(stops[-1] - begin)), level, longest)
