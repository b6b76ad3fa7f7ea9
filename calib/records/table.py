"""A measured table (delimited text, JSON or MATLAB) as a record."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from calib import records
from calib.errors import CalibError, nearest
from calib.execution.files import verified
from calib.records.delimited import TextLayout
from calib.records.excitation import UNITS as EXCITATION_UNITS
from calib.records.excitation import Excitation, Quantity
from calib.records.filter import low_pass
from calib.records.motion_unit import MOTIONS, with_gravity
from calib.records.sheet import Sheet, end_of_rows
from calib.records.sheet_file import read_sheet
from calib.units import coherent, in_si, is_si, to_si

CHANNEL_UNITS = {**records.CHANNELS, **MOTIONS}  # SI units of the channels whose columns may have others


@dataclass(frozen=True)
class TimeColumn:
    """The column that is time; `column` is a name (see `Table.path`) or a position counted from 1."""

    column: str | int
    unit: str = "s"


@dataclass(frozen=True)
class Channel:
    """A column that is a channel of a body.

    `unit` is the column's, `scale` a factor (number, or quantity such as ``"1 m/V"``): unit times scale must have the
    unit of the channel (`CHANNEL_UNITS`; others keep the column's SI unit). "g" of an acceleration is gravity's.
    `sigma` is the standard uncertainty, a number or quantity of the channel's unit.
    """

    column: str | int
    body: str
    channel: str
    unit: str
    scale: str | float = 1.0
    sigma: str | float | None = None


@dataclass(frozen=True)
class ExcitationColumn:
    """A column that is the recorded excitation; `cutoff` [Hz] as in `calib.records.excitation.Excitation`."""

    column: str | int
    place: str
    quantity: Quantity
    unit: str
    scale: str | float = 1.0
    cutoff: float | None = None

    def __post_init__(self) -> None:
        if self.quantity not in EXCITATION_UNITS or self.quantity == "free decay":
            known = sorted(set(EXCITATION_UNITS) - {"free decay"})
            raise CalibError(
                f"the quantity of a recorded excitation is one of {known}, "
                f"got {self.quantity!r}{nearest(self.quantity, known)}"
            )


@dataclass(frozen=True)
class Table:
    """File, columns and samples of which a record is made.

    Attributes
    ----------
    path : a MATLAB file (.mat), a JSON file (.json) that is a list of rows or holds one, or delimited text (comma,
        semicolon, tab or blanks; with or without a header line). A column's name is that of the header or, in a MATLAB
        file and in MATLAB's own notation, that of a vector, alone, in a cell array or in a structure, or of a column of
        a matrix: ``"x"``, ``"x{3,2}"``, ``"s(2).x"``, ``"x(:,2)"``
    channels : the columns that are measured channels
    drive : the column that is the excitation, if any
    time, rate : the column that is time, or the sampling rate [Hz]: one of the two
    first, last : sample counted from 0 that is kept first, and the one before which the record ends (None: all)
    margin : samples beyond either end that the excitation and the low-pass see, as far as the file has them; there a
        simulation can settle and a filter can leave its edge effects
    cutoff : zero-phase low-pass of every channel [Hz]
    decimate : keep every so many-th sample of the channels; the excitation keeps all of its samples
    text : layout of delimited text
    sha256 : of the file, checked before it is read
    origin : where a user gets the file; named in the message where it is missing
    """

    path: Path
    channels: Sequence[Channel]
    drive: ExcitationColumn | None = None
    time: TimeColumn | None = None
    rate: float | None = None
    first: int = 0
    last: int | None = None
    margin: int = 0
    cutoff: float | None = None
    decimate: int = 1
    text: TextLayout = TextLayout()
    sha256: str | None = None
    origin: str = ""

    def __post_init__(self) -> None:
        clock = self.clock
        if not isinstance(clock, TimeColumn) and not clock > 0.0:
            raise CalibError(f"{self.path}: the sampling rate must be positive [Hz], got {clock}")
        if not self.channels:
            raise CalibError(f"{self.path}: a table needs at least one channel")
        if self.first < 0 or self.margin < 0 or self.decimate < 1:
            raise CalibError(
                f"{self.path}: first and margin count samples from 0 and decimate from 1; "
                f"got first = {self.first}, margin = {self.margin}, decimate = {self.decimate}"
            )

    @property
    def clock(self) -> TimeColumn | float:
        """The column that is time, or the sampling rate [Hz]."""
        if self.time is not None and self.rate is None:
            return self.time
        if self.rate is not None and self.time is None:
            return self.rate
        raise CalibError(f"{self.path}: a table needs either a time column or a sampling rate [Hz], one of the two")


def read(table: Table) -> tuple[xr.Dataset, Excitation | None]:
    """Read a table as a record in SI and, where a column holds it, the excitation.

    Returns
    -------
    record : its time starts at 0 at sample `first`; carries the excitation on its own times too
    excitation : every sample from `margin` before the first to `margin` after the last, on the record's clock

    Raises
    ------
    CalibError : missing file or wrong checksum, unknown column, a cell that is no number (with its line), ragged rows,
        a unit that does not fit, samples that the file does not have
    """
    checksum = verified(table.path, table.sha256, table.origin)
    samples = _samples(table, table.path.read_bytes())
    time = _time(table, samples)
    selected = np.arange(table.first, samples.last, table.decimate) - samples.begin
    bodies = list(dict.fromkeys(c.body for c in table.channels))
    with _naming(table.path):
        units = {c.channel: si_unit(c) for c in table.channels}

    channels = _channels(table, samples, time, bodies, units)
    record = records.make(
        time[selected],
        bodies,
        {name: rows[:, selected] for name, rows in channels.items()} | _sigmas(table, bodies),
        units,
        source=f"{table.path.name}, samples {table.first} to {samples.last}, sha256 {checksum}",
    )
    if table.drive is None:
        return records.check(record, str(table.path)), None
    value = _si(table.drive, samples)
    excitation = _excitation(table.drive, time, value)
    record["excitation"] = ("time", value[selected], {"units": excitation.unit})
    record.attrs |= {"place": excitation.place, "quantity": excitation.quantity}
    if excitation.cutoff is not None:
        record.attrs["cutoff"] = excitation.cutoff
    if excitation.quantity == "displacement" and excitation.place in bodies:
        record.attrs["prescribed"] = records.prescription([excitation.place])
    return records.check(record, str(table.path)), excitation


@dataclass(frozen=True)
class _Samples:
    """The samples of a sheet that are read: `begin` to `end`; the record ends at `last`."""

    sheet: Sheet
    begin: int
    last: int
    end: int

    def numbers(self, column: str | int) -> np.ndarray:
        """Numbers (end - begin,) of a column."""
        return self.sheet.numbers(column, self.begin, self.end)


def _samples(table: Table, content: bytes) -> _Samples:
    """Return the file's columns, cut to the samples that are asked for and their margin."""
    sheet = read_sheet(table.path, content, table.text)
    used = [c.column for c in (*table.channels, table.time, table.drive) if c is not None]
    sizes = {column: len(sheet.find(column)) for column in used}
    if len(set(sizes.values())) > 1:
        raise CalibError(f"{table.path}: the columns used must have one length, got {sizes}")
    size = sizes[used[0]]
    last = end_of_rows(table.path, table.first, table.last, size, "samples")
    return _Samples(sheet, begin=max(0, table.first - table.margin), last=last, end=min(size, last + table.margin))


def _time(table: Table, samples: _Samples) -> np.ndarray:
    """Time (end - begin,) [s], 0 at the first sample of the record."""
    clock = table.clock
    if not isinstance(clock, TimeColumn):
        return (np.arange(samples.begin, samples.end) - table.first) / clock
    time = samples.numbers(clock.column) * to_si(f"1 {clock.unit}", "s")
    return time - time[table.first - samples.begin]


def si_unit(column: Channel | ExcitationColumn) -> str:
    """SI unit in which a record holds the column.

    Raises
    ------
    CalibError : a channel that is none of the usual ones, in a unit with a factor
    """
    if isinstance(column, ExcitationColumn):
        return EXCITATION_UNITS[column.quantity]
    unit = CHANNEL_UNITS.get(column.channel, column.unit)
    if not is_si(unit):
        raise CalibError(
            f"column {column.column!r}: {column.channel!r} is none of {sorted(CHANNEL_UNITS)}, so its unit is kept and "
            f"must be one of SI without a factor, got {unit!r}; {_in_coherent_unit(unit, column.scale)}"
        )
    return unit


def _in_coherent_unit(unit: str, scale: str | float) -> str:
    """Advise the unit and the scale by which a channel in a unit with a factor is stated."""
    si = coherent(unit)
    if isinstance(scale, str):
        return f"write unit = {json.dumps(si)} and, as scale, the number by which the column is multiplied to be in it"
    return f"write unit = {json.dumps(si)}, scale = {scale * in_si(unit, si):.9g}"


def si_factor(column: Channel | ExcitationColumn) -> float:
    """Factor from the numbers of the column to SI.

    Raises
    ------
    CalibError : its unit is none of the channel or of the excitation's quantity
    """
    unit = si_unit(column)
    try:
        return _to_si(f"1 {column.unit}" if column.scale == 1.0 else f"({column.scale}) * (1 {column.unit})", unit)
    except CalibError as error:
        raise CalibError(f"column {column.column!r}: unit times scale must be in {unit!r}: {error}") from error


def si_sigma(column: Channel) -> float | None:
    """Standard uncertainty of a channel in SI; None where none is stated."""
    return None if column.sigma is None else _to_si(column.sigma, si_unit(column))


def _to_si(quantity: str | float, unit: str) -> float:
    """Value of a quantity in the SI unit of a channel; "g" of an acceleration is that of gravity."""
    if unit == MOTIONS["acceleration"] and isinstance(quantity, str):
        quantity = with_gravity(quantity)
    return to_si(quantity, unit)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file before the message of a refusal that does not name it."""
    try:
        yield
    except CalibError as error:
        raise CalibError(f"{path}, {error}") from error


def _si(column: Channel | ExcitationColumn, samples: _Samples) -> np.ndarray:
    """Numbers (end - begin,) of the column in SI."""
    with _naming(samples.sheet.path):
        factor = si_factor(column)
    return factor * samples.numbers(column.column)


def _channels(
    table: Table, samples: _Samples, time: np.ndarray, bodies: Sequence[str], units: Mapping[str, str]
) -> dict[str, np.ndarray]:
    """Return each channel (body, end - begin) in SI, low-passed."""
    columns = {}
    for c in table.channels:
        if (c.channel, c.body) in columns:
            raise CalibError(f"{table.path}: two columns are {c.channel} of body {c.body!r}; keep one")
        columns[c.channel, c.body] = _si(c, samples)
    rows = {name: _rows(table.path, name, columns, bodies) for name in units}
    return rows if table.cutoff is None else {name: low_pass(x, time, table.cutoff) for name, x in rows.items()}


def _sigmas(table: Table, bodies: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the standard uncertainty (body,) of each channel that states one."""
    stated = {(f"{c.channel}_sigma", c.body): sigma for c in table.channels if (sigma := si_sigma(c)) is not None}
    return {name: _rows(table.path, name, stated, bodies) for name in dict.fromkeys(name for name, _ in stated)}


def _rows(
    path: Path, name: str, given: Mapping[tuple[str, str], np.ndarray | float], bodies: Sequence[str]
) -> np.ndarray:
    """Return what is `given` by name and body as one array (body, ...)."""
    missing = [body for body in bodies if (name, body) not in given]
    if missing:
        raise CalibError(f"{path}: {name} is given for some bodies, but not for {missing}; give it for all or none")
    return np.array([given[name, body] for body in bodies])


def _excitation(drive: ExcitationColumn, time: np.ndarray, value: np.ndarray) -> Excitation:
    unit = EXCITATION_UNITS[drive.quantity]
    return Excitation(drive.place, drive.quantity, unit, time=time, value=value, cutoff=drive.cutoff)
