"""Delimited text as rows of cells."""

import codecs
import csv
import io
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.errors import CalibError
from calib.records.fortran import fortran_value, overflowed
from calib.records.sheet import Cells, Sheet, comma_hint, real_number
from calib.records.text_pattern import comment_test
from calib.units import MINUS

SEPARATORS = ";\t,"  # looked for in the first row, in this order; else blanks
BLANK = " "
SEPARATOR_LINE = re.compile(r'"?sep=([^"\r\n])"?', re.IGNORECASE)  # above the header, by which Excel is told
POINT_FOR_COMMA = str.maketrans({",": ".", ".": ","})  # '1.234' is no number of a text with a decimal comma
MATLAB_COMMENT = "% "  # that begins a line above the numbers, where no other comment is stated
WHOLE_PART, FRACTION = re.compile(rf"[+{MINUS}-]?\d+"), re.compile(r"\d+")  # of '-1,5'


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
        it holds anything but numbers, else none; refused where it holds numbers above numbers too
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
        """Whether a cell can stand for a number only, be it with another decimal sign or overflowed in its field."""
        return self.value(cell) is not None or overflowed(cell) or real_number(cell) is not None

    def value(self, cell: str) -> float | None:
        """Value of a cell that is a number in the notation of C or Fortran; None for any other text."""
        text = self.plain(cell)
        value = real_number(text)
        return fortran_value(text) if value is None else value

    def plain(self, cell: str) -> str:
        """Return the text of a number with a decimal point and "-" for the minus sign.

        A point beside a decimal comma becomes a comma: it may separate thousands, and the text is then no number.
        """
        plain = cell.replace(MINUS, "-")
        return plain if self.decimal == "." else plain.translate(POINT_FOR_COMMA)


@dataclass(frozen=True)
class DelimitedRows:
    """Rows of a delimited text.

    Attributes
    ----------
    names : stated, or the cells of the first line of the header; None where there is no header
    rows : line number, counted from 1, and cells of each row below the header
    layout : with the separator that the text states in a line of its own
    """

    names: Sequence[str] | None
    rows: Iterator[tuple[int, list[str]]]
    layout: TextLayout


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
        comma that separates cells too, a first row that may be a header or a sample
    """
    numbered, layout = _numbered(lines, layout)
    if layout.separator == layout.decimal:
        raise CalibError(f"{path}: separator and decimal are both {layout.decimal!r}; state another separator")
    rows = _cut(path, numbered, layout)
    if layout.names is not None:
        expected = f"{len(layout.names)} cells, one for each name", len(layout.names), remedy
        rows = _checked(path, itertools.islice(rows, layout.header or 0, None), *expected)
        return DelimitedRows(layout.names, rows, layout)
    first = next(rows, None)
    if first is None:
        raise CalibError(f"{path}: the file holds no rows")
    line, cells = first
    names = [cell.strip() for cell in cells]
    header = layout.header
    if header is None:
        second = next(rows, None)
        header = _header_lines(path, first, second, layout)
        rows = rows if second is None else itertools.chain([second], rows)
    expected = f"{len(cells)} cells as in line {line}", len(cells), remedy
    if header == 0:
        return DelimitedRows(None, _checked(path, itertools.chain([first], rows), *expected), layout)
    return DelimitedRows(names, _checked(path, itertools.islice(rows, header - 1, None), *expected), layout)


def read_text(path: Path, content: bytes, layout: TextLayout) -> Sheet:
    """Columns of a delimited text, by position from 1 and by name where a header gives it to one column only.

    Names may stand in a comment directly above the numbers too, as `numpy.savetxt` writes them.

    Raises
    ------
    CalibError : another encoding, integers that may be one column with a decimal comma, or as in `delimited_rows`
    """
    codec = text_codec(path, layout.encoding)
    try:
        lines = io.StringIO(content.decode(codec), newline=None).read().split("\n")
    except UnicodeError as error:
        raise CalibError(
            f"{path}: not a text file in {layout.encoding.upper()} ({error}); state its encoding, such as "
            'encoding = "latin-1"; a MATLAB file needs the suffix .mat'
        ) from error
    if layout.header is None and layout.names is None and _begins_with_matlab_comment(lines, layout):
        layout = replace(layout, comment=f"{layout.comment}%")
    text = delimited_rows(path, lines, layout)
    numbered = list(text.rows)
    columns: dict[str | int, Cells] = dict(enumerate(zip(*(cells for _, cells in numbered), strict=True), 1))
    if columns:
        names = text.names
        if names is None:
            begin = numbered[0][0] - 1  # of the lines
            separator = text.layout.separator_of(lines[begin])
            if text.layout.separator is None and separator == "," and len(columns) == 2:
                _check_decimal_comma(path, numbered)
            names = _names_in_comments(lines[layout.skip : begin], layout, separator, len(columns))
        columns |= {name: columns[i] for i, name in enumerate(names, 1) if name and names.count(name) == 1}
    return Sheet(path, columns, [line for line, _ in numbered], value=layout.value)


def _numbered(lines: Iterable[str], layout: TextLayout) -> tuple[Iterator[tuple[int, str]], TextLayout]:
    """Each line that is neither blank nor a comment, with its number; and the layout with the separator it states."""
    is_comment = comment_test(layout.comment)
    numbered = (
        (number, line.strip(" "))
        for number, line in enumerate(lines, 1)
        if number > layout.skip and line.strip() and not is_comment(line)
    )
    first = next(numbered, None)
    if first is None:
        return numbered, layout
    separator = stated_separator(first[1])
    if separator is None:
        return itertools.chain([first], numbered), layout
    return numbered, replace(layout, separator=layout.separator or separator)


def stated_separator(line: str) -> str | None:
    """Separator of a line such as 'sep=;', which spreadsheets write above a table; None of any other."""
    match = SEPARATOR_LINE.fullmatch(line.rstrip("\r\n").strip(" "))
    return match[1] if match else None


def _header_lines(
    path: Path, first: tuple[int, list[str]], second: tuple[int, list[str]] | None, layout: TextLayout
) -> int:
    """Lines of the header where none are stated: 1 where the first row holds names, 0 where it holds numbers.

    Raises
    ------
    CalibError : it holds both, and numbers stand below its numbers: a sample with a gap, or names that are numbers
    """
    line, cells = first
    text = next((cell for cell in cells if cell.strip() and not layout.is_numeric(cell)), None)
    if text is None:
        return 0
    hint = comma_hint(text)
    for above, below in zip(cells, second[1] if second else [], strict=False):
        if layout.is_numeric(above) and layout.is_numeric(below):
            raise CalibError(
                f"{path}, line {line}: expected names or numbers in the first row, got both, {text.strip()!r} and "
                f"{above.strip()!r}{hint}; {'else ' if hint else ''}state header = 0 where the row is a sample, "
                "header = 1 where it names the columns; lines above the header are left out by `skip`"
            )
    return 1


def _begins_with_matlab_comment(lines: Sequence[str], layout: TextLayout) -> bool:
    """Whether the first line that counts is a comment of MATLAB's, and the comments that are stated are the usual."""
    if layout.comment != TextLayout.comment:
        return False
    is_comment = comment_test(layout.comment)
    first = next((line for line in lines[layout.skip :] if line.strip() and not is_comment(line)), "")
    return first.startswith(MATLAB_COMMENT)


def _names_in_comments(above: Sequence[str], layout: TextLayout, separator: str, size: int) -> Sequence[str]:
    """Names of all columns in the comments directly above the numbers; none where they have not as many words.

    Of several such comments it is the first: units stand below the names.

    Parameters
    ----------
    above : the lines above the first row of numbers
    size : number of columns
    """
    names: Sequence[str] = []
    for line in reversed(above if isinstance(layout.comment, str) else []):
        text = line.lstrip(f"{layout.comment}{BLANK}").rstrip()
        cells = (text.split() if separator == BLANK else text.split(separator), text.split())
        words = next(([cell.strip(' "') for cell in one] for one in cells if len(one) == size), None)
        if not line.startswith(tuple(layout.comment)) or words is None or not all(words):
            break
        if any(layout.is_numeric(word) for word in words):
            break
        names = words
    return names


def _check_decimal_comma(path: Path, rows: Sequence[tuple[int, list[str]]]) -> None:
    """Refuse two columns of integers, cut at commas that may be decimal ones: '1,5' in a single column.

    A first column that rises with each row is taken for time or a counter, and the comma for a separator.
    """
    if not all(WHOLE_PART.fullmatch(cells[0]) and FRACTION.fullmatch(cells[-1]) for _, cells in rows):
        return
    whole = [real_number(cells[0]) or 0.0 for _, cells in rows]
    if any(after <= before for before, after in itertools.pairwise(whole)):
        line, cells = rows[0]
        raise CalibError(
            f"{path}, line {line}: {','.join(cells)!r} may be one number with a decimal comma or two integers; state "
            "decimal = ',' or separator = ','"
        )


def _cut(path: Path, numbered: Iterator[tuple[int, str]], layout: TextLayout) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of each line."""
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
    """Yield the rows, which must all have `size` cells, and perhaps a separator at their end."""
    for index, (line, cells) in enumerate(rows):
        if len(cells) == size + 1 and not cells[-1].strip():
            cells = cells[:-1]
        if len(cells) != size:
            hint = remedy if index else f"{remedy}; lines above the header are left out by `skip`"
            raise CalibError(f"{path}, line {line}: expected {expected}, got {len(cells)}{hint}")
        yield line, cells
