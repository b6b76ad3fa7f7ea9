"""A measured table (delimited text, JSON or MATLAB v5) as a record."""

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from calib import records
from calib.errors import CalibError, nearest
from calib.execution.files import verified
from calib.records.excitation import UNITS as EXCITATION_UNITS
from calib.records.excitation import Excitation, Quantity
from calib.records.filter import low_pass
from calib.units import is_si, to_si


class UnknownColumn(CalibError):
    """A column that the file does not have."""

    def __init__(self, column: str | int, message: str):
        super().__init__(message)
        self.column = column


@dataclass(frozen=True)
class TimeColumn:
    """The column that is time; `column` is a name (see `Table.path`) or a position counted from 1."""

    column: str | int
    unit: str = "s"


@dataclass(frozen=True)
class Channel:
    """A column that is a channel of a body.

    `unit` is the column's, `scale` a factor (number, or quantity such as ``"1 m/V"``): unit times scale must have the
    unit of the channel (`calib.records.record.CHANNELS`; other channels keep the column's SI unit).
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
    path : a MATLAB v5 file (.mat), a JSON file (.json) that is a list of rows or holds one, or delimited text (comma,
        semicolon, tab or blanks; with or without a header line). A column's name is that of the header or, in a MATLAB
        file, that of a vector or, in MATLAB's own notation, of a vector in a cell array: ``"x"``, ``"x{3,2}"``
    channels : the columns that are measured channels
    drive : the column that is the excitation, if any
    time, rate : the column that is time, or the sampling rate [Hz]: one of the two
    first, last : sample counted from 0 that is kept first, and the one before which the record ends (None: all)
    margin : samples beyond either end that the excitation and the low-pass see, as far as the file has them; there a
        simulation can settle and a filter can leave its edge effects
    cutoff : zero-phase low-pass of every channel [Hz]
    decimate : keep every so many-th sample of the channels; the excitation keeps all of its samples
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
    sheet = _sheet(table, table.path.read_bytes())
    time = _time(table, sheet)
    selected = np.arange(table.first, sheet.last, table.decimate) - sheet.begin
    bodies = list(dict.fromkeys(c.body for c in table.channels))
    with _naming(table.path):
        units = {c.channel: si_unit(c) for c in table.channels}

    channels = _channels(table, sheet, time, bodies, units)
    record = records.make(
        time[selected],
        bodies,
        {name: rows[:, selected] for name, rows in channels.items()} | _sigmas(table, bodies, units),
        units,
        source=f"{table.path.name}, samples {table.first} to {sheet.last}, sha256 {checksum}",
    )
    if table.drive is None:
        return records.check(record, str(table.path)), None
    value = _si(table.drive, sheet)
    excitation = _excitation(table.drive, time, value)
    record["excitation"] = ("time", value[selected], {"units": excitation.unit})
    record.attrs |= {"place": excitation.place, "quantity": excitation.quantity}
    if excitation.cutoff is not None:
        record.attrs["cutoff"] = excitation.cutoff
    if excitation.quantity == "displacement" and excitation.place in bodies:
        record.attrs["prescribed"] = records.prescription([excitation.place])
    return records.check(record, str(table.path)), excitation


Cells = Sequence[Any] | np.ndarray  # of a column, not yet known to be numbers


@dataclass(frozen=True)
class _Sheet:
    """The columns of a file and the samples that are read: `begin` to `end`; the record ends at `last`."""

    path: Path
    columns: Mapping[str | int, Cells]
    lines: Sequence[int] | None  # line number of each sample, of a text
    unfit: Mapping[str | int, str] = field(default_factory=dict)  # what else the file names, and what that is
    begin: int = 0
    last: int = 0
    end: int = 0

    def find(self, column: str | int) -> Cells:
        """Cells of a column."""
        if column in self.columns:
            return self.columns[column]
        if column in self.unfit:
            raise CalibError(f"{self.path}: column {column!r} is {self.unfit[column]}")
        names = [c for c in self.columns if isinstance(c, str)]
        size = sum(isinstance(c, int) for c in self.columns)
        known = f"the columns are {names}" if names else f"the file has no header, only columns 1 to {size}"
        if names and isinstance(column, int):
            known = f"the table has {size} columns: {names}" if size else f"its columns have names: {names}"
        raise UnknownColumn(
            column, f"{self.path}: there is no single column {column!r}{nearest(str(column), names)}; {known}"
        )

    def numbers(self, column: str | int) -> np.ndarray:
        """Numbers (end - begin,) of a column."""
        cells = self.find(column)[self.begin : self.end]
        values = np.array([float(c) if _is_number(c) else np.nan for c in cells])
        bad = ~np.isfinite(values)
        if bad.any():
            at = int(np.argmax(bad))
            where = f"line {self.lines[self.begin + at]}" if self.lines else f"sample {self.begin + at}"
            raise CalibError(f"{self.path}, {where}: expected a number in column {column!r}, got {cells[at]!r}")
        return values


def _sheet(table: Table, content: bytes) -> _Sheet:
    """Return the file's columns, cut to the samples that are asked for and their margin."""
    sheet = {".mat": _matlab, ".json": _json}.get(table.path.suffix.lower(), _text)(table.path, content)
    used = [c.column for c in (*table.channels, table.time, table.drive) if c is not None]
    sizes = {column: len(sheet.find(column)) for column in used}
    if len(set(sizes.values())) > 1:
        raise CalibError(f"{table.path}: the columns used must have one length, got {sizes}")
    size = sizes[used[0]]
    last = size if table.last is None else table.last
    if not table.first < last <= size:
        raise CalibError(f"{table.path}: samples {table.first} to {last} were asked for, but the file has {size}")
    return replace(sheet, begin=max(0, table.first - table.margin), last=last, end=min(size, last + table.margin))


def _text(path: Path, content: bytes) -> _Sheet:
    """Columns of a delimited text, by position from 1 and by name where a header gives it to one column only."""
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise CalibError(f"{path}: not a text file in UTF-8 ({error}); a MATLAB file needs the suffix .mat") from error
    numbered = [(i, line.strip(" ")) for i, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not numbered:
        raise CalibError(f"{path}: the file holds no rows")
    delimiter = next((d for d in ";\t," if d in numbered[0][1]), " ")
    rows = list(csv.reader((line for _, line in numbered), delimiter=delimiter, skipinitialspace=True))
    numbers = [i for i, _ in numbered]
    if len(rows) != len(numbers):
        raise CalibError(f"{path}: a quotation mark is not closed in its line; mend it")
    for i, row in zip(numbers, rows, strict=True):
        if len(row) != len(rows[0]):
            raise CalibError(f"{path}, line {i}: expected {len(rows[0])} cells as in line {numbers[0]}, got {len(row)}")
    names = [cell.strip() for cell in rows[0]]
    header = any(name and not _is_number(name) for name in names)
    columns: dict[str | int, Cells] = dict(enumerate(zip(*rows[header:], strict=True), 1))
    if header and columns:
        columns |= {name: columns[i] for i, name in enumerate(names, 1) if name and names.count(name) == 1}
    return _Sheet(path, columns, numbers[header:])


def _is_number(cell: Any) -> bool:
    try:
        float(cell)
    except (ValueError, TypeError):
        return False
    return True


def _json(path: Path, content: bytes) -> _Sheet:
    """Columns, by position from 1, of a JSON list of rows, alone or as the only such member of an object."""
    try:
        document = json.loads(content)
    except ValueError as error:
        raise CalibError(f"{path}: not a readable JSON file ({error})") from error
    members = list(document.values()) if isinstance(document, dict) else [document]
    tables = [m for m in members if isinstance(m, list) and m and all(isinstance(row, list) for row in m)]
    if len(tables) != 1:
        raise CalibError(f"{path}: expected one list of rows, found {len(tables)}; keep one")
    rows = tables[0]
    for i, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise CalibError(f"{path}, sample {i}: expected {len(rows[0])} cells as in sample 0, got {len(row)}")
    return _Sheet(path, dict(enumerate(zip(*rows, strict=True), 1)), None)


def _matlab(path: Path, content: bytes) -> _Sheet:
    """Return the vectors of numbers of a MATLAB v5 file by name, those in a cell array by the name of their cell."""
    try:
        variables = loadmat(io.BytesIO(content))
    except NotImplementedError as error:
        raise CalibError(f"{path}: MATLAB 7.3 files are not read; save it with `save -v7`") from error
    except (MatReadError, ValueError, TypeError, OSError) as error:
        raise CalibError(f"{path}: not a readable MATLAB v5 file ({error})") from error
    arrays = {name: value for name, value in variables.items() if isinstance(value, np.ndarray)}
    arrays |= {name: cell for key, value in arrays.items() for name, cell in _cells(key, value).items()}
    columns = {name: value.ravel() for name, value in arrays.items() if _is_vector(value)}
    return _Sheet(path, columns, None, unfit={n: _described(n, v) for n, v in arrays.items() if n not in columns})


def _cells(name: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays in a cell array by the names that MATLAB gives them, ``"x{3,2}"``; none of another array."""
    if array.dtype.kind != "O":
        return {}
    indices = (",".join(str(i + 1) for i in index) for index in np.ndindex(array.shape))
    pairs = zip(indices, array.flat, strict=True)
    return {f"{name}{{{index}}}": cell for index, cell in pairs if isinstance(cell, np.ndarray)}


def _is_vector(array: np.ndarray) -> bool:
    """Whether an array is a row or a column of numbers."""
    return array.dtype.kind in "buif" and sorted(array.shape)[:-1] == [1] * (array.ndim - 1) and array.size > 1


def _described(name: str, array: np.ndarray) -> str:
    """Describe an array that is not a column."""
    shape = " x ".join(map(str, array.shape))
    if array.dtype.kind == "O":
        return f"a cell array of {shape}; name one of its cells, such as '{name}{{1,1}}'"
    kind = "numbers" if array.dtype.kind in "buif" else "text" if array.dtype.kind in "US" else "no numbers"
    return f"an array of {shape}, {kind}; a column is one row or one column of numbers"


def _time(table: Table, sheet: _Sheet) -> np.ndarray:
    """Time (end - begin,) [s], 0 at the first sample of the record."""
    clock = table.clock
    if not isinstance(clock, TimeColumn):
        return (np.arange(sheet.begin, sheet.end) - table.first) / clock
    time = sheet.numbers(clock.column) * to_si(f"1 {clock.unit}", "s")
    return time - time[table.first - sheet.begin]


def si_unit(column: Channel | ExcitationColumn) -> str:
    """SI unit in which a record holds the column.

    Raises
    ------
    CalibError : a channel that is none of the usual ones, in a unit with a factor
    """
    if isinstance(column, ExcitationColumn):
        return EXCITATION_UNITS[column.quantity]
    unit = records.CHANNELS.get(column.channel, column.unit)
    if not is_si(unit):
        raise CalibError(
            f"column {column.column!r}: {column.channel!r} is none of {sorted(records.CHANNELS)}, so its "
            f"unit is kept and must be one of SI without a factor, got {unit!r}; put the factor into scale"
        )
    return unit


def si_factor(column: Channel | ExcitationColumn) -> float:
    """Factor from the numbers of the column to SI.

    Raises
    ------
    CalibError : its unit is none of the channel or of the excitation's quantity
    """
    unit = si_unit(column)
    try:
        return to_si(
            f"1 {column.unit}" if column.scale == 1.0 else f"({column.scale}) * (1 {column.unit})",
            unit,
        )
    except CalibError as error:
        raise CalibError(f"column {column.column!r}: unit times scale must be in {unit!r}: {error}") from error


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file before the message of a refusal that does not name it."""
    try:
        yield
    except CalibError as error:
        raise CalibError(f"{path}, {error}") from error


def _si(column: Channel | ExcitationColumn, sheet: _Sheet) -> np.ndarray:
    """Numbers (end - begin,) of the column in SI."""
    with _naming(sheet.path):
        factor = si_factor(column)
    return factor * sheet.numbers(column.column)


def _channels(
    table: Table, sheet: _Sheet, time: np.ndarray, bodies: Sequence[str], units: Mapping[str, str]
) -> dict[str, np.ndarray]:
    """Return each channel (body, end - begin) in SI, low-passed."""
    columns = {}
    for c in table.channels:
        if (c.channel, c.body) in columns:
            raise CalibError(f"{table.path}: two columns are {c.channel} of body {c.body!r}; keep one")
        columns[c.channel, c.body] = _si(c, sheet)
    rows = {name: _rows(table.path, name, columns, bodies) for name in units}
    return rows if table.cutoff is None else {name: low_pass(x, time, table.cutoff) for name, x in rows.items()}


def _sigmas(table: Table, bodies: Sequence[str], units: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Return the standard uncertainty (body,) of each channel that states one."""
    stated = {
        (f"{c.channel}_sigma", c.body): to_si(c.sigma, units[c.channel]) for c in table.channels if c.sigma is not None
    }
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
