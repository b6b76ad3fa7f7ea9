"""Delimited text as rows of cells."""

import codecs
import csv
import io
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import CalibError
from calib.records.fortran import fortran_value, overflowed
from calib.records.sheet import Cells, Sheet, real_number
from calib.records.text_pattern import comment_test

SEPARATORS = ";\t,"  # looked for in the first row, in this order; else blanks
BLANK = " "


@dataclass(frozen=True)
class TextLayout:
    """How delimited text is laid out.

    Attributes
    ----------
    separator : between the cells of a row, where a blank stands for any number of blanks and tabs; None: semicolon,
        tab, comma or blanks, as found in the first row
    decimal : "." or ","; a decimal comma is not looked for as a separator
    comment : what makes a line a comment, see `calib.records.text_pattern.comment_test`
    skip : lines at the beginning that are not looked at
    header : lines before the first row of numbers, of which the first holds the names of the columns; None: one where
        it holds anything but numbers, else none
    names : of all columns; the header is then dropped unread, and `header` of None is none
    encoding : of the text, such as "latin-1"
    """

    separator: str | None = None
    decimal: str = "."
    comment: str | Sequence[str] = "#"
    skip: int = 0
    header: int | None = None
    names: Sequence[str] | None = None
    encoding: str = "utf-8"

    def separator_of(self, line: str) -> str:
        """Separator that is stated, or found in a line."""
        candidates = SEPARATORS.replace(self.decimal, "")
        return self.separator or next((one for one in candidates if one in line), BLANK)

    def is_numeric(self, cell: str) -> bool:
        """Whether a cell can stand for a number only, be it one that overflowed its field."""
        return self.value(cell) is not None or overflowed(cell)

    def value(self, cell: str) -> float | None:
        """Value of a cell that is a number in the notation of C or Fortran; None for any other text."""
        text = self.plain(cell)
        value = real_number(text)
        return fortran_value(text) if value is None else value

    def plain(self, cell: str) -> str:
        """Return the text of a number with a decimal point."""
        return cell if self.decimal == "." else cell.replace(self.decimal, ".")


@dataclass(frozen=True)
class DelimitedRows:
    """Rows of a delimited text.

    Attributes
    ----------
    names : stated, or the cells of the first line of the header; None where there is no header
    rows : line number, counted from 1, and cells of each row below the header
    """

    names: Sequence[str] | None
    rows: Iterator[tuple[int, list[str]]]


def text_codec(path: Path, encoding: str) -> str:
    """Encoding by which a text is decoded: of UTF-8 that which drops a byte order mark.

    Raises
    ------
    CalibError : no encoding of texts
    """
    try:
        " ".encode(encoding)
        return "utf-8-sig" if codecs.lookup(encoding).name == "utf-8" else encoding
    except LookupError as error:
        raise CalibError(f"{path}: unknown encoding {encoding!r}; expected one such as 'utf-8' or 'latin-1'") from error


def delimited_rows(path: Path, lines: Iterable[str], layout: TextLayout, remedy: str = "") -> DelimitedRows:
    """Cut lines of text into rows of cells, all of one length, one after the other as they are asked for.

    remedy : for a row of another length

    Raises
    ------
    CalibError : no rows, ragged rows (as they are met), a quotation mark that is not closed in its line, a decimal
        comma that separates cells too
    """
    if layout.separator == layout.decimal:
        raise CalibError(f"{path}: separator and decimal are both {layout.decimal!r}; state another separator")
    rows = _cut(path, lines, layout)
    if layout.names is not None:
        expected = f"{len(layout.names)} cells, one for each name", len(layout.names), remedy
        return DelimitedRows(layout.names, _checked(path, itertools.islice(rows, layout.header or 0, None), *expected))
    first = next(rows, None)
    if first is None:
        raise CalibError(f"{path}: the file holds no rows")
    line, cells = first
    names = [cell.strip() for cell in cells]
    found = int(any(name and not layout.is_numeric(name) for name in names))
    header = found if layout.header is None else layout.header
    expected = f"{len(cells)} cells as in line {line}", len(cells), remedy
    if header == 0:
        return DelimitedRows(None, _checked(path, itertools.chain([first], rows), *expected))
    return DelimitedRows(names, _checked(path, itertools.islice(rows, header - 1, None), *expected))


def read_text(path: Path, content: bytes, layout: TextLayout) -> Sheet:
    """Columns of a delimited text, by position from 1 and by name where a header gives it to one column only.

    Raises
    ------
    CalibError : another encoding, or as in `delimited_rows`
    """
    codec = text_codec(path, layout.encoding)
    try:
        lines = io.StringIO(content.decode(codec), newline=None).read().split("\n")
    except UnicodeError as error:
        raise CalibError(
            f"{path}: not a text file in {layout.encoding.upper()} ({error}); state its encoding, such as "
            'encoding = "latin-1"; a MATLAB file needs the suffix .mat'
        ) from error
    text = delimited_rows(path, lines, layout)
    numbered = list(text.rows)
    columns: dict[str | int, Cells] = dict(enumerate(zip(*(cells for _, cells in numbered), strict=True), 1))
    if columns:
        names = text.names or []
        columns |= {name: columns[i] for i, name in enumerate(names, 1) if name and names.count(name) == 1}
    return Sheet(path, columns, [line for line, _ in numbered], value=layout.value)


def _cut(path: Path, lines: Iterable[str], layout: TextLayout) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each line that is neither blank nor a comment."""
    is_comment = comment_test(layout.comment)
    numbered = (
        (number, line.strip(" "))
        for number, line in enumerate(lines, 1)
        if number > layout.skip and line.strip() and not is_comment(line)
    )
    first = next(numbered, None)
    if first is None:
        return
    taken: list[int] = []  # numbers of the lines of the row that is being read

    def texts() -> Iterator[str]:
        for number, line in itertools.chain([first], numbered):
            taken.append(number)
            yield line.replace("\t", BLANK) if layout.separator == BLANK else line

    reader = csv.reader(texts(), delimiter=layout.separator_of(first[1]), skipinitialspace=True)
    try:
        for cells in reader:
            if len(taken) > 1:
                raise CalibError(f"{path}, line {taken[0]}: a quotation mark is not closed in its line; mend it")
            yield taken.pop(), cells
    except csv.Error as error:
        raise CalibError(f"{path}, line {taken[0]}: expected a row of cells, got none ({error})") from error


def _checked(
    path: Path, rows: Iterable[tuple[int, list[str]]], expected: str, size: int, remedy: str
) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows, which must all have `size` cells."""
    for index, (line, cells) in enumerate(rows):
        if len(cells) != size:
            hint = remedy if index else f"{remedy}; lines above the header are left out by `skip`"
            raise CalibError(f"{path}, line {line}: expected {expected}, got {len(cells)}{hint}")
        yield line, cells
