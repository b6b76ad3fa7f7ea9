"""The columns of a file of measured or simulated samples, by position and by name."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import CalibError, nearest
from calib.units import MINUS

Cells = Sequence[Any] | np.ndarray  # of a column, not yet known to be numbers
COMMA_GROUPS = re.compile(rf"[+{MINUS}-]?[1-9]\d{{0,2}}(,\d{{3}})+(\.\d*)?")  # '1,234.5'; '1,234' may be decimal
POINT_GROUPS = re.compile(rf"[+{MINUS}-]?[1-9]\d{{0,2}}(\.\d{{3}})+(,\d*)?")  # '1.234,5'


def real_number(cell: Any) -> float | None:
    """Value of a cell that can be read as a real number, infinities and NaN among them; None for any other."""
    try:
        return float(cell.replace(MINUS, "-") if isinstance(cell, str) else cell)
    except (ValueError, TypeError):
        return None


def comma_hint(cell: Any) -> str:
    """Advice where a cell that is no number has one comma, or commas or points between its thousands."""
    text = cell.strip() if isinstance(cell, str) else ""
    commas = text.count(",")
    if POINT_GROUPS.fullmatch(text):
        return "; write it without points between the thousands, and set decimal = ','"
    if not COMMA_GROUPS.fullmatch(text):
        return "; if it is a decimal comma, set decimal = ','" if commas == 1 else ""
    if commas > 1 or "." in text:
        return "; write it without commas between the thousands"
    return "; if it is a decimal comma, set decimal = ','; if it separates thousands, write the number without it"


class UnknownColumn(CalibError):
    """A column that the file does not have."""

    def __init__(self, column: str | int, message: str):
        super().__init__(message)
        self.column = column


class UnknownRows(CalibError):
    """Rows that the file does not have; `key` is the one of `first` and `last` that says so."""

    def __init__(self, key: str, message: str):
        super().__init__(message)
        self.key = key


def end_of_rows(path: Path, first: int, last: int | None, size: int, what: str) -> int:
    """Row before which those that are asked for end, of `size` in the file.

    Parameters
    ----------
    first, last : as those of `calib.records.table.Table`
    what : the rows are called

    Raises
    ------
    UnknownRows : the file does not have them
    """
    if last is not None and last <= first:
        raise UnknownRows("last", f"{path}: last = {last} is not above first = {first}; are they in the wrong order?")
    if first >= size:
        raise UnknownRows("first", f"{path}: first = {first} of the {what} was asked for, but the file has {size}")
    if last is not None and last > size:
        raise UnknownRows("last", f"{path}: {what} {first} to {last} were asked for, but the file has {size}")
    return size if last is None else last


@dataclass(frozen=True)
class Sheet:
    """The columns of a file.

    Attributes
    ----------
    columns : cells by position, counted from 1, and by name
    lines : line number of each sample, of a text
    unfit : what else the file names, and what that is
    value : number of a cell, None where it is none
    """

    path: Path
    columns: Mapping[str | int, Cells]
    lines: Sequence[int] | None
    unfit: Mapping[str | int, str] = field(default_factory=dict)
    value: Callable[[Any], float | None] = real_number

    def find(self, column: str | int) -> Cells:
        """Cells of a column.

        Raises
        ------
        UnknownColumn : the file has none of this name or position
        CalibError : the file has this name, but not for a column
        """
        if column in self.columns:
            return self.columns[column]
        if column in self.unfit:
            raise CalibError(f"{self.path}: column {column!r} is {self.unfit[column]}")
        whole = re.split(r"[.({]", str(column))[0]
        if whole in self.unfit and not any(str(known).startswith(whole) for known in self.columns):
            raise CalibError(f"{self.path}: column {column!r}: {whole!r} is {self.unfit[whole]}")
        names = [c for c in self.columns if isinstance(c, str)]
        size = sum(isinstance(c, int) for c in self.columns)
        known = f"the columns are {names}" if names else f"the file has no header, only columns 1 to {size}"
        if not self.columns:
            known = f"it has no columns; it holds {list(self.unfit)}"
        if names and isinstance(column, int):
            known = f"the table has {size} columns: {names}" if size else f"its columns have names: {names}"
        raise UnknownColumn(
            column, f"{self.path}: there is no single column {column!r}{nearest(str(column), names)}; {known}"
        )

    def numbers(self, column: str | int, begin: int, end: int) -> np.ndarray:
        """Finite numbers (end - begin,) of a column, from sample `begin` to the one before `end`.

        Raises
        ------
        CalibError : a cell that is no finite number, with its line
        """
        cells = self.find(column)[begin:end]
        values = np.array([np.nan if (value := self.value(c)) is None else value for c in cells])
        bad = ~np.isfinite(values)
        if bad.any():
            at = int(np.argmax(bad))
            cell = cells[at]
            remedy = "; `first` and `last` of [record.table] take the rows between such cells"
            named = any(isinstance(name, str) for name in self.columns)
            if begin + at == 0 and named and real_number(cell) is None:
                remedy = "; if a row of units follows the names, set header = 2"
            where = f"line {self.lines[begin + at]}" if self.lines else f"sample {begin + at}"
            advice = comma_hint(cell) or remedy
            if isinstance(cell, str) and real_number(cell) is not None and self.value(cell) is None:  # '1.234'
                advice = (
                    "; with decimal = ',' a point may separate thousands: write the numbers without it, or drop "
                    "decimal where the point is the decimal one"
                )
            raise CalibError(f"{self.path}, {where}: expected a number in column {column!r}, got {cell!r}{advice}")
        return values
