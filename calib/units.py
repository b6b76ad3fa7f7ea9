"""Conversion between numbers in SI and quantities with a unit, as users write and read them."""

import functools
import math
import re
import tokenize
from typing import TYPE_CHECKING, Any

from calib.errors import CalibError, nearest

if TYPE_CHECKING:
    import pint

MILLI = {"m": (1e3, "mm"), "s": (1e3, "ms")}  # SI unit -> factor and unit in which people read small values
MICRO = {"m": (1e6, "um"), "s": (1e6, "us")}  # the same for those below MICRO_BELOW
MICRO_BELOW = 1e-5  # m, s: smaller values are read in um and us
SI_FROM = 1.0  # m, s: such and larger values are read in m and s
SMALL_AXIS_TO = 0.5  # m, s, kg: an axis to such and smaller values is in mm, ms and g
MILLIGRAMS_TO = 5e-4  # kg: and to such masses in mg
POWERS_FROM = 1e5  # such and larger numbers are written with a power of ten  [1]
# a number, then its unit; a comma is refused because pint drops it: '1,5 mm' would become 15 mm
QUANTITY = re.compile(r"\s*\(?\s*[+-]?\s*(\d|\.\d|inf|nan)[\w\s.+\-*/^()%°µ]*")
# a further number that no operator joins, but the one of '3 1/s' and of '3 1': pint would multiply by it
SECOND_NUMBER = re.compile(r"[^\s*/^(+\-]\s+(?!1\s*(/\s*[^\s\d.]|$))[.\d]")
MINUS = "\u2212"  # as word processors and some programs write the sign
PRODUCT_DOTS = "\u00b7\u22c5"  # of units, as in 'N·s/m'
UNIT_POWER = re.compile(r"(?<![\w.])([^\W\d_]+)-(?=\d+(?![\w.]))")  # 's-1', a power without a sign for it
# '5 mm +- 1 mm', '5.00(2) mm': pint would work out the difference and the product
VALUE_WITH_UNCERTAINTY = re.compile(r"±|\+\s*/?\s*-|[\d.]\s*\(\s*[\d.]+\s*\)")
EXPONENT_SIGN = re.compile(r"(?<=[\d.])[eE][+-](?=\d)")
SUM = re.compile(r"[^\s(*/^]\s*[+-]")  # a sign between two terms
NEWTON_PRODUCT = re.compile(r"\b([kM]?N)(mm?|s)\b")  # of which the registry makes other units, if any
TURN = "turn"  # name in the registry of a cycle and a revolution too
RATES_OF_TURNS = ("revolutions_per_minute", "revolutions_per_second")  # names in the registry of rpm and rps
RADIANS_PER_TURN = 2.0 * math.pi  # rad

COMMON_UNITS = (
    "m",
    "mm",
    "um",
    "km",
    "s",
    "ms",
    "us",
    "kg",
    "g",
    "t",
    "N",
    "mN",
    "kN",
    "Pa",
    "kPa",
    "MPa",
    "GPa",
    "Hz",
    "kHz",
    "rad",
    "mrad",
    "deg",
    "V",
    "mV",
)  # fmt: skip - with prefixes, which the registry lists no units with
MAX_REMEMBERED_UNITS = 256  # a table of samples has one
MAX_QUANTITY_CHARACTERS = 100  # characters; the longest unit of a parameter takes less than 20
# product of the exponents in one text: above it, pint would work out integers of any length, as in '9**9**9 m'
MAX_EXPONENT_PRODUCT = 1000.0
POWER = re.compile(r"\*\*")
DECIMAL = r"[+-]?(\d+\.?\d*|\.\d+)"
EXPONENT = re.compile(rf"\*\*\s*({DECIMAL}|\(\s*{DECIMAL}\s*(/\s*{DECIMAL}\s*)?\))(?![\w.]|\s*\*\*)")


@functools.cache
def _registry() -> "pint.UnitRegistry":
    import pint  # 0.5 s, and only needed where a unit string stands: the one import that does not stand at the top

    registry: pint.UnitRegistry = pint.UnitRegistry()
    registry.define(f"@alias {TURN} = rev")
    return registry


def to_si(quantity: str | float, unit: str) -> float:
    """Value of `quantity` in the SI unit `unit`.

    Parameters
    ----------
    quantity : a number, taken as it is, or a text such as ``"1 mm"``, ``"35.15 N/V"``, ``"90 deg"``
    unit : SI unit that is expected, as in ``"m"``, ``"N s/m"``, ``"1/s"``; ``"1"`` or ``""`` without dimension

    Raises
    ------
    CalibError : no number, more than one, as in ``"5 mm +- 1 mm"``, an unknown unit, another dimension, hertz for
        another rate or another rate for hertz, or turns a second for 1/s. Cycles and radians have no dimension, so
        26.24 Hz would silently become 26.24 rad/s, and 26.24 cycle/s 164.9 1/s. Turns a second (rev/min, rpm) are taken
        for rad/s, 2 pi of which they are, and for hertz, one of which each is.
    """
    if hasattr(quantity, "item") and getattr(quantity, "size", 0) == 1:  # a number of numpy's, or an array of one
        quantity = quantity.item()
    if isinstance(quantity, bool) or not isinstance(quantity, str | int | float):
        raise CalibError(f"expected a number or a text with a unit, as in '1 {unit}', got {quantity!r}")
    if not isinstance(quantity, str):
        return _number(float(quantity), quantity, unit)
    given = _parse(quantity, unit)
    expected = _parse(f"1 {unit if unit != '1' else ''}", unit)
    if given.unitless and str(expected.units) != "dimensionless":
        raise CalibError(f"{quantity!r} has no unit: write '{quantity} {unit}', or the bare number for {unit}")
    if not given.is_compatible_with(expected):
        remedy = _newton_product(quantity) or "; mend the unit"
        raise CalibError(f"expected a quantity that can be given in {unit or '1'}, got {quantity!r}{remedy}")
    turns, hertz = _turns_a_second(given), _hertz(expected)
    as_hertz = turns and turns == hertz and not _hertz(given)
    as_turns = _hertz(given) == hertz and (turns == _turns_a_second(expected) or turns and turns == _radians(expected))
    if not (as_hertz or as_turns):
        raise CalibError(
            f"{quantity!r} is not converted to {unit or '1'}: hertz counts cycles, as turns a second do, and 1 Hz may "
            f"mean 1/s or 2 pi rad/s; work it out and write it in {unit or '1'}"
        )
    try:
        value = float(given.m_as(expected.units)) * (RADIANS_PER_TURN**-turns if as_hertz else 1.0)
    except (OverflowError, TypeError) as error:  # an integer beyond the range of float, or a complex number
        raise CalibError(f"{quantity!r} is no real number of {unit or '1'} that can be represented") from error
    return _number(value, quantity, unit)


def shown(value: float | None, unit: str, digits: int = 4) -> str:
    """Write an SI value in the unit that people read: ``shown(0.00123, "m")`` is ``"1.23 mm"``."""
    if value is None:
        return "-"
    factor, name = reading(unit, float(f"{value:.{digits}g}"))  # of the number as it is written
    return f"{plain_number(factor * value, digits)} {name}".rstrip()


def count(n: int, noun: str) -> str:
    """Write a number of things: ``"1 trial"``, ``"2 trials"``."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def plain_number(value: float, digits: int = 4) -> str:
    """Write a number to `digits` significant digits, and all before the point up to 99999: ``"10000"``."""
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text and abs(float(text)) < POWERS_FROM else text


def reading(unit: str, size: float) -> tuple[float, str]:
    """Factor and unit in which people read SI values of this size: ``(1e6, "us")`` for a time step, nothing for "1"."""
    if unit == "1":
        return 1.0, ""
    if abs(size) >= SI_FROM:
        return 1.0, unit
    return (MICRO if 0.0 < abs(size) < MICRO_BELOW else MILLI).get(unit, (1.0, unit))


def shown_unit(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit for an axis of SI values up to `largest`: mm, ms, g to 0.5 m, s, kg; um, us, mg if tiny."""
    if unit == "kg" and abs(largest) <= MILLIGRAMS_TO:
        return 1e6, "mg"
    if unit in MICRO and 0.0 < abs(largest) < MICRO_BELOW:
        return MICRO[unit]
    small = {**MILLI, "kg": (1e3, "g")}
    return small[unit] if unit in small and abs(largest) <= SMALL_AXIS_TO else (1.0, unit or "1")


def is_si(unit: str) -> bool:
    """Whether `unit` is a coherent SI unit, such as ``"m/s"`` or ``"V"``: no factor stands between it and the base."""
    return _parse(f"1 {unit}", unit).to_base_units().magnitude == 1.0


def from_si(value: float, unit: str, si: str | None = None) -> float:
    """Value in `unit` of a value in SI: ``from_si(7e10, "GPa", "Pa")`` is ``70.0``.

    Parameters
    ----------
    si : SI unit of the value; None: the coherent one of the dimension of `unit`

    Raises
    ------
    CalibError : an unknown unit, another dimension than that of `si`, or hertz on one side only
    """
    return value / in_si(unit, si)


@functools.lru_cache(maxsize=MAX_REMEMBERED_UNITS)
def in_si(unit: str, si: str | None = None) -> float:
    """Value in SI of one `unit`: ``in_si("GPa")`` is ``1e9``; `si` and errors as in `from_si`."""
    if unit in ("", "1") and si in (None, "", "1"):
        return 1.0
    return to_si(f"1 {unit}", coherent(unit) if si is None else si)


def coherent(unit: str) -> str:
    """SI unit without a factor of the same dimension: ``"Pa"`` of ``"GPa"``, ``"m/s"`` of ``"mm/ms"``.

    Raises
    ------
    CalibError : an unknown unit
    """
    if unit in ("", "1"):
        return "1"
    known = _registry()
    units = known.Unit("")
    for name, power in _parse(f"1 {unit}", unit).unit_items():
        roots = known.parse_unit_name(name)
        root = known.Quantity(1.0, roots[0][1] if roots else name)
        base = root.to_base_units()  # other than the root of gram, inch and degree
        units = units * (root if base.magnitude == 1.0 else base).units ** power
    return f"{units:~C}".replace("**", "^").replace("*", " ") or "1"


def _parse(text: str, unit: str) -> "pint.Quantity":
    import pint.errors  # see _registry

    mistake = f"cannot read {text!r} as a number with a unit; expected something like '1 {unit}'"
    if len(text) > MAX_QUANTITY_CHARACTERS:
        raise CalibError(
            f"a quantity of {len(text)} characters, {text[:20]!r}..., exceeds the bound of {MAX_QUANTITY_CHARACTERS}; "
            "write a number and a unit, as in '1 N s/m'"
        )
    plain = text.replace(MINUS, "-")
    for dot in PRODUCT_DOTS:
        plain = plain.replace(dot, "*")
    plain = UNIT_POWER.sub(r"\1^-", plain)
    _check_terms(text, plain, unit)
    if not QUANTITY.fullmatch(plain):
        raise CalibError(mistake)
    if SECOND_NUMBER.search(plain.strip()):
        raise CalibError(f"{text!r} has two numbers; write one, digits without blanks between them, as in '12500 N/m'")
    _check_powers(plain)
    try:
        return _registry().Quantity(plain)
    except pint.errors.UndefinedUnitError as error:
        name = error.unit_names if isinstance(error.unit_names, str) else next(iter(error.unit_names))
        hint = _newton_product(text) or nearest(name, [*COMMON_UNITS, *_registry()])
        raise CalibError(f"unknown unit {name!r} in {text!r}{hint}; expected a unit like {unit!r}") from error
    except (pint.errors.PintError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise CalibError(mistake) from error
    except (AssertionError, tokenize.TokenError) as error:  # what pint's parser raises on unfinished text
        raise CalibError(mistake) from error


def _check_terms(text: str, plain: str, unit: str) -> None:
    """Refuse a number with its uncertainty and a sum, which pint would work out.

    plain : the text with "-" for every minus sign
    """
    example = f"5 {unit}".rstrip()
    expected = f"expected one number and a unit, as in {example!r}, got {text!r}"
    if VALUE_WITH_UNCERTAINTY.search(plain):
        raise CalibError(f"{expected}, a number with its uncertainty or with a factor; write the number alone")
    if SUM.search(EXPONENT_SIGN.sub("e", plain)):
        raise CalibError(f"{expected}, a sum or a difference; work it out")


def _newton_product(text: str) -> str:
    """Advice where the product of newton and another unit is written without a blank; "" elsewhere."""
    match = NEWTON_PRODUCT.search(text)
    return f"; write a product of units with a blank, '{match[1]} {match[2]}' for {match[0]!r}" if match else ""


def _check_powers(text: str) -> None:
    """Refuse powers that take long to work out, however they are written: pint reads '9³', '9 cubed' as '9**3'."""
    import pint.util  # see _registry

    written = pint.util.string_preprocessor(text)
    exponents = [match.group(2) or match.group(3) for match in EXPONENT.finditer(written)]
    if len(exponents) < len(POWER.findall(written)):
        raise CalibError(f"{text!r}: an exponent is one number, as in 'm^2', 'm**-0.5' or 'm^(1/2)'; write it so")
    power = math.prod(max(1.0, float(exponent)) for exponent in exponents)
    if power > MAX_EXPONENT_PRODUCT:
        raise CalibError(
            f"{text!r}: the product of the exponents, {power:.4g}, exceeds the bound of {MAX_EXPONENT_PRODUCT:g}; "
            "write the number out, as in '1e6 m'"
        )


def _hertz(quantity: "pint.Quantity") -> float:
    """Power of hertz (and its multiples) in a quantity's unit [1]."""
    powers: list[tuple[str, Any]] = list(quantity.unit_items())  # `Any`: pint leaves open which numbers they are
    return sum(power for name, power in powers if name.endswith("hertz"))


def _turns_a_second(quantity: "pint.Quantity") -> float:
    """Power of rates of turns, cycles or revolutions in a quantity's unit; one of turns needs a time to it [1]."""
    powers: list[tuple[str, Any]] = list(quantity.unit_items())
    turns = float(sum(power for name, power in powers if name == TURN))
    times = (power for name, power in powers if _registry().get_dimensionality(name) == {"[time]": 1})
    rates = float(sum(power for name, power in powers if name.endswith(RATES_OF_TURNS)))
    return rates + (turns if any(turns * power < 0.0 for power in times) else 0.0)


def _radians(quantity: "pint.Quantity") -> float:
    """Power of radians in a quantity's unit [1]."""
    powers: list[tuple[str, Any]] = list(quantity.unit_items())
    return float(sum(power for name, power in powers if name == "radian"))


def _number(value: float, quantity: str | float, unit: str) -> float:
    if math.isnan(value):
        raise CalibError(f"expected a number of {unit or '1'}, got {quantity!r}")
    return value


@functools.cache
def powers(unit: str) -> tuple[float, float, float] | None:
    """Powers of length, time and mass in an SI unit, radians and cycles counting as 1; None with others in it."""
    if unit in ("", "1"):
        return 0.0, 0.0, 0.0
    dimension: dict[str, Any] = dict(_parse(f"1 {unit}", unit).dimensionality)
    length, time, mass = (float(dimension.pop(f"[{name}]", 0.0)) for name in ("length", "time", "mass"))
    return None if any(dimension.values()) else (length, time, mass)
