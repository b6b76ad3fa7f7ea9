"""Numbers as decks take them: the edit descriptors of Fortran, and fields of a fixed width."""

import math
import re

from calib.errors import CalibError

DESCRIPTOR = re.compile(r"(ES|E|D|F|I)(\d{1,3})(?:\.(\d{1,3}))?(?:E(\d))?", re.IGNORECASE)
MAX_FIELD_WIDTH = 200  # characters
EXPONENT_DIGITS = 2  # of an exponent, unless the descriptor says how many
MAX_INTEGER_ERROR = 1e-9  # by which a number that is written as an integer may differ from one, over its size
MAX_SIGNIFICANT_DIGITS = 17  # that distinguish all doubles


def fortran(value: float, descriptor: str) -> str:
    """Write a number as an edit descriptor of Fortran does: E12.5, ES12.5, D12.5, F8.3, I6, with E12.5E3 and I6.3.

    Raises
    ------
    CalibError : no such descriptor; no finite number; an integer is expected; the number does not fit, where Fortran
        would write asterisks
    """
    match = DESCRIPTOR.fullmatch(descriptor.strip()) if isinstance(descriptor, str) else None
    if match is None:
        raise CalibError(
            f"fortran: expected a descriptor such as 'E12.5', 'D12.5', 'F8.3' or 'I6', got {descriptor!r:.40}"
        )
    kind, width, digits = match[1].upper(), int(match[2]), None if match[3] is None else int(match[3])
    if not 1 <= width <= MAX_FIELD_WIDTH:
        raise CalibError(f"fortran: expected a width from 1 to {MAX_FIELD_WIDTH}, got {descriptor!r}")
    value = _finite(value, "fortran")
    if kind == "I":
        text = _integer(value, digits or 1)
    elif digits is None:
        raise CalibError(f"fortran: expected digits behind the point, as in '{kind}{width}.5', got {descriptor!r}")
    elif kind == "F":
        text = f"{value:.{digits}f}"
    else:
        text = _exponential(value, kind, digits, None if match[4] is None else int(match[4]))
    if len(text) > width:  # the zero before the point is optional
        text = re.sub(r"^(-?)0\.", r"\1.", text)
    if len(text) > width:
        raise CalibError(
            f"{value!r} does not fit {descriptor}: {text!r} has {len(text)} characters; take a wider field"
        )
    return text.rjust(width)


def _integer(value: float, digits: int) -> str:
    whole = round(value)
    if abs(value - whole) > MAX_INTEGER_ERROR * max(1.0, abs(value)):
        raise CalibError(f"fortran: expected a whole number for an I descriptor, got {value!r}; round it, or take F")
    return f"{'-' if whole < 0 else ''}{abs(whole):0{digits}d}"


def _exponential(value: float, kind: str, digits: int, exponent_digits: int | None) -> str:
    """Write with a leading zero (E, D) or a leading digit (ES)."""
    leading = kind == "ES"
    if not leading and digits == 0:
        raise CalibError(f"fortran: {kind} with a leading zero needs a digit behind the point; take {kind}w.1 or ESw.0")
    mantissa, _, power = f"{abs(value):.{digits if leading else digits - 1}e}".partition("e")
    exponent = int(power)
    if not leading:
        mantissa = "0." + mantissa.replace(".", "")
        exponent = exponent + 1 if value else 0
    elif "." not in mantissa:
        mantissa += "."
    size = f"{abs(exponent):0{exponent_digits or EXPONENT_DIGITS}d}"
    letter = "D" if kind == "D" else "E"
    if exponent_digits is None and len(size) > EXPONENT_DIGITS:
        letter = ""  # Fortran leaves the letter out for three digits
    elif exponent_digits is not None and len(size) > exponent_digits:
        raise CalibError(f"{value!r} does not fit an exponent of {exponent_digits} digit(s); take a longer one")
    return f"{'-' if value < 0.0 else ''}{mantissa}{letter}{'-' if exponent < 0 else '+'}{size}"


def fixed(value: float | int | str, width: int, align: str = "right") -> str:
    """Write a number with as many digits as a field of a fixed width takes, or a text, padded with blanks.

    Numbers have a decimal point, unless they are integers: 8 characters take 2.1e11 as "2.100E11" or better.

    Parameters
    ----------
    align : "right" or "left"

    Raises
    ------
    CalibError : it does not fit; no finite number; a width that cannot be
    """
    if isinstance(width, bool) or not isinstance(width, int) or not 1 <= width <= MAX_FIELD_WIDTH:
        raise CalibError(f"fixed: expected a width from 1 to {MAX_FIELD_WIDTH}, got {width!r:.40}")
    if align not in ("right", "left"):
        raise CalibError(f"fixed: expected align 'right' or 'left', got {align!r:.40}")
    if isinstance(value, str):
        text = value
    elif isinstance(value, int):
        text = str(value)
    else:
        text = _shortest(_finite(value, "fixed"), width)
    if len(text) > width:
        raise CalibError(f"{value!r} does not fit {width} characters; take a wider field")
    return text.rjust(width) if align == "right" else text.ljust(width)


def _shortest(value: float, width: int) -> str:
    """Most digits of a number that fit a width; longer than it where not even one digit does."""
    text = ""
    for digits in range(MAX_SIGNIFICANT_DIGITS, 0, -1):
        text = min(_forms(value, digits), key=len)
        if len(text) <= width:
            return text
    return text


def _forms(value: float, digits: int) -> list[str]:
    """Write a number of so many significant digits with and without exponent."""
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    mantissa = mantissa.rstrip("0") if "." in mantissa else f"{mantissa}."
    forms = [f"{mantissa}E{int(power)}"]
    if -MAX_SIGNIFICANT_DIGITS < int(power) <= MAX_SIGNIFICANT_DIGITS:
        plain = f"{value:.{max(0, digits - 1 - int(power))}f}"
        plain = plain.rstrip("0") if "." in plain else f"{plain}."
        rounded = float(f"{value:.{digits - 1}e}")
        if float(plain) == rounded:
            forms += [plain, re.sub(r"^(-?)0\.(?=\d)", r"\1.", plain)]
    return forms


def _finite(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CalibError(f"{name}: expected a finite number, got {value!r:.60}")
    return float(value)
