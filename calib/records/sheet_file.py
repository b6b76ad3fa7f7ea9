"""The columns of a table file: MATLAB, JSON or delimited text, by its suffix."""

import json
import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from calib.errors import CalibError
from calib.records.delimited import TextLayout, read_text
from calib.records.matlab import read_matlab
from calib.records.sheet import Cells, Sheet, UnknownColumn

ANY = "*"  # in the name of a column, the place of the number of an element


def read_sheet(path: Path, content: bytes, layout: TextLayout) -> Sheet:
    """Return the columns of a file.

    Raises
    ------
    CalibError : content that cannot be read, or a layout of what is no text
    """
    binary = {".mat": read_matlab, ".json": _json}.get(path.suffix.lower())
    if binary is None:
        return read_text(path, content, layout)
    stated = [f.name for f in fields(TextLayout) if getattr(layout, f.name) != f.default]
    if stated:
        raise CalibError(f"{path}: {', '.join(stated)} can be stated of delimited text only; drop it")
    return binary(path, content)


def _json(path: Path, content: bytes) -> Sheet:
    """Columns, by position from 1, of a JSON list of rows, alone or as the only such member of an object."""
    try:
        document = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise CalibError(f"{path}: not a readable JSON file ({error})") from error
    members = list(document.values()) if isinstance(document, dict) else [document]
    tables = [m for m in members if isinstance(m, list) and m and all(isinstance(row, list) for row in m)]
    if len(tables) != 1:
        raise CalibError(f"{path}: expected one list of rows, found {len(tables)}; keep one")
    rows = tables[0]
    for i, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise CalibError(f"{path}, sample {i}: expected {len(rows[0])} cells as in sample 0, got {len(row)}")
    return Sheet(path, dict(enumerate(zip(*rows, strict=True), 1)), None)


def elements(sheet: Sheet, columns: Sequence[str | int], wanted: Sequence[int] | None) -> list[tuple[int, Sheet]]:
    """Return a sheet for each element of a cell or structure array that `*` in the names of columns stands for.

    In each, the column "s(*).force" is what the file calls "s(1).force", "s(2).force" and so on; a name without `*` is
    the same column in all of them. Each is given with its number; a file without `*` in the names is one, of number 0.

    Parameters
    ----------
    wanted : the numbers of the elements, in the order wanted; None: all that the file has

    Raises
    ------
    CalibError : no such element, or columns of one that differ in length
    """
    starred = [column for column in columns if isinstance(column, str) and ANY in column]
    if not starred:
        if wanted is not None:
            raise CalibError(
                f"{sheet.path}: elements are those that {ANY!r} in the name of a column stands for, but none has it; "
                "write it, as in 'runs(*).force', or drop elements"
            )
        return [(0, sheet)]
    numbers = _numbers(sheet, starred[0]) if wanted is None else wanted
    return [(number, _element(sheet, columns, number)) for number in numbers or [1]]


def _numbers(sheet: Sheet, column: str) -> list[int]:
    """Numbers of the elements that a column with `*` has."""
    pattern = re.compile(r"(\d+)".join(re.escape(part) for part in column.split(ANY)))
    matches = (pattern.fullmatch(name) for name in sheet.columns if isinstance(name, str))
    return sorted({int(match[1]) for match in matches if match is not None and len(set(match.groups())) == 1})


def _element(sheet: Sheet, columns: Sequence[str | int], number: int) -> Sheet:
    names = {c: c.replace(ANY, str(number)) if isinstance(c, str) else c for c in columns}
    cells: dict[str | int, Cells] = {}
    for column, name in names.items():
        try:
            cells[column] = sheet.find(name)
        except UnknownColumn as error:
            raise UnknownColumn(column, str(error)) from error
    sizes = {names[column]: len(own) for column, own in cells.items()}
    if len(set(sizes.values())) > 1:
        raise CalibError(f"{sheet.path}: the columns used must have one length, got {sizes}")
    return Sheet(sheet.path, cells, sheet.lines, value=sheet.value)
