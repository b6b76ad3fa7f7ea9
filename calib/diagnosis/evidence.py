"""What was measured beside what is simulated: residuals in units of the noise, free of what nuisances absorb."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.clock import CLOCK_RATE_STD, clock_sensitivity
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.noise import (
    LEAST_CYCLES,
    STATED,
    Noise,
    Remainder,
    Repeating,
    from_cycles,
    from_residual,
    shared,
    with_autoregression,
)
from calib.diagnosis.score import variance_along
from calib.objective import Objective, Reference, compared_rows, row_weights
from calib.objective.outliers import MIN_DEVIATION, deviations, smoothed
from calib.records.cycles import mean_cycle

MIN_SEGMENTS = 20  # of a record, whose scores are taken as independent
MAX_LEVEL_SHARE = 0.5  # levels over samples: fewer are steps of a converter
INITIAL_RANK_TOLERANCE = 1e-9  # singular value, over the largest, below which a direction of the initial state stays
MAX_LEVEL_ERROR = 1e-3  # distance of a level from whole steps that is rounding, over a step


@dataclass(frozen=True, eq=False)
class Part:
    """One record as a diagnosis looks at it.

    Attributes
    ----------
    name : of the record
    rows : (body, channel) pairs
    time : (n,)  [s]
    measured : (row, n), each in its unit
    period : of the excitation [s], None without one
    cycle : of the motion, in periods
    nuisance : names of what belongs to this measurement alone
    noise : of each row
    used : (row, n) whether a sample is compared: not what the excitation prescribes, and no outlier
    weight : (row, n) in [0, 1], 0 where a sample is not compared
    clock : (row, n) change of the rows with the rate of the clock, where that is uncertain and no nuisance
        [per unit rate]; None elsewhere
    variance_along_clock : variance of what a model leaves along that change, over the noise's  [1]
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

    @property
    def compared_noise(self) -> tuple[Noise, ...]:
        """Noise of the rows that are compared: of one that the excitation prescribes nothing is known."""
        return tuple(itertools.compress(self.noise, self.used.any(axis=1)))

    def white(self, rows: np.ndarray) -> np.ndarray:
        """Rows (row, n) in units of the noise, one after the other (row * n,)."""
        return self._shrunk(self._whitened(rows), 1.0)

    def _whitened(self, rows: np.ndarray) -> np.ndarray:
        parts = [noise.whitened(row, w) for noise, row, w in zip(self.noise, rows, self.weight, strict=True)]
        return np.concatenate(parts)

    def of_row(self, columns: np.ndarray, row: int) -> np.ndarray:
        """Whitened columns (row * n, k) of what changes one of the rows alone."""
        alone = np.repeat(np.arange(len(self.rows)) == row, self.time.size)
        return self._shrunk(alone[:, None] * self._shrunk(columns, -1.0), 1.0)

    def restored(self, columns: np.ndarray) -> np.ndarray:
        """Undo `white`: columns (row * n, k) to (row, n, k) in the units of the rows; 0 where nothing counts."""
        blocks = zip(self.noise, np.split(self._shrunk(columns, -1.0), len(self.rows)), self.weight, strict=True)
        return np.array([noise.coloured(block.T, weight).T for noise, block, weight in blocks])

    def _shrunk(self, columns: np.ndarray, power: float) -> np.ndarray:
        """Columns (row * n,) or (row * n, k) in units of the noise and of what the clock's rate adds to it.

        Along t, the change of the rows with one standard deviation of the rate, the variance is s^2 + |t|^2, where what
        a model leaves alone would make it s^2; times the inverse root of their ratio to a power. An error of the model
        that is larger than the clock's hides the clock, not the other way round.
        """
        if self.clock is None:
            return columns
        direction, length = self._clock_direction
        factor = (1.0 + length**2) ** (-0.5 * power) - 1.0
        return columns + factor * np.multiply.outer(direction, direction @ columns)

    @cached_property
    def _clock_direction(self) -> tuple[np.ndarray, float]:
        """Unit vector (row * n,) of what the clock's rate changes, and how much by a standard deviation of that.

        In units of the standard deviation that what a model leaves has along it.
        """
        column = CLOCK_RATE_STD / math.sqrt(self.variance_along_clock) * self._whitened(self.clock)
        length = float(np.linalg.norm(column))
        return column / max(length, 1e-300), length

    @property
    def clock_share(self) -> float:
        """Share of the variance along what the clock's rate changes that the rate makes  [1]."""
        length = 0.0 if self.clock is None else self._clock_direction[1]
        return length**2 / (1.0 + length**2)

    def with_remainder(self, residual: np.ndarray) -> "Part":
        """Return the record with the variance along its clock of what a model leaves: residual (row * n,)."""
        if self.clock is None or not residual.any():
            return self
        direction, _ = self._clock_direction
        rows = np.repeat(np.arange(len(self.rows)), self.time.size)
        return replace(self, variance_along_clock=variance_along(direction, residual, rows))

    def tangents(self, simulated: SimulatedRows) -> np.ndarray:
        """Change of the simulated rows with each nuisance, in units of the noise (row * n, k).

        The rate of the recorder's clock against that of the drive is one in every record of a steady tone: nothing
        that repeats looks like it. In other records it is as uncertain as clocks are (`clock`).
        """
        rows, channel = simulated.rows, [c for _, c in self.rows]
        columns = [*simulated.initial, *([clock_sensitivity(self.time, rows)] if self.period is not None else [])]
        if "trigger" in self.nuisance:
            columns.append(np.gradient(rows, self.time, axis=1))
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

    def segments(self) -> np.ndarray:
        """Number (row * n,) of the segment that each residual belongs to; all rows of an instant share it."""
        n = self.time.size
        length = max(8, n // MIN_SEGMENTS)
        return np.tile(np.minimum(np.arange(n) // length, max(1, n // length) - 1), len(self.rows))


def _only(rows: np.ndarray, index: int, value: float) -> np.ndarray:
    column = np.zeros_like(rows)
    column[index] = value
    return column


def looked_at(objective: Objective) -> dict[str, list[tuple[str, str]]]:
    """(body, channel) pairs of each reference that a diagnosis looks at."""
    return {name: compared_rows(reference, objective.terms) for name, reference in objective.references.items()}


@dataclass(frozen=True, eq=False)
class Evidence:
    """All records of a diagnosis."""

    parts: tuple[Part, ...]

    @property
    def names(self) -> list[str]:
        """Names of the records."""
        return [part.name for part in self.parts]

    def residual(self, simulated: Mapping[str, SimulatedRows]) -> np.ndarray:
        """Measured less simulated, in units of the noise (N,)."""
        return np.concatenate([part.white(part.measured - simulated[part.name].rows) for part in self.parts])

    def difference(self, one: Mapping[str, SimulatedRows], other: Mapping[str, SimulatedRows]) -> np.ndarray:
        """Simulation `other` less simulation `one`, in units of the noise (N,)."""
        return np.concatenate([part.white(other[part.name].rows - one[part.name].rows) for part in self.parts])

    def carried(self, columns: np.ndarray, other: "Evidence") -> np.ndarray:
        """Columns (N, k) in units of the noise of `other`, which weighs the same samples, in units of this noise."""
        blocks = []
        for part, old in zip(self.parts, other.parts, strict=True):
            plain = old.restored(columns[other.of(old.name)])
            whitened = np.column_stack([part._whitened(plain[:, :, k]) for k in range(columns.shape[1])])
            blocks.append(part._shrunk(whitened, 1.0))
        return np.concatenate(blocks)

    def tangents(self, simulated: Mapping[str, SimulatedRows]) -> np.ndarray:
        """Change of the simulations with each nuisance of each record, in units of the noise (N, k)."""
        blocks = [part.tangents(simulated[part.name]) for part in self.parts]
        whole = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
        row = column = 0
        for block in blocks:
            whole[row : row + len(block), column : column + block.shape[1]] = block
            row, column = row + len(block), column + block.shape[1]
        return whole

    def clock_changes(self) -> np.ndarray:
        """Change of the rows with the rate of each clock that is uncertain, in units of the noise (N, k)."""
        clocked = [part for part in self.parts if part.clock is not None]
        columns = np.zeros((sum(part.measured.size for part in self.parts), len(clocked)))
        for column, part in zip(columns.T, clocked, strict=True):
            column[self.of(part.name)] = part.white(part.clock)
        return columns

    def initial_moves(
        self, simulated: Mapping[str, SimulatedRows], residual: np.ndarray
    ) -> dict[str, dict[str, float]]:
        """Changes of initial states that are nuisances, by record, which fit a residual (N,) best, to first order."""
        changes = {}
        for part in self.parts:
            view = simulated[part.name]
            if view.start is None:
                continue
            tangents = part.tangents(view)
            scale = np.linalg.norm(tangents, axis=0)
            scale[scale == 0.0] = 1.0
            own = residual[self.of(part.name)]
            moves = np.linalg.lstsq(tangents / scale, own, rcond=INITIAL_RANK_TOLERANCE)[0] / scale
            changes[part.name] = dict(zip(view.start.state, moves.tolist(), strict=False))
        return changes

    def segments(self) -> np.ndarray:
        """Number (N,) of the segment that each residual belongs to."""
        numbers, first = [], 0
        for part in self.parts:
            own = part.segments()
            numbers.append(own + first)
            first += int(own.max()) + 1
        return np.concatenate(numbers)

    def rows(self) -> np.ndarray:
        """Number (N,) of the row, among those of all records, that each residual belongs to."""
        lengths = [part.time.size for part in self.parts for _ in part.rows]
        return np.repeat(np.arange(len(lengths)), lengths)

    def of_row(self, columns: np.ndarray, number: int) -> np.ndarray:
        """Columns (N, k) of what changes one row alone, that of this number among those of all records."""
        alone = np.zeros_like(columns)
        for part in self.parts:
            if 0 <= number < len(part.rows):
                alone[self.of(part.name)] = part.of_row(columns[self.of(part.name)], number)
            number -= len(part.rows)
        return alone

    def counted(self) -> float:
        """Number of residuals that count."""
        return float(sum((part.weight**2).sum() for part in self.parts))

    def of(self, name: str) -> slice:
        """Where the residuals of a record stand among all."""
        begin = 0
        for part in self.parts:
            if part.name == name:
                return slice(begin, begin + part.measured.size)
            begin += part.measured.size
        raise KeyError(name)

    def only(self, names: Sequence[str]) -> "Evidence":
        """Return some of the records."""
        return Evidence(tuple(part for part in self.parts if part.name in names))

    def with_weights(self, simulations: Sequence[Mapping[str, SimulatedRows]]) -> "Evidence":
        """Return the same evidence compared only where all these simulations are to be trusted."""
        parts = []
        for part in self.parts:
            trust = np.prod([views[part.name].trust for views in simulations], axis=0)
            parts.append(_weighted(part, trust))
        return Evidence(tuple(parts))

    def with_remainder(self, residual: np.ndarray) -> "Evidence":
        """Return the evidence with uncertain clocks beside what a model leaves (N,), which may hide them."""
        return Evidence(tuple(part.with_remainder(residual[self.of(part.name)]) for part in self.parts))

    def with_reestimated_noise(self, left: Mapping[str, Remainder]) -> "Evidence":
        """Return the evidence with the noise re-estimated of what does not repeat, by what is `left`."""
        parts = []
        for part in self.parts:
            rest, noises = left[part.name], list(part.noise)
            for index, known in enumerate(part.noise):
                if not known.repeated:
                    given = part.weight[index], part.measured[index], known.sigma if known.source == STATED else None
                    anew = from_residual(rest.rows[index], *given, rest.absorbed[index])
                    noises[index] = anew.within(rest.whole[index], part.weight[index])
            parts.append(replace(part, noise=tuple(noises)))
        return Evidence(tuple(parts))


def clocks_differ(one: Evidence, other: Evidence) -> bool:
    """Whether the uncertainty of a clock counts in one of two sets of the same records and not in the other."""
    shares = [abs(p.clock_share - q.clock_share) for p, q in zip(one.parts, other.parts, strict=True)]
    return max(shares, default=0.0) > CRITERIA.max_noise_change


def _weighted(part: Part, trust: np.ndarray) -> Part:
    return replace(part, weight=row_weights(part.rows, part.used, trust))


def gathered(
    references: Mapping[str, Reference],
    rows: Mapping[str, Sequence[tuple[str, str]]],
    cycle: Mapping[str, int],
    seen: Mapping[str, SimulatedRows],
    left: Mapping[str, Remainder] | None = None,
    outliers: Mapping[str, np.ndarray] | None = None,
    clocks: Mapping[str, np.ndarray] | None = None,
) -> Evidence:
    """Put measured records and their noise together.

    Parameters
    ----------
    references, rows : by record
    cycle : of each record's motion, in periods
    seen : simulations
    left : what no fit explains, by record: the noise of what does not repeat is judged by it; None: by what the
        simulations leave
    outliers : record -> (row, n) whether a sample is an outlier; None: none is
    clocks : as `clock_slopes` gives them; None: all clocks are right
    """
    measured = {name: _measured(reference, rows[name]) for name, reference in references.items()}
    good = {name: np.ones(m.shape, dtype=bool) if outliers is None else ~outliers[name] for name, m in measured.items()}
    mended = {name: _mended(measured[name], seen[name].rows, good[name]) for name in measured}
    used = {name: _used(seen[name], rows[name], good[name]) for name in measured}
    weights = {name: row_weights(rows[name], used[name], seen[name].trust) for name in measured}
    repeating = {
        name: _repeating(reference, rows[name], mended[name], seen[name].rows, weights[name], cycle[name])
        for name, reference in references.items()
    }
    shown = [Repeating(_step(references[name]), noise) for name, noise in repeating.items()]
    parts = []
    for name, reference in references.items():
        weight, time = weights[name], reference.record.time.values
        residual = mended[name] - seen[name].rows
        rest = Remainder(residual, residual, np.zeros((len(residual), 1, 1))) if left is None else left[name]
        noises = []
        for index, row in enumerate(rows[name]):
            noise = repeating[name].get(row)
            if noise is None:
                stated, ar = _stated(reference.record, row), shared(shown, row, _step(reference))
                known = weight[index], measured[name][index], stated
                if ar is not None:
                    noise = with_autoregression(ar, rest.scaled(index, weight[index], ar), *known)
                elif left is not None:
                    noise = from_residual(rest.rows[index], *known, rest.absorbed[index])
                else:  # before anything is fitted to it a residual shows no autocorrelation of the noise
                    noise = replace(with_autoregression(np.zeros(0), rest.rows[index], *known), repeated=False)
                noise = noise.within(rest.whole[index], weight[index])
            noises.append(noise)
        parts.append(
            Part(
                name=name,
                rows=tuple(rows[name]),
                time=time,
                measured=measured[name],
                period=reference.excitation.period,
                cycle=cycle[name],
                nuisance=tuple(reference.nuisance),
                noise=tuple(noises),
                used=used[name],
                weight=weight,
                clock=(clocks or {}).get(name),
            )
        )
    return Evidence(tuple(parts))


def _used(simulated: SimulatedRows, rows: Sequence[tuple[str, str]], good: np.ndarray) -> np.ndarray:
    """Whether samples (row, n) are compared: those that are good, of rows that the excitation does not prescribe."""
    return np.array([row not in simulated.given for row in rows], dtype=bool)[:, None] & good


def _mended(measured: np.ndarray, simulated: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Measured rows (row, n) with outliers replaced by what the samples about them say of the residual."""
    residual = measured - simulated
    return np.where(good, measured, simulated + smoothed(residual))


def outliers(part: Part, seen: SimulatedRows) -> np.ndarray:
    """Whether a sample (row, n) departs from those about it as no noise does.

    Its residual stands MIN_DEVIATION standard deviations beyond the median about it, theirs do not, and so it is with
    the measured channel itself: what the model lacks may leave spikes in the residual alone. What comes again in the
    cycles before and after is no outlier either, but belongs to the motion, such as an impact at another time.
    """
    far = part.weight == 1.0
    for rows in (part.measured, part.measured - seen.rows):
        distance, sigma = deviations(rows)
        far &= distance > MIN_DEVIATION * np.maximum(sigma, 1e-300)
    crowd = uniform_filter1d(far.astype(float), 3, axis=1) > 0.5  # a jump is no outlier
    return far & ~crowd & ~_recurring(part, rows - smoothed(rows))


def _recurring(part: Part, departure: np.ndarray) -> np.ndarray:
    """Whether departures (row, n) come again, of the same sign and half as large, in most cycles before and after.

    At the same phase, or a sample beside it. Two cycles on each side are looked at, as far as the record has them: in
    one cycle alone another outlier may be there by chance.
    """
    if part.period is None:
        return np.zeros(departure.shape, dtype=bool)
    highest, lowest = maximum_filter1d(departure, 3, axis=1), minimum_filter1d(departure, 3, axis=1)
    cycles, again = np.zeros(part.time.size), np.zeros(departure.shape)
    for number in (-2, -1, 1, 2):
        time = part.time + number * part.cycle * part.period
        there = np.searchsorted(0.5 * (part.time[1:] + part.time[:-1]), time)
        inside = (time >= part.time[0]) & (time <= part.time[-1])
        alike = np.where(departure > 0.0, highest[:, there], -lowest[:, there]) > 0.5 * np.abs(departure)
        cycles += inside
        again += inside & alike
    return (again >= 0.5 * cycles) & (cycles > 0)


def rounding(part: Part) -> np.ndarray:
    """Variance (row,) that a converter's steps make, over that of the row's noise; 0 where it shows none  [1].

    They show where the samples lie on few levels that are whole steps apart; theirs is a twelfth of the
    step squared (Widrow & Kollar, Quantization Noise, 2008, chapter 4).
    """
    shares = np.zeros(len(part.rows))
    for index, (row, noise, used) in enumerate(zip(part.measured, part.noise, part.used, strict=True)):
        levels = np.unique(row[used])
        if 1 < levels.size < MAX_LEVEL_SHARE * used.sum():
            step = np.median(np.diff(levels))
            steps = (levels - levels[0]) / step
            if np.abs(steps - np.round(steps)).max() < MAX_LEVEL_ERROR:
                shares[index] = step**2 / 12.0 / noise.sigma**2
    return shares


def _measured(reference: Reference, rows: Sequence[tuple[str, str]]) -> np.ndarray:
    record = reference.record
    bodies = [str(body) for body in record.body.values]
    return np.array([record[channel].values[bodies.index(body)] for body, channel in rows])


def _repeating(
    reference: Reference,
    rows: Sequence[tuple[str, str]],
    measured: np.ndarray,
    simulated: np.ndarray,
    weight: np.ndarray,
    cycle: int,
) -> dict[tuple[str, str], Noise]:
    """Noise of the rows (row, n) whose cycles show it: what the mean cycle of the residual leaves.

    What the model lacks repeats, and is in the mean cycle; or it changes slowly, and is no noise either.
    """
    residual = measured - simulated
    period, time = reference.excitation.period, reference.record.time.values
    if period is None or not rows or time[-1] - time[0] < LEAST_CYCLES * cycle * period:
        return {}
    mean = mean_cycle(time, residual, period, cycle, weight=weight)
    slow = [mean_cycle(time, change, period, cycle, weight=weight).residual for change in _slow(time, simulated)]
    compared = zip(rows, mean.residual, weight, measured, np.stack(slow, axis=2), strict=True)
    return {
        row: from_cycles(left, w, values, mean.parameters, _stated(reference.record, row), (own[:, :1], own))
        for row, left, w, values, own in compared
        if w.any()
    }


def _slow(time: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Changes (row, n) of a motion in proportion to time: of its phase, its frequency, its amplitude and its zero."""
    passed, clock = time - time[0], clock_sensitivity(time, rows)
    return [clock, passed * clock, passed * rows, np.broadcast_to(passed, rows.shape)]


def _step(reference: Reference) -> float:
    """Mean interval between the samples of a record  [s]."""
    time = reference.record.time.values
    return float((time[-1] - time[0]) / (time.size - 1))


def _stated(record, row: tuple[str, str]) -> float | None:
    body, channel = row
    if f"{channel}_sigma" not in record:
        return None
    index = [str(b) for b in record.body.values].index(body)
    return float(np.sqrt(np.mean(np.square(record[f"{channel}_sigma"].values[index]))))
