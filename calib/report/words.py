"""Numbers as a reader wants them."""

import math


def number(x: float | str | None, digits: int = 4) -> str:
    """Write a number for a reader: `digits` significant ones, powers of ten as such."""
    if x is None:
        return "-"
    if isinstance(x, int | str):
        return str(x)
    if not math.isfinite(x):
        return "∞" if x > 0 else "-∞" if x < 0 else "-"
    if x == 0.0:
        return "0"
    power = math.floor(math.log10(abs(x)))
    if -4 <= power < 6:
        text = f"{x:.{max(0, digits - 1 - power)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa = f"{x / 10.0**power:.{digits - 1}f}".rstrip("0").rstrip(".")
    return f"{mantissa}·10{str(power).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


def measured_number(value: float, error: float | None) -> str:
    """Write a value with the digits that its standard error leaves it, 4 to 8 of them."""
    if not error or not math.isfinite(error) or value == 0.0:
        return number(value)
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2
    return number(value, min(8, max(4, digits)))


def count(n: int, noun: str) -> str:
    """Write so many of a thing: ``"1 trial"``, ``"2 trials"``."""
    return f"{n} {noun}{'' if n == 1 else 's'}"
