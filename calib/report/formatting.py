"""Numbers, quantities and percentages as text for a reader."""

import math
import re

from calib.units import reading

MAX_Z = 100.0  # that is written; the tails of the noise are not known so far out  [standard errors]
HALF_WIDTH_ERRORS_95 = 1.96  # of a 95 % interval of a normal distribution  [standard errors]


def number(x: float | str | None, digits: int = 4) -> str:
    """Write a number with `digits` significant digits, as a power of ten where it is very large or small."""
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


def distinguishing_digits(low: float, high: float) -> int:
    """Significant digits, 2 to 6, from which on the ends of an interval are written differently."""
    return next((d for d in range(2, 6) if f"{low:.{d - 1}e}" != f"{high:.{d - 1}e}"), 6)


def measured_number(value: float, error: float | None) -> str:
    """Write a value with as many digits as its standard error justifies, 4 to 8 of them."""
    if not error or not math.isfinite(error) or value == 0.0:
        return number(value)
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2
    return number(value, min(8, max(4, digits)))


def number_beside(half: float, value: float) -> str:
    """Write a half interval to two digits, with the power of ten that its value is written with."""
    if not math.isfinite(half) or value == 0.0 or -4 <= (power := math.floor(math.log10(abs(value)))) < 6:
        return number(_significant(half, 2) if math.isfinite(half) else half, 2)
    return f"{number(_significant(half / 10.0**power, 2), 2)}·{number(10.0**power, 1).removeprefix('1·')}"


def capitalised(text: str) -> str:
    """Write a sentence with a capital first letter."""
    return f"{text[:1].upper()}{text[1:]}"


def count(n: int, noun: str) -> str:
    """Write a number of things: ``"1 trial"``, ``"2 trials"``."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def quantity(value: float | None, unit: str | None, digits: int = 3, half: float | None = None) -> str:
    """Write an SI value with its unit, in mm, ms, µm or µs where it is small, and its half interval."""
    if value is None:
        return "-"
    factor, name = reading(unit or "1", max(abs(value), half or 0.0))
    value *= factor
    written = number(_significant(value, digits), digits) if half is None else with_error(value, factor * half)
    return f"{written} {raised(name).replace('um', 'µm').replace('us', 'µs')}".rstrip()


def _significant(value: float, digits: int) -> float:
    """Round a value to `digits` significant digits, also before the point."""
    return float(f"{value:.{digits - 1}e}")


def with_error(value: float | None, half: float | None) -> str:
    """Write a value with its half interval, both to the second digit of the latter: ``"2.40 ± 0.16"``."""
    if value is None or not half or not math.isfinite(half):
        return number(value)
    power = math.floor(math.log10(max(abs(value), half)))
    if -4 <= power < 6:
        return f"{_to_place(value, half)} ± {_to_place(half, half)}".replace("-", "−")
    scale = 10.0**power
    ten = number(scale, 1).removeprefix("1·")
    value, half = value / scale, half / scale
    return f"({_to_place(value, half)} ± {_to_place(half, half)})·{ten}".replace("-", "−")


def _to_place(value: float, half: float) -> str:
    """Write a value to the place of the second digit of its half interval."""
    places = 1 - math.floor(math.log10(half))
    return f"{round(value, places) + 0.0:.{max(0, places)}f}"  # no minus before zero


def rounded(value: float | None, error: float | None) -> str:
    """Write a value to the decimal place of the second digit of twice its error."""
    if value is None or not error or not math.isfinite(error):
        return number(value)
    if not -4 <= math.floor(math.log10(max(abs(value), 2.0 * error))) < 6:
        return number(value)
    return _to_place(value, 2.0 * error).replace("-", "−")


def percent(share: float | None, digits: int = 2) -> str:
    """Write a share in per cent, with a space that does not break."""
    if share is None:
        return "-"
    hundred = 100.0 * share
    written = f"{hundred:.0f}" if abs(hundred) >= 10.0 ** (digits - 1) else number(hundred, digits)
    return f"{written}\u00a0%"


def signed(z: float, plus: str = "") -> str:
    """Write a z to one decimal place with its sign; beyond 100 it is written as a bound."""
    if abs(z) > MAX_Z:
        return f"< −{MAX_Z:g}" if z < 0.0 else f"> {MAX_Z:g}"
    written = f"{abs(z):.1f}"
    return written if written == "0.0" else f"{'−' if z < 0.0 else plus}{written}"


def raised(unit: str) -> str:
    """Write the powers of a unit: ``"m/s²"`` for ``"m/s^2"``; ``"m^-0.5"`` stays, for there is no raised point."""
    return re.sub(r"\^(-?\d+)(?![.\d])", lambda m: m[1].translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")), unit)
