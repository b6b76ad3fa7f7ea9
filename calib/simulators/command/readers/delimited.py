"""The reader of delimited text."""

import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from calib.errors import CalibError
from calib.records.delimited import TextLayout, delimited_rows
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.lines import text_lines
from calib.simulators.command.readers.number import number
from calib.simulators.command.readers.rows import NO_ROW, Column, Comment, Count, Step, column_names, read_rows

Separator = Annotated[str, Field(pattern=r'^[^"\r\n]$')]


def read(
    path: Path,
    /,
    *,
    separator: Separator | None = None,
    decimal: Literal[".", ","] = ".",
    comment: Comment = "#",
    skip: Count = 0,
    header: Count | None = None,
    names: Sequence[str] | None = None,
    columns: Sequence[Column] | None = None,
    time: Column | None = None,
    step: Step | None = None,
    encoding: str = "utf-8",
) -> Columns:
    """Delimited text: one row for each instant, numbers in the notation of C or Fortran.

    A column is called by the header, else by its position counted from 1: ``"3"``. Numbers may have exponents such as
    1.0D+03 and 1.234-105; a field of asterisks, which overflowed, is refused.

    Parameters
    ----------
    separator : one character; without it semicolon, tab, comma or blanks, as found in the first row
    decimal : "." or ","
    comment : characters with which comments begin; or a list of texts with which they do behind blanks, as in
        ["LOG:", "PAGE"]; "/.../" is a regular expression that is found in the line
    skip : lines at the beginning that are not looked at
    header : lines before the first row of numbers, of which the first names the columns; without it one where it
        holds anything but numbers
    names : names of all columns, in the place of the header's
    columns : names or positions of the columns that are read, where others hold text; without it all
    time : name or position of the column that is time; without it the first
    step : time between the rows, in the unit of time, where no column is time
    encoding : of the text, such as "latin-1"

    Raises
    ------
    CalibError : a cell that is no number, ragged rows, no rows, too large a file
    """
    layout = TextLayout(separator, decimal, comment, skip, header, names, encoding)
    text = delimited_rows(path, text_lines(path, encoding), layout, NO_ROW)
    first = next(text.rows, None)
    if first is None:
        raise CalibError(f"{path}: expected rows of numbers, got none; did the program stop before its first step?")
    stated = text.names or [""] * len(first[1])
    filled = [i for i, (name, cell) in enumerate(zip(stated, first[1], strict=True), 1) if name or cell.strip()]

    return read_rows(
        path,
        itertools.chain([first], text.rows),
        column_names(path, stated),
        partial(_value, layout),
        time=time,
        step=step,
        columns=filled if columns is None else columns,  # without the one after a separator at the end of each row
    )


def _value(layout: TextLayout, cell: str, path: Path, line: int, column: str) -> float:
    return number(layout.plain(cell), path, line, column, NO_ROW)
