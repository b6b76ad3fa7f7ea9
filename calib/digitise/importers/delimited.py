"""Tables of points: the CSV exports of WebPlotDigitizer and Engauge, and plain ones with a small TOML header."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.digitise.curve import Curve
from calib.digitise.importers.content import content, text
from calib.digitise.importers.imported import Imported
from calib.errors import CalibError
from calib.records.delimited import stated_separator
from calib.records.sheet import COMMA_GROUPS, real_number
from calib.units import MINUS

MAX_CELLS = 5_000_000  # cells of a table
DATE = re.compile(r"\d{1,4}[/-]\d{1,2}[/-]\d{1,4}|\d{1,2}:\d{2}")
RELATION_MARK = "XXX"  # what Engauge writes before points that go on a relation
DECIMAL_COMMA_SEPARATORS = ";\t"  # between cells that may have a decimal comma
WHOLE_NUMBER = re.compile(rf"[+{MINUS}-]?\d+")
COMMA_NUMBER = re.compile(rf"[+{MINUS}-]?(\d+,\d*|,\d+)([eE][+{MINUS}-]?\d+)?")  # '1,5'; '1,234' may be 1234

Row = tuple[int, list[str]]  # line number, cells


def read_table(path: Path) -> Imported:
    """Read a table.

    Exports of WebPlotDigitizer have a row of names and a row ``X,Y,X,Y``, or, of one dataset, no header; those of
    Engauge a column of x with a column a curve, or a block a curve. Any other table is columns with a header.

    Raises
    ------
    CalibError : no text, no rows, a cell that is no number, or one whose comma may be decimal or separate thousands,
        with its line
    """
    lines = text(path, content(path)).splitlines()
    if lines and stated_separator(lines[0]):
        lines[0] = ""
    header, body = _header(lines)
    blocks = _blocks(path, body)
    if not blocks:
        raise CalibError(f"{path}: the file holds no rows; expected columns of numbers")
    names = [cells for _, cells in blocks[0][:2]]
    if len(names) == 2 and _is_names(names[0]) and _is_pairs(names[1]):
        return _pairs(path, blocks)
    if len(blocks) == 1 and all(_is_number(cell) for cell in blocks[0][0][1]):
        return _bare(path, header, blocks[0])
    if any(not _is_names(block[0][1]) for block in blocks):
        at, cells = next(block[0] for block in blocks if not _is_names(block[0][1]))
        raise CalibError(f"{path}, line {at}: expected the names of the columns, got {_short(cells)}; add that row")
    return _columns(path, header, blocks)


def _header(lines: Sequence[str]) -> tuple[str, list[tuple[int, str]]]:
    """TOML text of the leading comments, with its lines where they stand in the file, and the numbered lines below."""
    count = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    comments = [line[1:] for line in lines[:count]]
    if any("=" in line for line in comments):
        return "\n".join(comments), list(enumerate(lines, 1))[count:]
    # Engauge's gnuplot format puts the names of the columns behind a "#", before each block
    return "", [(i, line.removeprefix("#")) for i, line in enumerate(lines, 1)]


def _blocks(path: Path, lines: Sequence[tuple[int, str]]) -> list[list[Row]]:
    """Rows of cells, in blocks that empty lines part."""
    delimiter = _delimiter([line for _, line in lines if line.strip()][:3])
    blocks, fresh, count = list[list[Row]](), True, 0
    for number, line in lines:
        if not line.strip():
            fresh = True
            continue
        try:
            [cells] = csv.reader([line.strip(" ")], delimiter=delimiter, skipinitialspace=True)
        except (csv.Error, ValueError) as error:
            message = f"{path}, line {number}: not a row of cells ({error}); mend the quotation marks"
            raise CalibError(message) from error
        count += len(cells)
        if count > MAX_CELLS:
            raise CalibError(f"{path}: more than {MAX_CELLS} cells; is this the right file?")
        if fresh:
            blocks.append([])
            fresh = False
        blocks[-1].append((number, [cell.strip() for cell in cells]))
    return _with_points(path, blocks) if delimiter in DECIMAL_COMMA_SEPARATORS else blocks


def _with_points(path: Path, blocks: Sequence[Sequence[Row]]) -> list[list[Row]]:
    """Rows with decimal points for decimal commas.

    Raises
    ------
    CalibError : commas or points that may separate thousands
    """
    numbers = [(n, c.removeprefix(RELATION_MARK)) for block in blocks for n, cells in block for c in cells if c]
    groups = [(n, cell) for n, cell in numbers if COMMA_GROUPS.fullmatch(cell)]
    commas = [(n, cell) for n, cell in numbers if COMMA_NUMBER.fullmatch(cell) and not COMMA_GROUPS.fullmatch(cell)]
    points = [(n, cell) for n, cell in numbers if "." in cell and real_number(cell) is not None]
    thousands = any("." in cell or cell.count(",") > 1 for _, cell in groups)
    whole = not commas and any(WHOLE_NUMBER.fullmatch(cell) for _, cell in numbers)  # beside '1,234', which may be one
    doubtful = groups if points or thousands or whole else []
    for number, cell in doubtful or (points if commas else []):
        raise CalibError(
            f"{path}, line {number}: expected one decimal sign and nothing between the thousands, got {cell[:40]!r}, "
            "whose sign may be either; write the numbers with a decimal point, as in 1234.5"
        )
    return [[(number, [_with_point(cell) for cell in cells]) for number, cells in block] for block in blocks]


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if COMMA_NUMBER.fullmatch(cell.removeprefix(RELATION_MARK)) else cell


def _delimiter(lines: Sequence[str]) -> str:
    return next((mark for mark in (";", "\t", ",") if any(mark in line for line in lines)), " ")


def _is_number(cell: str) -> bool:
    value = real_number(cell)
    return value is not None and bool(np.isfinite(value))


def _is_names(cells: Sequence[str]) -> bool:
    return any(cells) and not any(_is_number(cell) for cell in cells)


def _is_pairs(cells: Sequence[str]) -> bool:
    return len(cells) > 1 and len(cells) % 2 == 0 and all(c in ("X", "Y", "Label") for c in cells)


def _short(cells: Sequence[str]) -> str:
    shown = ", ".join(cells)
    return repr(shown if len(shown) < 60 else shown[:57] + "...")


def _cell(path: Path, number: int, name: str, cell: str) -> float:
    """Number of a cell, NaN where it is empty."""
    if not cell:
        return np.nan
    value = real_number(cell.removeprefix(RELATION_MARK))
    if value is not None and np.isfinite(value):
        return value
    hint = "; dates are not read: export that axis in seconds" if DATE.search(cell) else "; mend the cell"
    raise CalibError(f"{path}, line {number}: expected a number in column {name!r}, got {cell[:40]!r}{hint}")


def _pairs(path: Path, blocks: Sequence[Sequence[Row]]) -> Imported:
    """Two columns a dataset, under two header rows."""
    rows = [row for block in blocks for row in block]
    (_, names), (_, kinds) = rows[:2]
    curves, refused = list[Curve](), dict[str, str]()
    for k in range(0, len(kinds), 2):
        name = (names[k] if k < len(names) else "") or f"dataset {k // 2 + 1}"
        if name in refused or name in {curve.name for curve in curves}:
            name = f"{name} ({k // 2 + 1})"
        if (kinds[k], kinds[k + 1]) != ("X", "Y"):
            refused[name] = "it is a bar chart, whose points carry one number each; expected a plot of y over x"
            continue
        points = []
        for number, cells in rows[2:]:
            if k + 1 < len(cells) and (cells[k] or cells[k + 1]):
                points.append([_filled(path, number, name, cells[k + i]) for i in (0, 1)])
        _keep(name, points, curves, refused)
    return Imported(path, "WebPlotDigitizer CSV, two header rows", curves, refused)


def _filled(path: Path, number: int, name: str, cell: str) -> float:
    value = _cell(path, number, name, cell)
    if np.isnan(value):
        raise CalibError(f"{path}, line {number}: a point of {name!r} has one number only; complete or drop it")
    return value


def _keep(name: str, points: Sequence[Sequence[float]], curves: list[Curve], refused: dict[str, str]) -> None:
    if len(points) < 2:
        refused[name] = f"it has {len(points)} point(s); expected two at least"
    else:
        curves.append(Curve(name, np.array(points, dtype=float)))


def _bare(path: Path, header: str, rows: Sequence[Row]) -> Imported:
    """Columns without names: one dataset of two, or columns called by their numbers."""
    columns = _filled_columns(path, [str(i + 1) for i in range(len(rows[0][1]))], rows)
    curves, refused = list[Curve](), dict[str, str]()
    [x, *others] = columns.values()
    for name, y in zip(list(columns)[1:], others, strict=True):
        points = np.column_stack([x, y])
        _keep(path.stem if len(others) == 1 else name, points[np.isfinite(points).all(axis=1)], curves, refused)
    return Imported(path, "table without names", curves, refused, columns, header)


def _columns(path: Path, header: str, blocks: Sequence[Sequence[Row]]) -> Imported:
    """Blocks of columns under their names; the first of a block is x."""
    curves, refused, everything = list[Curve](), dict[str, str](), dict[str, np.ndarray]()
    for number, block in enumerate(blocks, 1):
        names = [name or f"column {i + 1}" for i, name in enumerate(block[0][1])]
        if len(set(names)) < len(names):
            raise CalibError(f"{path}, line {block[0][0]}: two columns have one name; expected names that differ")
        if len(names) < 2:
            raise CalibError(f"{path}, line {block[0][0]}: one column, {names[0][:40]!r}; expected x and a curve")
        columns = _filled_columns(path, names, block[1:])
        x = columns[names[0]]
        for name in names[1:]:
            label = name if name not in {c.name for c in curves} | set(refused) else f"{name} ({number})"
            points = np.column_stack([x, columns[name]])
            _keep(label, points[np.isfinite(points).all(axis=1)], curves, refused)
        everything = columns if len(blocks) == 1 else {}
    return Imported(path, "table with names", curves, refused, everything, header)


def _filled_columns(path: Path, names: Sequence[str], rows: Sequence[Row]) -> dict[str, np.ndarray]:
    values = np.full((len(rows), len(names)), np.nan)
    for i, (number, cells) in enumerate(rows):
        if len(cells) > len(names):
            raise CalibError(f"{path}, line {number}: expected {len(names)} cells, got {len(cells)}")
        for k, cell in enumerate(cells):
            values[i, k] = _cell(path, number, names[k], cell)
    return dict(zip(names, values.T, strict=True))
