"""Numbers as programs in C and Fortran write them."""

from pathlib import Path

from calib.errors import CalibError
from calib.records.fortran import fortran_value, overflowed
from calib.records.sheet import comma_hint

MAX_SHOWN_CHARACTERS = 40  # characters of a cell in a message


def number(text: str, path: Path, line: int, column: str | int, remedy: str = "") -> float:
    """Value of a number with a decimal point, in the notation of C or Fortran; NaN and infinities are passed on.

    remedy : for a text that is no number at all

    Raises
    ------
    CalibError : anything else; it names file, line and column
    """
    try:
        if "_" not in text:
            return float(text)
    except ValueError:
        pass
    value = fortran_value(text)
    if value is not None:
        return value
    text = text.strip()
    where = f"{path}, line {line}: expected a number in column {column!r}, got"
    if overflowed(text):
        raise CalibError(f"{where} {text!r}: the number overflowed its field; have the program write a wider one")
    if not text:
        raise CalibError(f"{where} a blank field; is the line cut off, or are the widths of the columns others?")
    raise CalibError(f"{where} {_shortened(text)!r}{comma_hint(text) or remedy}")


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]}..."
