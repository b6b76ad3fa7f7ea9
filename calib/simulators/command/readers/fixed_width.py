"""The reader of text in columns of fixed width."""

import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field

from calib.errors import CalibError
from calib.records.text_pattern import comment_test
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.lines import text_lines
from calib.simulators.command.readers.number import number
from calib.simulators.command.readers.rows import NO_ROW, Column, Comment, Count, Step, column_names, read_rows

Width = Annotated[int, Field(ge=1)]
Widths = Annotated[Sequence[Width], Field(min_length=1)]


def read(
    path: Path,
    /,
    *,
    widths: Widths,
    comment: Comment = "#",
    skip: Count = 0,
    names: Sequence[str] | None = None,
    columns: Sequence[Column] | None = None,
    time: Column | None = None,
    step: Step | None = None,
    encoding: str = "utf-8",
) -> Columns:
    """Text in columns of fixed width, as Fortran writes it: numbers need no blank between them.

    A column is called by its position counted from 1, ``"3"``, unless names are stated. Numbers may have exponents such
    as 1.0D+03 and 1.234-105; a field of asterisks, which overflowed, is refused, and so is a blank one.

    Parameters
    ----------
    widths : characters of each column, as in [12, 12, 12] for the format 3E12.5; what stands behind the last is refused
    comment : characters, each of which at the beginning of a line makes it a comment; or a list of texts with which
        such a line begins, leading blanks aside, as in ["LOG:", "PAGE"]; "/.../" is a regular expression, looked for
        in the whole line
    skip : lines at the beginning that are not looked at, such as a header
    names : names of all columns
    columns : names or positions of the columns that are read, where others hold text; without it all
    time : name or position of the column that is time; without it the first
    step : time between the rows, in the unit of time, where no column is time
    encoding : of the text, such as "latin-1"

    Raises
    ------
    CalibError : a field that is no number, a line of another length, no rows, too large a file
    """
    if names is not None and len(names) != len(widths):
        raise CalibError(f"{path}: expected {len(widths)} names, one for each width, got {len(names)}")
    stated = column_names(path, names or [""] * len(widths))
    rows = _fields(path, text_lines(path, encoding), widths, comment, skip)
    chosen = range(1, len(widths) + 1) if columns is None else columns
    return read_rows(path, rows, stated, partial(number, remedy=NO_ROW), time=time, step=step, columns=chosen)


def _fields(
    path: Path, lines: Iterator[str], widths: Sequence[int], comment: str | Sequence[str], skip: int
) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and fields of each line that is neither blank nor a comment."""
    ends = list(itertools.accumulate(widths))
    is_comment = comment_test(comment)
    cuts = list(itertools.pairwise([0, *ends]))
    for line, text in enumerate(lines, 1):
        if line <= skip or not text.strip() or is_comment(text):
            continue
        if text[ends[-1] :].strip():
            raise CalibError(
                f"{path}, line {line}: expected {len(widths)} columns of together {ends[-1]} characters, "
                f"got {len(text.rstrip())} characters; state the width of every column{NO_ROW}"
            )
        yield line, [text[begin:end] for begin, end in cuts]
