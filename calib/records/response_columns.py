"""The columns of a sheet that are a frequency response, and the response that they make."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.records.held_response import at_one_level
from calib.records.motion_unit import MOTIONS, MotionUnit, is_length, motion_quantity, motion_unit
from calib.records.phase_unit import doubtful_phase_unit
from calib.records.response import HELD, LEVEL_UNITS, check_response, complex_amplitude, make_response, sweeps
from calib.records.sheet import Sheet
from calib.records.sweep_numbers import numbered
from calib.units import to_si

AMPLITUDE, PHASE, IN_PHASE, QUADRATURE = "amplitude", "phase", "in-phase", "quadrature"
PAIRS = ((AMPLITUDE, PHASE), (IN_PHASE, QUADRATURE))  # of columns that are complex amplitudes
DIRECTIONS = {"up": 1.0, "1": 1.0, "+1": 1.0, "down": -1.0, "-1": -1.0}


@dataclass(frozen=True)
class UnitColumn:
    """A column of numbers with their unit.

    Attributes
    ----------
    column : name or position counted from 1
    scale : factor on the numbers, which times the unit is what was measured
    of : of a phase, the motion that it is the phase of; "" where that is the one of the amplitude
    """

    column: str | int
    unit: str
    scale: str | float = 1.0
    of: str = ""


@dataclass(frozen=True)
class StatedLevel:
    """Amplitude of the excitation where no column holds it, in SI."""

    amplitude: float
    unit: str


@dataclass(frozen=True)
class ResponseColumns:
    """Columns of a frequency response.

    Attributes
    ----------
    of_body : by body and what it is: amplitude and phase, or in-phase and quadrature
    level : amplitude of the excitation
    frequency_sigma : a column, or a quantity for all points
    sigma : of either part, by body: a column, or a quantity for all points
    sweep, direction : the columns that number the sweeps and say up or down
    higher, higher_sigma : by order from 2 on, as `of_body` and `sigma`; the phase of a harmonic of order k is the one
        before k times that of the excitation
    """

    frequency: UnitColumn
    of_body: Mapping[tuple[str, str], UnitColumn]
    level: UnitColumn | StatedLevel
    frequency_sigma: UnitColumn | str | float | None = None
    sigma: Mapping[str, UnitColumn | str | float] = field(default_factory=dict)
    sweep: str | int | None = None
    direction: str | int | None = None
    higher: Mapping[int, Mapping[tuple[str, str], UnitColumn]] = field(default_factory=dict)
    higher_sigma: Mapping[int, Mapping[str, UnitColumn | str | float]] = field(default_factory=dict)

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies, in the order of their columns."""
        return list(dict.fromkeys(body for body, _ in self.of_body))

    @property
    def named(self) -> list[str | int]:
        """All columns, each once."""
        amplitudes = [one for own in (self.of_body, *self.higher.values()) for one in own.values()]
        sigmas = [one for own in (self.sigma, *self.higher_sigma.values()) for one in own.values()]
        known = [self.frequency, *amplitudes, self.level, self.frequency_sigma, *sigmas]
        used = [one.column for one in known if isinstance(one, UnitColumn)]
        return list(dict.fromkeys([*used, *(c for c in (self.sweep, self.direction) if c is not None)]))


def response_of(sheet: Sheet, columns: ResponseColumns, rows: slice, **attrs: str) -> xr.Dataset:
    """Make a frequency response of the columns of a sheet.

    Amplitudes of a velocity V or an acceleration A become those of the displacement, X = V / (i w) and X = -A / w^2, at
    the frequency of each point; those over the excitation's amplitude are multiplied by it.

    Parameters
    ----------
    rows : of the sheet that are taken

    Raises
    ------
    CalibError : a column that is missing, a unit that does not fit, a cell that is no number, or no response; with the
        place in the file
    """
    return _Reading(sheet, columns, rows.start, rows.stop).response(attrs)


class _Reading:
    """A sheet whose columns are read."""

    def __init__(self, sheet: Sheet, columns: ResponseColumns, begin: int, end: int) -> None:
        self.sheet, self.columns, self.begin, self.end = sheet, columns, begin, end
        self.frequency = self._in(columns.frequency, "Hz")
        if not (self.frequency > 0.0).all():
            point = int(np.argmin(self.frequency > 0.0))
            raise CalibError(
                f"{sheet.path}, {self._place(point)}: frequency is expected above 0, got {self.frequency[point]:g} Hz"
            )
        self.omega = 2.0 * np.pi * self.frequency
        self.stated, self.excitation, self.level_unit = self._level()

    def response(self, attrs: Mapping[str, str]) -> xr.Dataset:
        """Response in SI, checked."""
        bodies, higher = self.columns.bodies, self.columns.higher
        sweep, direction = self._sweeps()
        own = self.columns.frequency_sigma
        sigmas = {order: self._sigma(bodies, order) for order in higher}
        record = make_response(
            self.frequency, bodies, self._harmonic(1), np.abs(self.excitation), self.level_unit, sweep, direction,
            sigma=self._sigma(bodies, 1), frequency_sigma=None if own is None else self._frequency_sigma(own),
            higher={order: self._harmonic(order) for order in sorted(higher)},
            higher_sigma={order: sigma for order, sigma in sigmas.items() if sigma is not None}, **attrs,
        )  # fmt: skip
        record = check_response(record, str(self.sheet.path))
        self._doubt_phases(record)
        return at_one_level(record, str(attrs[HELD])) if HELD in attrs else record

    def _numbers(self, column: str | int) -> np.ndarray:
        return self.sheet.numbers(column, self.begin, self.end)

    def _named(self, column: UnitColumn, error: CalibError) -> CalibError:
        return CalibError(f"{self.sheet.path}: column {column.column!r}: {error}")

    def _factor(self, column: UnitColumn, si: str) -> float:
        try:
            return to_si(f"({column.scale}) * (1 {column.unit})" if column.scale != 1.0 else f"1 {column.unit}", si)
        except CalibError as error:
            raise self._named(column, error) from error

    def _in(self, column: UnitColumn, si: str) -> np.ndarray:
        return self._factor(column, si) * self._numbers(column.column)

    def _motion(self, column: UnitColumn, per: tuple[str, ...] = ()) -> MotionUnit:
        try:
            return motion_unit(column.unit, column.scale, per)
        except CalibError as error:
            raise self._named(column, error) from error

    def _level(self) -> tuple[np.ndarray, np.ndarray, str]:
        """Level as stated (point,), complex amplitude of the excitation (point,) before which phases are, SI unit."""
        level = self.columns.level
        if isinstance(level, StatedLevel):
            stated = np.full(self.frequency.size, level.amplitude)
            return stated, stated.astype(complex), level.unit
        try:
            stated = self._in(level, "N")
        except CalibError:
            try:
                unit = motion_unit(level.unit, level.scale)
            except CalibError:
                raise self._named(
                    level,
                    CalibError(
                        "the level is the amplitude of the excitation: expected a unit of force or displacement, such "
                        f"as 'N' or 'mm', or of velocity or acceleration of a base, got {level.unit!r}"
                    ),
                ) from None
            stated = self._numbers(level.column)
            return stated, unit.displacement(stated, self.omega), LEVEL_UNITS[1]
        return stated, stated.astype(complex), LEVEL_UNITS[0]

    def _over(self, unit: MotionUnit, order: int) -> np.ndarray | float:
        """Complex level (point,) that values in a unit are over, before the phase that they are before; 1 of others."""
        return self.excitation * np.exp(1j * (order - 1) * np.angle(self.excitation)) if unit.level else 1.0

    def _scaled(self, column: UnitColumn, values: np.ndarray, order: int) -> tuple[np.ndarray, MotionUnit]:
        """Values of a harmonic in the unit of a column as displacement (point,), and that unit."""
        unit = self._motion(column, (self.level_unit,))
        if order > 1 and unit.level == LEVEL_UNITS[1] and not unit.rates and not is_length(column.unit.split("/")[0]):
            raise self._named(
                column,
                CalibError(
                    f"{column.unit!r} does not say whether harmonic {order} is a ratio of displacements or of "
                    "accelerations, which differ by the square of its order; state its amplitude itself, such as in mm "
                    "or m/s^2"
                ),
            )
        return unit.displacement(values, order * self.omega) * self._over(unit, order), unit

    def _harmonic(self, order: int) -> np.ndarray:
        """Complex amplitudes (body, point) of a harmonic of all bodies before the excitation  [m]."""
        columns = self.columns.of_body if order == 1 else self.columns.higher[order]
        bodies = self.columns.bodies
        unknown = [body for body, _ in columns if body not in bodies]
        if unknown:
            raise CalibError(
                f"{self.sheet.path}: harmonic {order} is of {unknown[0]!r}{nearest(unknown[0], bodies)}, which has no "
                f"first harmonic; name one of {', '.join(bodies)}, or add its {AMPLITUDE} and {PHASE}"
            )
        given = {body for body, _ in columns}
        lacking = ", ".join(body for body in bodies if body not in given)
        if lacking:
            raise CalibError(
                f"{self.sheet.path}: harmonic {order} is given of {', '.join(sorted(given))}, not of {lacking}; give "
                "it of all bodies or of none"
            )
        amplitudes = np.array([self._amplitude(body, columns, order) for body in bodies])
        return np.asarray(amplitudes * np.exp(-1j * order * np.angle(self.excitation)))

    def _amplitude(self, body: str, columns: Mapping[tuple[str, str], UnitColumn], order: int) -> np.ndarray:
        """Complex amplitude (point,) of a harmonic of the displacement of a body  [m]."""
        own = {what: column for (its, what), column in columns.items() if its == body}
        for first, second in PAIRS:
            if set(own) != {first, second}:
                continue
            if first == AMPLITUDE:
                return self._polar(own[first], own[second], order)
            parts = [self._scaled(own[what], self._numbers(own[what].column), order) for what in (first, second)]
            if len({(unit.rates, unit.level) for _, unit in parts}) > 1:
                raise self._named(
                    own[second],
                    CalibError(f"{second} is in {own[second].unit!r}, but {first} in {own[first].unit!r}; mend one"),
                )
            return np.asarray(parts[0][0] + 1j * parts[1][0])
        of = f"harmonic {order} of " if order > 1 else ""
        raise CalibError(
            f"{self.sheet.path}: of {of}body {body!r} there are the columns {sorted(own)}; expected {AMPLITUDE} and "
            f"{PHASE}, or {IN_PHASE} and {QUADRATURE}"
        )

    def _polar(self, amplitude: UnitColumn, phase: UnitColumn, order: int) -> np.ndarray:
        numbers = self._numbers(amplitude.column)
        if (numbers < 0.0).any():
            point = int(np.argmax(numbers < 0.0))
            raise CalibError(
                f"{self.sheet.path}, {self._place(point)}: an amplitude is expected at or above 0, got "
                f"{numbers[point]:g} {amplitude.unit} in column {amplitude.column!r}; are amplitude and phase "
                "exchanged? Parts with a sign are in-phase and quadrature"
            )
        values, unit = self._scaled(amplitude, numbers, order)
        turn = np.exp(1j * self._in(phase, "rad"))
        if not phase.of:
            return np.asarray(values * turn)
        if phase.of not in MOTIONS:
            raise self._named(
                phase,
                CalibError(f"of is one of {', '.join(MOTIONS)}, got {phase.of!r}{nearest(phase.of, MOTIONS)}"),
            )
        return np.asarray(values * turn * 1j ** (unit.rates - list(MOTIONS).index(phase.of)))

    def _doubt_phases(self, record: xr.Dataset) -> None:
        """Warn of bodies whose phases may be in another unit than their column states."""
        own = [points for _, points in sweeps(record)]
        receptances = np.abs(complex_amplitude(record)) / record["level"].values
        for body, receptance in zip(self.columns.bodies, receptances, strict=True):
            phase = self.columns.of_body.get((body, PHASE))
            if phase is None:
                continue
            factor = self._factor(phase, "rad")
            doubt = doubtful_phase_unit(factor * self._numbers(phase.column), abs(factor), receptance, own)
            if doubt is not None:
                warnings.warn(f"{self.sheet.path.name}: phase of {body}: {doubt}", stacklevel=2)

    def _sigma(self, bodies: Sequence[str], order: int) -> np.ndarray | None:
        """Standard uncertainty (body, point) of either part of a harmonic  [m]; None where none is stated.

        Where only the first harmonic's is stated it is that one, in its own unit: a sensor's noise is the same at any
        order in what it measures, a displacement, a velocity or an acceleration.
        """
        own = {} if order == 1 else self.columns.higher_sigma.get(order, {})
        stated = own or self.columns.sigma
        if not stated:
            return None
        lacking = [body for body in bodies if body not in stated]
        if lacking:
            of = f" of harmonic {order}" if order > 1 else ""
            raise CalibError(
                f"{self.sheet.path}: {lacking[0]!r} has no sigma{of}, which another body has; give it to all or to none"
            )
        columns = self.columns.higher[order] if own else self.columns.of_body
        return np.array([self._sigma_of(body, stated[body], columns, order) for body in bodies])

    def _sigma_of(
        self, body: str, sigma: UnitColumn | str | float, columns: Mapping[tuple[str, str], UnitColumn], order: int
    ) -> np.ndarray:
        """Standard uncertainty (point,) of a harmonic [m]; a number is in the unit of that body's column."""
        if isinstance(sigma, UnitColumn):
            return np.abs(self._scaled(sigma, self._numbers(sigma.column), order)[0])
        first = next(column for (its, _), column in columns.items() if its == body)
        try:
            unit = motion_quantity(sigma, (self.level_unit,)) if isinstance(sigma, str) else self._motion(
                first, (self.level_unit,))._replace(factor=sigma)  # fmt: skip
        except CalibError as error:
            raise self._named(first, CalibError(f"sigma: {error}")) from error
        return np.abs(unit.displacement(np.ones(self.frequency.size), order * self.omega) * self._over(unit, order))

    def _frequency_sigma(self, sigma: UnitColumn | str | float) -> np.ndarray:
        if isinstance(sigma, UnitColumn):
            return self._in(sigma, "Hz")
        return np.full(self.frequency.size, to_si(sigma, "Hz"))

    def _sweeps(self) -> tuple[np.ndarray, np.ndarray]:
        """Number of the sweep (point,) and direction (point,)."""
        stated = None if self.columns.direction is None else self._directions(self.columns.direction)
        number = self._numbered(stated) if self.columns.sweep is None else self._numbers(self.columns.sweep)
        if stated is not None:
            return number, stated
        direction = np.empty(self.frequency.size)
        for one in np.unique(number):
            points = np.flatnonzero(number == one)
            steps = np.diff(self.frequency[points])
            if (steps > 0.0).any() and (steps < 0.0).any():
                raise CalibError(
                    f"{self.sheet.path}: the frequencies of the sweep from {self._place(int(points[0]))} on rise and "
                    "fall; state a column 'direction' (up or down), or 'sweep', which numbers the sweeps"
                )
            direction[points] = -1.0 if (steps < 0.0).any() else 1.0
        return number, direction

    def _numbered(self, direction: np.ndarray | None) -> np.ndarray:
        number = numbered(self.frequency, self.stated, direction)
        if number is None:
            raise CalibError(
                f"{self.sheet.path}: frequencies and levels of the rows leave it open which of them are one sweep; "
                "state a column 'sweep', which numbers the sweeps"
            )
        return number

    def _directions(self, column: str | int) -> np.ndarray:
        words = [str(cell).strip().lower() for cell in self.sheet.find(column)[self.begin : self.end]]
        for point, word in enumerate(words):
            if word not in DIRECTIONS:
                raise CalibError(
                    f"{self.sheet.path}, {self._place(point)}: expected a direction 'up' or 'down', got {word!r}"
                )
        return np.array([DIRECTIONS[word] for word in words])

    def _place(self, point: int) -> str:
        """Where a point stands in the file."""
        lines = self.sheet.lines
        return f"line {lines[self.begin + point]}" if lines else f"sample {self.begin + point}"
