"""Curves of periodic motions over the frequency of the drive, as Fourier series that balance the forces.

See `calib.dynamics.harmonic_balance` for the equations, and `calib.dynamics.arclength` for what follows the curves.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from calib.dynamics.arclength import Mark, along_cubic, root, roots
from calib.dynamics.branch import TESTS, evidence
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.orbits import newton
from calib.dynamics.response import AMPLITUDE, FREQUENCY
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.modal_system import Forces, ModalMap, ModalSystem

MAX_FIRST_STEPS = 30  # of Newton's method from the linear motion, or from the motion at a frequency beside it
SIZE_FREQUENCIES = 200  # of the linear motion whose largest is the first idea of the size
MIN_SIZE_RATIO, MAX_SIZE_RATIO = 0.2, 2.0  # of the motions of a branch over that by which its steps were chosen
MAX_RESCALINGS = 4  # of the steps of a branch
DIFFERENCE = 1e-6  # of the window, for the slope of the drive's amplitude over the frequency
AT_STOP = "the motion reaches the stop, whose impacts harmonic balance does not serve"

F = TypeVar("F")


class SeriesMotion(NamedTuple):
    """Motion of a curve: coefficients and parameters z (d,), tangent, multipliers, derivative, least clearance [m].

    parameters : number of them, the last components of z
    left_out : velocity of the harmonics left out over that of the motion; NaN where it was not asked for  [1]
    """

    z: np.ndarray
    tangent: np.ndarray
    multipliers: np.ndarray
    matrix: np.ndarray
    corrections: int
    clearance: float
    parameters: int = 1
    left_out: float = math.nan

    @property
    def size(self) -> float:
        """Largest of the coefficients, in units of the scale."""
        return float(np.abs(self.z[: -self.parameters]).max())

    @property
    def stable(self) -> bool:
        """Whether all multipliers are inside the unit circle."""
        return bool(abs(self.multipliers[0]) < 1.0)


@dataclass(frozen=True, eq=False)
class SeriesCurve:
    """The curve of motions over the frequency at one level, as `calib.dynamics.arclength.SolutionCurve`.

    Attributes
    ----------
    low, high : of the frequency  [Hz]
    scale : of the coefficients  [kg^1/2 m]
    drive : amplitude of U at a frequency [Hz]
    run_over : number of the component of z over whose window the curve runs
    """

    balance: HarmonicBalance
    low: float
    high: float
    scale: float
    drive: Callable[[float], float]
    parameters: int = 1
    run_over: int = -1

    def parameter(self, z: np.ndarray) -> float:
        """Frequency  [Hz]."""
        return float((1.0 - z[-1]) * self.low + z[-1] * self.high)  # exact at both edges

    def unpacked(self, z: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Coefficients, angular frequency [rad/s] and amplitude of U."""
        frequency = self.parameter(z)
        return self.scale * z[:-1].reshape(-1, self.balance.size), 2.0 * math.pi * frequency, self.drive(frequency)

    def unpacked_all(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients (m, n, 2 H + 1), angular frequencies [rad/s] and amplitudes of U (m,) of points (m, d)."""
        frequency = (1.0 - z[:, -1]) * self.low + z[:, -1] * self.high
        amplitude = np.array([self.drive(own) for own in frequency.tolist()])
        return self.scale * z[:, :-1].reshape(len(z), -1, self.balance.size), 2.0 * math.pi * frequency, amplitude

    def packed(self, y: np.ndarray, frequency: float) -> np.ndarray:
        """Point z (d,) of coefficients at a frequency [Hz]."""
        return np.append(y.ravel() / self.scale, (frequency - self.low) / (self.high - self.low))

    def packed_all(self, y: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        """Points (m, d) of coefficients (m, n, 2 H + 1) at frequencies (m,) [Hz]."""
        share = (frequency - self.low) / (self.high - self.low)
        return np.column_stack([y.reshape(len(y), -1) / self.scale, share])

    @cached_property
    def _units(self) -> np.ndarray:
        """Size (n (2 H + 1),) of the terms of each equation."""
        return self.scale * self.balance.units(2.0 * math.pi * self.high)

    def residual(self, z: np.ndarray) -> np.ndarray:
        """What is left of the balance (d - 1,), in units of its terms."""
        return self.balance.residual(*self.unpacked(z)).ravel() / self._units

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Residuals (m, d - 1) of points (m, d)."""
        motions = self.unpacked_all(z)
        loads = self.balance.loads_of_all(*motions)
        return self.balance.balanced(*motions, loads).reshape(len(z), -1) / self._units

    def forces(self, z: np.ndarray) -> list[Forces]:
        """Forces along the motions of points (m, d)."""
        return self.balance.forces_of_all(*self.unpacked_all(z))

    def derivative(self, z: np.ndarray) -> np.ndarray:
        """Derivative (d - 1, d) of the residual."""
        y, omega, amplitude = self.unpacked(z)
        width = self.high - self.low
        step = DIFFERENCE * width
        frequency = self.parameter(z)
        slope = (self.drive(frequency + step) - self.drive(frequency - step)) / (2.0 * step)
        by_coefficients, by_omega, by_amplitude = self.balance.derivatives(y, omega, amplitude)
        by_frequency = width * (2.0 * math.pi * by_omega + slope * by_amplitude)
        return np.column_stack([self.scale * by_coefficients, by_frequency.ravel()]) / self._units[:, None]

    def solved(self, guess: np.ndarray, frequency: float) -> np.ndarray | None:
        """Coefficients of a motion at a frequency [Hz], near those guessed; None where Newton's method finds none."""
        at = self.packed(guess, frequency)
        z, _, reason = newton(
            lambda u: self.residual(np.append(u, at[-1])),
            lambda u: self.derivative(np.append(u, at[-1]))[:, :-1],
            at[:-1],
            MAX_FIRST_STEPS,
        )
        return None if reason else self.scale * z.reshape(guess.shape)

    def start(self, y: np.ndarray, frequency: float) -> SeriesMotion | None:
        """Point from which a curve is followed towards higher frequencies."""
        z = self.packed(y, frequency)
        return self.point(z, (0.0,), np.eye(z.size)[-1])

    def point(self, z: np.ndarray, steps: tuple[float, ...], heading: np.ndarray) -> SeriesMotion | None:
        """Point at a solution, its tangent along `heading` (d,); None where the derivative is not known."""
        matrix = self.derivative(z)
        if not np.isfinite(matrix).all():
            return None
        tangent = null_vector(matrix, heading)
        y, omega, amplitude = self.unpacked(z)
        multipliers = self.balance.multipliers(y, omega, amplitude)
        clearance = self.balance.clearance(y, amplitude)
        return SeriesMotion(z, tangent, multipliers, matrix, len(steps) - 1, clearance)

    def predicted(self, base: SeriesMotion, before: SeriesMotion, step: float) -> np.ndarray:
        """Guess on the cubic through the last two points."""
        return along_cubic(base, before, step)

    def obstacle(self, base: SeriesMotion, point: SeriesMotion) -> str:
        """Nothing: series of coefficients depend smoothly on one another."""
        return ""

    def marks(self, base: SeriesMotion, ahead: SeriesMotion) -> list[Mark[SeriesMotion]] | None:
        """Special points between two neighbours; a curve ends where a rigid stop is touched."""
        touch = None
        if ahead.clearance < 0.0:
            touch = root(self, base, ahead, lambda point, _: point.clearance)
            if touch is None:
                return None
        located = roots(self, base, touch or ahead, TESTS)
        if located is None:
            return None
        marks = [Mark(kind, point, evidence(kind, point)) for kind, point in located]
        marks = [mark for mark in marks if mark.evidence]
        return [*marks, Mark("grazing", touch, AT_STOP, last=True)] if touch else marks

    def where(self, point: SeriesMotion) -> str:
        """Frequency of a point."""
        return f"{self.parameter(point.z):g}"

    def at_section(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and velocity (body,) at the section  [m], [m/s]."""
        y, omega, amplitude = self.unpacked(z)
        series, phase = self.balance.bodies(y, amplitude), np.array([self.balance.system.phase])
        return self.balance.at(series, phase)[:, 0], omega * self.balance.at(self.balance.slope(series), phase)[:, 0]

    def state(self, z: np.ndarray) -> np.ndarray:
        """State (dimension,) of the period map at its section  [m], [m/s], internal states of the forces in theirs."""
        displacement, velocity = self.at_section(z)
        free = list(self.balance.system.free)
        return np.concatenate([displacement[free], velocity[free], self.balance.inner_states(*self.unpacked(z))])

    def complex_amplitudes(self, z: np.ndarray, begin: float) -> np.ndarray:
        """Complex amplitudes (body, H + 1) of the displacement [m], see `HarmonicBalance.body_amplitudes`."""
        y, _, amplitude = self.unpacked(z)
        return self.balance.body_amplitudes(y, amplitude, begin)


def modal_system(setting: Setting, frequency: float, level: float) -> ModalSystem:
    """Return the modal system of a setting at a frequency [Hz] and level.

    Raises
    ------
    CalibError : it tells none, or has forces that harmonic balance does not serve
    """
    map = setting.map({FREQUENCY: frequency, AMPLITUDE: level})
    if not isinstance(map, ModalMap):
        raise CalibError(
            f"the period map of {setting.model.name!r} does not tell its modal system, which harmonic balance is of; "
            "where there is the choice, take shooting"
        )
    return map.modal_system()


def at_own_scale(scale: float, followed: Callable[[float], tuple[F, Sequence[SeriesMotion]] | None]) -> F | None:
    """Follow a curve anew until its steps suit the motions on it; None where there is no curve.

    Parameters
    ----------
    scale : of the coefficients, at first  [kg^1/2 m]
    followed : what is followed at a scale, and the motions on it; None where there is none
    """
    found = None
    for _ in range(MAX_RESCALINGS):
        answer = followed(scale)
        if answer is None:
            return None
        found, motions = answer
        size = max(motion.size for motion in motions)
        if MIN_SIZE_RATIO <= size <= MAX_SIZE_RATIO:
            break
        scale *= size
    return found


def linear_size(balance: HarmonicBalance, window: tuple[float, float], drive: Callable[[float], float]) -> float:
    """Largest coefficient of the linear motion over a window [Hz] of frequencies  [kg^1/2 m]; 1 where all are zero.

    drive : amplitude of U at a frequency [Hz]
    """
    frequencies = np.linspace(*window, SIZE_FREQUENCIES)
    drives = np.array([drive(frequency) for frequency in frequencies.tolist()])
    return float(np.abs(balance.linear_motion(2.0 * math.pi * frequencies, drives)).max()) or 1.0


def null_vector(matrix: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Unit vector (d,) that the matrix (d - 1, d) takes to zero, along `heading` (d,)."""
    try:
        vector = np.linalg.solve(np.vstack([matrix, heading]), np.eye(heading.size)[-1])
        vector /= np.linalg.norm(vector)
    except np.linalg.LinAlgError:
        vector = np.linalg.svd(matrix)[2][-1]
    return vector if vector @ heading >= 0.0 else -vector
