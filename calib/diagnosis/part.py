"""One measured record as a diagnosis compares it: its rows, their noise, and what belongs to it alone."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.clock import CLOCK_RATE_STD, clock_sensitivity, time_derivative
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.score import variance_along

MIN_POINTS_PER_PARAMETER = 4  # of a sweep in which calibrated parameters may be its own  [count]
MIN_SEGMENT_SAMPLES = 8  # of a segment, beyond which noise is hardly correlated  [count]
MIN_SEGMENTS = 20  # of a record, whose scores count as independent  [count]


@dataclass(frozen=True, eq=False)
class Part:
    """One record as a diagnosis compares it.

    Attributes
    ----------
    name : of the record
    rows : (body, channel) pairs
    time : (n,) instants [s]; of a frequency response the numbers of its points
    measured : (row, n), each in its unit
    period : of the excitation [s], None without one
    cycle : of the motion, in periods of the excitation
    nuisance : names of the nuisances of this measurement
    noise : of each row
    used : (row, n) whether a sample is compared: not what the excitation prescribes, and no outlier
    weight : (row, n) in [0, 1], 0 where a sample is not compared
    clock : (row, n) change of the rows with the rate of the clock, where that is uncertain and no nuisance
        [per unit rate]; None elsewhere
    variance_along_clock : variance of what a model leaves along that change, over the noise's  [1]
    sweep, level : (n,) numbers of the sweep that each point of a frequency response belongs to, and of its level, which
        repeated sweeps share; None over time
    frequency : (n,) of the excitation at each point of a frequency response [Hz]; None over time
    sigma_source : of the uncertainties that the record holds
    """

    name: str
    rows: tuple[tuple[str, str], ...]
    time: np.ndarray
    measured: np.ndarray
    period: float | None
    cycle: int
    nuisance: tuple[str, ...]
    noise: tuple[Noise, ...]
    used: np.ndarray
    weight: np.ndarray
    clock: np.ndarray | None = None
    variance_along_clock: float = 1.0
    sweep: np.ndarray | None = None
    level: np.ndarray | None = None
    frequency: np.ndarray | None = None
    sigma_source: str = STATED

    @property
    def is_swept(self) -> bool:
        """Whether it is a frequency response."""
        return self.sweep is not None

    @property
    def compared_noise(self) -> tuple[Noise, ...]:
        """Noise of the rows that are compared: a row that the excitation prescribes has none."""
        return tuple(noise for noise, used in zip(self.noise, self.used, strict=True) if used.any())

    def source_of(self, noise: Noise) -> str:
        """From which the level of the noise of a row is known, for readers."""
        return self.sigma_source if noise.source == STATED else noise.source

    def white(self, rows: np.ndarray) -> np.ndarray:
        """Rows (row, n) in units of the noise, one after the other (row * n,)."""
        return self.shrunk(self.whitened(rows), 1.0)

    def whitened(self, rows: np.ndarray) -> np.ndarray:
        """Rows (row, n) in units of the noise without the uncertainty of the clock (row * n,)."""
        parts = [noise.whitened(row, w) for noise, row, w in zip(self.noise, rows, self.weight, strict=True)]
        return np.concatenate(parts)

    def of_row(self, columns: np.ndarray, row: int) -> np.ndarray:
        """Whitened columns (row * n, k) of what changes one of the rows alone."""
        alone = np.repeat(np.arange(len(self.rows)) == row, self.time.size)
        return self.shrunk(alone[:, None] * self.shrunk(columns, -1.0), 1.0)

    def restored(self, columns: np.ndarray) -> np.ndarray:
        """Undo `white`: columns (row * n, k) to (row, n, k) in the units of the rows; 0 where nothing counts."""
        blocks = zip(self.noise, np.split(self.shrunk(columns, -1.0), len(self.rows)), self.weight, strict=True)
        return np.array([noise.coloured(block.T, weight).T for noise, block, weight in blocks])

    def by_sweep(self, columns: np.ndarray) -> np.ndarray:
        """Whitened columns (row * n, k) of what changes one sweep alone, of each long enough (row * n, k * sweep).

        Of a sweep of few points, as where the level is stepped at a frequency, they would leave nothing. A record over
        time has none.
        """
        if self.sweep is None:
            return np.zeros((len(columns), 0))
        plain = self.restored(columns)
        numbers, points = np.unique(self.sweep, return_counts=True)
        long = numbers[points >= MIN_POINTS_PER_PARAMETER * plain.shape[2]]
        alone = [plain * (self.sweep == number)[:, None] for number in long]
        own = [self.white(one[:, :, k]) for one in alone for k in range(plain.shape[2])]
        return np.column_stack(own) if own else np.zeros((len(columns), 0))

    def shrunk(self, columns: np.ndarray, power: float) -> np.ndarray:
        """Columns (row * n,) or (row * n, k) in units of the noise and of the uncertainty of the clock's rate.

        Along t, the change of the rows with one standard deviation of the rate, the variance is s^2 + |t|^2, where the
        remainder of a model alone would make it s^2; the columns are scaled along t by the inverse root of their ratio,
        to a power. A model error that is larger than the clock's masks the clock, not the other way round.
        """
        if self.clock is None:
            return columns
        direction, length = self._clock_direction
        factor = (1.0 + length**2) ** (-0.5 * power) - 1.0
        return columns + factor * np.multiply.outer(direction, direction @ columns)

    @cached_property
    def _clock_direction(self) -> tuple[np.ndarray, float]:
        """Unit vector (row * n,) of the change with the clock's rate, and the change by one standard deviation of that.

        In units of the standard deviation of the remainder of a model along it.
        """
        change = np.zeros_like(self.measured) if self.clock is None else self.clock
        column = CLOCK_RATE_STD / math.sqrt(self.variance_along_clock) * self.whitened(change)
        length = float(np.linalg.norm(column))
        return column / max(length, 1e-300), length

    @property
    def clock_share(self) -> float:
        """Share of the variance along the change with the clock's rate that is due to the rate  [1]."""
        length = 0.0 if self.clock is None else self._clock_direction[1]
        return length**2 / (1.0 + length**2)

    def with_remainder(self, residual: np.ndarray) -> "Part":
        """Return the record with the variance of a model's residual (row * n,) along the change with its clock."""
        if self.clock is None or not residual.any():
            return self
        direction, _ = self._clock_direction
        rows = np.repeat(np.arange(len(self.rows)), self.time.size)
        return replace(self, variance_along_clock=variance_along(direction, residual, rows))

    def tangents(self, simulated: SimulatedRows) -> np.ndarray:
        """Change of the simulated rows with each nuisance, in units of the noise (row * n, k).

        The rate of the recorder's clock against that of the drive is one in every record of a steady tone: no periodic
        change resembles it. In other records it has the uncertainty of clocks (`clock`).
        """
        rows, channel = simulated.rows, [c for _, c in self.rows]
        columns = [*simulated.initial, *([clock_sensitivity(self.time, rows)] if self.period is not None else [])]
        if "trigger" in self.nuisance:
            columns.append(time_derivative(self.time, rows))
        if "offset" in self.nuisance:
            for index, name in enumerate(channel):
                if name == "displacement":
                    columns.append(_only(rows, index, 1.0))
        if "scale" in self.nuisance:
            for name in dict.fromkeys(channel):
                columns.append(rows * np.array([c == name for c in channel])[:, None])
        if "shear" in self.nuisance:
            sheared = np.zeros_like(rows)
            for index, (body, name) in enumerate(self.rows):
                if name == "displacement" and (body, "velocity") in self.rows:
                    sheared[index] = rows[self.rows.index((body, "velocity"))]
            columns.append(sheared)
        return np.column_stack([self.white(column) for column in columns]) if columns else np.zeros((rows.size, 0))

    def segments(self, least: int = MIN_SEGMENT_SAMPLES) -> np.ndarray:
        """Number (row * n,) of the segment of `least` samples or more that each residual belongs to.

        All rows of an instant share it.
        """
        n = self.time.size
        length = max(least, n // MIN_SEGMENTS)
        return np.tile(np.minimum(np.arange(n) // length, max(1, n // length) - 1), len(self.rows))


def _only(rows: np.ndarray, index: int, value: float) -> np.ndarray:
    """Rows (row, n) of zeros but for one, which has this value."""
    column = np.zeros_like(rows)
    column[index] = value
    return column
