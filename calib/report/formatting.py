"""Numbers, quantities and percentages as text for a reader."""

import math
import re
from decimal import Decimal

from calib.units import reading

MAX_Z = 100.0  # that is written; the tails of the noise are not known so far out  [standard errors]
MAX_VALUE_DIGITS = 8  # of a value whose error would justify more
MIN_RELATIVE_HALF = 1e-12  # of a half interval over its value, from which on both are written to one place  [1]
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
    power = _power(x, digits)
    if _is_plain(power):
        return _without_zeros(f"{x:.{max(0, digits - 1 - power)}f}")
    return f"{_without_zeros(f'{x:.{digits - 1}e}'.partition('e')[0])}{_ten(power)}"


def _power(x: float, digits: int) -> int:
    """Power of ten of the first digit of a number that is rounded to `digits` significant digits."""
    return int(f"{x:.{digits - 1}e}".partition("e")[2])


def _is_plain(power: int) -> bool:
    """Whether a number whose first digit has this power of ten is written without one."""
    return -4 <= power < 6


def _ten(power: int) -> str:
    return "" if _is_plain(power) else f"·{raised(f'10^{power}')}"


def _without_zeros(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def distinguishing_digits(low: float, high: float) -> int:
    """Significant digits, 2 to 6, from which on the ends of an interval are written differently."""
    return next((d for d in range(2, 6) if f"{low:.{d - 1}e}" != f"{high:.{d - 1}e}"), 6)


def measured_number(value: float, error: float | None) -> str:
    """Write a value with as many digits as its standard error justifies, 4 to 8 of them."""
    if not error or not math.isfinite(error) or not math.isfinite(value) or value == 0.0:
        return number(value)
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2
    return number(value, min(MAX_VALUE_DIGITS, max(4, digits)))


def number_and_half(value: float, half: float | None) -> tuple[str, str]:
    """Write a value and its half interval apart, both to the second digit of the latter and with one power of ten."""
    if half is None or not _share_a_place(value, half):
        return measured_number(value, half), "" if half is None else number(half, 2)
    power = _power(max(abs(value), half), 2)
    return _to_place(value, half, power) + _ten(power), _to_place(half, half, power) + _ten(power)


def capitalised(text: str) -> str:
    """Write a sentence with a capital first letter."""
    return f"{text[:1].upper()}{text[1:]}"


def quantity(value: float | None, unit: str | None, digits: int = 3, half: float | None = None) -> str:
    """Write an SI value with its unit, in mm, ms, µm or µs where it is small, and its half interval."""
    if value is None:
        return "-"
    factor, name = reading(unit or "1", max(abs(_significant(value, digits)), half or 0.0))
    value *= factor
    alone = number(_significant(value, digits), digits).replace("-", "−")
    written = alone if half is None else with_error(value, factor * half)
    return f"{written} {raised(name).replace('um', 'µm').replace('us', 'µs')}".rstrip()


def _significant(value: float, digits: int) -> float:
    """Round a value to `digits` significant digits, also before the point."""
    return float(f"{value:.{digits - 1}e}")


def with_error(value: float | None, half: float | None) -> str:
    """Write a value with its half interval, both to the second digit of the latter: ``"2.40 ± 0.16"``."""
    if value is None or not half or not math.isfinite(half) or not math.isfinite(value):
        return number(value)
    if not _share_a_place(value, half):
        return " ± ".join(number_and_half(value, half)).replace("-", "−")
    power = _power(max(abs(value), half), 2)
    both = f"{_to_place(value, half, power)} ± {_to_place(half, half, power)}".replace("-", "−")
    return both if _is_plain(power) else f"({both}){_ten(power)}"


def _share_a_place(value: float, half: float) -> bool:
    """Whether a value can be written to the place of the second digit of its half interval."""
    return math.isfinite(value) and math.isfinite(half) and half > MIN_RELATIVE_HALF * abs(value)


def _to_place(value: float, half: float, power: int) -> str:
    """Write a value, over ten to a power that is not plain, to the place of the second digit of its half interval."""
    shift = 0 if _is_plain(power) else power
    places = 1 - _power(half, 2) + shift
    rounded_value = round(Decimal(value).scaleb(-shift), places) + 0  # no minus before zero
    return f"{rounded_value:.{max(0, places)}f}"


def rounded(value: float | None, error: float | None) -> str:
    """Write a value to the decimal place of the second digit of twice its error."""
    if value is None or not error or not math.isfinite(error) or not math.isfinite(value):
        return number(value)
    return number_and_half(value, 2.0 * error)[0].replace("-", "−")


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
