"""Columns of numbers from the rows of a text, one for each instant."""

from array import array
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from calib.errors import CalibError, nearest
from calib.records.text_pattern import comment_test
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.lines import REMEDY

NO_ROW = '; if the line is no row, state how it begins, as in comment = ["LOG:"]'
MAX_VALUES = 2**26  # numbers of all columns together: 512 MiB


def _is_comment(stated: str | Sequence[str]) -> str | Sequence[str]:
    """Check what makes lines comments before there is a file."""
    try:
        comment_test(stated)
    except CalibError as error:
        raise ValueError(str(error)) from error
    return stated


Column = str | Annotated[int, Field(ge=1)]  # name, or position counted from 1
Step = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]  # between the samples, in the file's unit of time
Comment = Annotated[str | Sequence[str], AfterValidator(_is_comment)]
Count = Annotated[int, Field(ge=0)]


def column_names(path: Path, header: Sequence[str]) -> list[str]:
    """Name of each column: that of the header where it is given to one column only, else its position from 1.

    Raises
    ------
    CalibError : a name that is the position of another column
    """
    names = [one if one and header.count(one) == 1 else str(i) for i, one in enumerate(header, 1)]
    double = next((one for one in names if names.count(one) > 1), None)
    if double is not None:
        raise CalibError(f"{path}: two columns are called {double!r}; state the names of all columns")
    return names


def read_rows(
    path: Path,
    rows: Iterable[tuple[int, Sequence[str]]],
    names: Sequence[str],
    value: Callable[[str, Path, int, str], float],
    *,
    time: Column | None,
    step: float | None,
    columns: Sequence[Column],
) -> Columns:
    """Read rows of cells.

    Parameters
    ----------
    rows : line number and cells of each row
    names : of the columns
    value : number of a cell; called with the cell, the path, the line and the column
    time, step : column that is time (None: the first), or the time between the rows
    columns : those that are read

    Raises
    ------
    CalibError : no rows, an unknown column, a cell that is no number, too many numbers
    """
    if time is not None and step is not None:
        raise CalibError(f"{path}: a reader needs either the column that is time or the step between rows; drop one")
    clock = [] if step is not None else [_position(path, time or 1, names)]
    used = list(dict.fromkeys([*clock, *(_position(path, column, names) for column in columns)]))
    numbers = array("d")
    for line, cells in rows:
        numbers.extend([value(cells[i], path, line, names[i]) for i in used])
        if len(numbers) > MAX_VALUES:
            raise CalibError(f"{path}, line {line}: expected at most {MAX_VALUES} numbers; {REMEDY}")
    if not numbers:
        raise CalibError(f"{path}: expected rows of numbers, got none; did the program stop before its first step?")
    table = np.frombuffer(numbers).reshape(-1, len(used))
    instants = table[:, 0] if step is None else np.arange(len(table)) * step
    return Columns(instants, {names[i]: table[:, at] for at, i in enumerate(used) if i not in clock})


def _position(path: Path, column: Column, names: Sequence[str]) -> int:
    """Position of a column, counted from 0."""
    if isinstance(column, int) and column <= len(names):
        return column - 1
    if column in names:
        return names.index(column)
    raise CalibError(
        f"{path}: there is no single column {column!r}{nearest(str(column), names)}; "
        f"the columns, counted from 1, are {', '.join(names)}"
    )
