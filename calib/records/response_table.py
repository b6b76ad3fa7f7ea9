"""Frequency responses from tables: text whose header says what each column is, or any with columns that are stated."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.execution.files import checksum
from calib.records.delimited import TextLayout, read_text, stated_separator
from calib.records.response import order_of, sweeps
from calib.records.response_columns import (
    AMPLITUDE,
    IN_PHASE,
    PHASE,
    QUADRATURE,
    ResponseColumns,
    StatedLevel,
    UnitColumn,
    response_of,
)
from calib.records.sheet import Sheet, end_of_rows
from calib.records.sheet_file import elements, read_sheet

SUFFIXES = (".csv", ".txt", ".dat", ".tsv")
HEADING = re.compile(r"^\s*(?P<what>[^\[\]]+?)\s*(?:\[(?P<unit>[^\[\]]+)\]|\((?P<round>[^\[\]()]+)\))?\s*$")
FREQUENCY_HEADING = re.compile(r"(^|[,;\t\"])\s*frequency\s*[\[(]", re.IGNORECASE)  # in a header
ATTRIBUTE = re.compile(r"^#\s*(?P<key>(?i:place|quantity|source|held))\s*[:=]\s*(?P<value>.+?)\s*$")
WITHOUT_UNIT = ("sweep", "direction")
COMMON = ("frequency", "frequency sigma", "level", *WITHOUT_UNIT)
PHASE_OF = re.compile(rf"^(?P<what>.* {PHASE}) of (?P<of>\w+)$", re.IGNORECASE)  # such as 'mass phase of displacement'
HARMONIC = re.compile(r"^(?P<body>.+?)\s+harmonic\s+(?P<order>\S+)$", re.IGNORECASE)  # such as 'mass harmonic 2'
OF_BODY = (AMPLITUDE, PHASE, IN_PHASE, QUADRATURE, "sigma")
FORM = (
    "a frequency response has the columns 'frequency [Hz]' and, of each body, 'BODY amplitude [mm]' and "
    "'BODY phase [deg]', or 'BODY in-phase [mm]' and 'BODY quadrature [mm]'; further ones may be 'level [N]', "
    "'direction' (up or down), 'sweep', 'BODY sigma [mm]' and 'frequency sigma [Hz]'; amplitudes may be of a velocity "
    "or an acceleration, such as 'BODY amplitude [m/s^2]', and of a higher harmonic: 'BODY harmonic 2 amplitude [mm]'"
)


def read_response(path: str | Path, level: StatedLevel | None = None) -> xr.Dataset:
    """Read a frequency response from delimited text.

    The first line that is no comment is the header, such as

        # place: mass
        # quantity: force
        frequency [Hz], level [N], direction, mass amplitude [mm], mass phase [deg], mass sigma [um]

    Amplitudes are of a displacement, a velocity or an acceleration, by their unit; the phase is that of the same motion
    before the excitation, unless it says so: `mass phase of displacement [deg]`. Those of a higher harmonic of order k
    have its order in their names, `mass harmonic 2 amplitude [mm]` and `mass harmonic 2 phase [deg]`, and a phase
    before k times that of the excitation. Rows are in the order measured. Sweeps are as `calib.records.sweep_numbers`
    tells them, unless a column `sweep` numbers them; without a direction it is that from the first to the last
    frequency.

    Parameters
    ----------
    level : amplitude of the excitation, where the file has no column of it

    Raises
    ------
    CalibError : no such file, a column or unit that is missing or not known, a cell that is no number, with its line
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CalibError(f"{path} cannot be read: {error.strerror or error}") from error
    sheet = read_text(path, content, TextLayout(header=1))
    size = len(sheet.lines or ())
    if not size:
        raise CalibError(f"{path}: there are no rows below the header; {FORM}")
    return response_of(sheet, _columns(sheet, level), slice(0, size), **_attributes(content, path))


@dataclass(frozen=True)
class ResponseTable:
    """A table file and the columns that are a frequency response.

    Attributes
    ----------
    path : as that of `calib.records.table.Table`
    columns : in whose names `*` stands for the number of an element of a cell or structure array
    elements : the numbers that it stands for, a sweep or several each; None for all
    first, last : row counted from 0 that is taken first, and the one before which it ends (None: all), of each element
    text : layout of delimited text
    """

    path: Path
    columns: ResponseColumns
    elements: Sequence[int] | None = None
    first: int = 0
    last: int | None = None
    text: TextLayout = TextLayout()


def read_response_columns(table: ResponseTable) -> xr.Dataset:
    """Read the frequency response that the columns of a table are.

    Raises
    ------
    CalibError : a file that cannot be read, a column or element that it lacks, rows that it does not have, a unit that
        does not fit, a cell that is no number, or no response; with file and place
    """
    sheet = read_sheet(table.path, table.path.read_bytes(), table.text)
    source = f"{table.path.name}, sha256 {checksum(table.path)}"
    named = table.columns.named
    parts = []
    for number, element in elements(sheet, named, table.elements):
        sizes = {column: len(element.find(column)) for column in named}
        if len(set(sizes.values())) > 1:
            raise CalibError(f"{table.path}: the columns used must have one length, got {sizes}")
        size = sizes[table.columns.frequency.column]
        last = end_of_rows(table.path, table.first, table.last, size, "rows")
        parts.append((number, response_of(element, table.columns, slice(table.first, last), source=source)))
    if any(len(sweeps(part)) > 1 for _, part in parts) or len(parts) == 1:
        return _joined([part for _, part in parts])
    return _joined([part for _, part in parts]).assign(
        sweep=("point", np.concatenate([np.full(part.sizes["point"], float(number)) for number, part in parts]))
    )


def _joined(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Responses one after the other, their sweeps numbered on."""
    numbered, begin = [], 0.0
    for part in parts:
        own = part["sweep"].values - part["sweep"].values.min() + begin
        numbered.append(part.assign(sweep=("point", own)))
        begin = own.max() + 1.0
    return numbered[0] if len(parts) == 1 else xr.concat(numbered, "point", combine_attrs="override")


def has_frequencies(path: Path) -> bool:
    """Whether the header of a delimited text names a column of frequencies, as a response has it."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            rows = (line for line in file if line.strip() and not line.startswith("#") and not stated_separator(line))
            header = next(rows, "")
    except OSError:
        return False
    return FREQUENCY_HEADING.search(header) is not None


def _columns(sheet: Sheet, level: StatedLevel | None) -> ResponseColumns:
    names = [name for name in sheet.columns if isinstance(name, str)]
    common: dict[str, UnitColumn] = {}
    of_body: dict[int, dict[tuple[str, str], UnitColumn]] = {1: {}}
    for name in names:
        position = next(i for i in sheet.columns if isinstance(i, int) and sheet.columns[i] is sheet.columns[name])
        match = HEADING.match(name)
        what, unit = (match["what"], match["unit"] or match["round"] or "") if match else (name, "")
        phase = PHASE_OF.match(what)
        what, motion = (phase["what"], phase["of"].lower()) if phase else (what, "")
        body, _, of = what.rpartition(" ")
        of = of.lower()
        if what.lower() in COMMON:
            what = what.lower()
            if what in common:
                raise CalibError(f"{sheet.path}: two columns are {what!r}, one of them {name!r}; rename or drop one")
            common[what] = UnitColumn(position, unit)
        elif body and of in OF_BODY:
            body, order = _harmonic(body, f"{sheet.path}: column {name!r}")
            own = of_body.setdefault(order, {})
            if (body, of) in own:
                raise CalibError(f"{sheet.path}: column {name!r} is the second one of its kind; rename or drop one")
            own[body, of] = UnitColumn(position, unit, of=motion)
        else:
            hint = nearest(what, [*COMMON, *(f"{body} {one}" for one in OF_BODY if body)])
            raise CalibError(f"{sheet.path}: column {name!r} is not known{hint}; {FORM}")
        if not unit and what not in WITHOUT_UNIT:
            raise CalibError(f"{sheet.path}: column {name!r} states no unit; write it in brackets, as in '{what} [mm]'")
    if "frequency" not in common or not of_body[1]:
        raise CalibError(f"{sheet.path}: the columns are {names}; {FORM}")
    excitation = common.get("level", level)
    if excitation is None:
        raise CalibError(
            f"{sheet.path}: there is no column 'level [N]', the amplitude of the excitation; add it, or state the "
            "amplitude in [record.excitation]"
        )
    sweep, direction = (common[what].column if what in common else None for what in WITHOUT_UNIT)
    amplitudes, sigmas = (
        {
            order: {key: column for key, column in own.items() if (key[1] == "sigma") is is_sigma}
            for order, own in of_body.items()
        }
        for is_sigma in (False, True)
    )
    return ResponseColumns(
        common["frequency"],
        amplitudes.pop(1),
        excitation,
        common.get("frequency sigma"),
        {body: column for (body, _), column in sigmas.pop(1).items()},
        sweep,
        direction,
        amplitudes,
        {order: {body: column for (body, _), column in own.items()} for order, own in sigmas.items()},
    )


def _harmonic(body: str, where: str) -> tuple[str, int]:
    """Body and order that a heading names, such as 'mass harmonic 2'; of one without an order the first harmonic."""
    match = HARMONIC.match(body)
    if match is None and "harmonic" in body.lower():
        raise CalibError(
            f"{where}: a harmonic is named by its order, as in 'BODY harmonic 2 amplitude [mm]'; rename it"
        )
    return (match["body"], order_of(match["order"], where)) if match else (body, 1)


def _attributes(content: bytes, path: Path) -> dict[str, str]:
    """Place, quantity, source, and the body whose amplitude was held, as comments state them."""
    found = {"source": path.name}
    for line in content.decode("utf-8", errors="replace").splitlines():
        match = ATTRIBUTE.match(line)
        if match:
            found[match["key"].lower()] = match["value"]
    return found
