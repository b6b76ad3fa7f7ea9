"""The prescribed displacement of the middle, as each kernel wants it."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numba import njit

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw
from calib.records.excitation import Excitation, Harmonic
from calib.simulators import law_calls
from calib.simulators.compilation import COMPILED
from calib.simulators.law_calls import addresses

PLACE, QUANTITY = "centre", "displacement"  # of the excitation that the simulator takes
STEPS_AT_START = 1024  # a period, of the differences that give the velocity of laws at time 0
MIN_DRIVE_AMPLITUDE = 1e-6  # m, of a drive, where it is the scale of the motion


def centre_displacement(excitation: Excitation) -> Harmonic:
    """Return the harmonic displacement of the centre [m] that an excitation is.

    Raises
    ------
    CalibError : it is another one
    """
    if (excitation.quantity, excitation.place) != (QUANTITY, PLACE) or not excitation.harmonic:
        given = f"{'recorded ' if excitation.recorded else ''}{excitation.quantity} at {excitation.place!r}"
        raise CalibError(f"delaminated_beam takes a harmonic {QUANTITY} at {PLACE!r}, got {given}")
    return excitation.as_harmonic


@njit(**COMPILED)
def changes(
    times: np.ndarray,
    period: float,
    amplitude: float,
    phase: float,
    functions: np.ndarray,
    parameters: np.ndarray,
    count: int,
) -> np.ndarray:
    """Sum of the laws of the excitation at the times (n,)  [m]."""
    table = np.zeros(len(times))
    for k in range(len(times)):
        cycles = times[k] / period
        angle = 2.0 * math.pi * (cycles - math.floor(cycles)) + phase
        x = amplitude * math.cos(angle)
        for law in range(count):
            table[k] += law_calls.excitation(functions[law], times[k], angle, amplitude, x, parameters[law])
    return table


class BeamDrive:
    """X(t) = amplitude cos(2 pi t / period + phase) + laws.

    Attributes
    ----------
    period, amplitude, phase : [s], [m], [rad]
    """

    def __init__(self, excitation: Harmonic, scale: float, alpha: float, laws: Sequence[BoundLaw]) -> None:
        self.period = excitation.period
        self.amplitude = scale * excitation.amplitude
        self.phase = excitation.phase
        self._alpha = alpha
        self._laws = addresses(laws, "excitation")
        self._tables: dict[tuple[str, int], np.ndarray] = {}

    @property
    def length(self) -> float:
        """Scale of the motion  [m]."""
        return max(abs(self.amplitude), MIN_DRIVE_AMPLITUDE)

    @property
    def speed(self) -> float:
        """Scale of its velocity  [m/s]."""
        return 2.0 * np.pi / self.period * self.length

    def at_start(self) -> tuple[float, float]:
        """Displacement [m] and velocity [m/s] at time 0."""
        [x, v, _] = self.table(0, STEPS_AT_START)[0]
        return float(x), float(v)

    def displacements(self, period: int, count: int) -> np.ndarray:
        """X (count,) at the ends of equal steps of a period  [m]."""
        return self._cached("displacements", period, count)

    def table(self, period: int, count: int) -> np.ndarray:
        """X [m], X' [m/s] and X'' + alpha X' [m/s^2] (count + 1, 3) at the ends of equal parts of a period."""
        return self._cached("derivatives", period, count)

    def _cached(self, kind: Literal["displacements", "derivatives"], period: int, count: int) -> np.ndarray:
        """Return a table, cached where it is the same in every period: without laws, which may depend on the time."""
        make = self._displacements if kind == "displacements" else self._derivatives
        if self._laws[2]:
            return make(period, count)
        if (kind, count) not in self._tables:
            self._tables[kind, count] = make(0, count)
        return self._tables[kind, count]

    def _displacements(self, period: int, count: int) -> np.ndarray:
        cycles = np.arange(1, count + 1) / count
        table = self.amplitude * np.cos(2.0 * np.pi * cycles + self.phase)
        return table + self._changes((period + cycles) * self.period) if self._laws[2] else table

    def _derivatives(self, period: int, count: int) -> np.ndarray:
        cycles = np.arange(count + 1) / count
        angle, omega = 2.0 * np.pi * cycles + self.phase, 2.0 * np.pi / self.period
        cosine, sine = self.amplitude * np.cos(angle), self.amplitude * np.sin(angle)
        x, v, a = cosine, -omega * sine, -(omega**2) * cosine
        if self._laws[2]:
            step = self.period / count
            more = self._changes((period + np.arange(-1, count + 2) / count) * self.period)
            x = x + more[1:-1]
            v = v + (more[2:] - more[:-2]) / (2.0 * step)
            a = a + (more[2:] - 2.0 * more[1:-1] + more[:-2]) / step**2
        return np.ascontiguousarray(np.stack([x, v, a + self._alpha * v], axis=1))

    def _changes(self, times: np.ndarray) -> np.ndarray:
        return changes(times, self.period, self.amplitude, self.phase, *self._laws)
