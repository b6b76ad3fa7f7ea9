"""What the code in a template may do: arithmetic, loops and formats, and nothing beside."""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache, wraps
from typing import Any

from jinja2 import StrictUndefined, pass_context
from jinja2.runtime import BlockReference, Context, LoopContext, Macro, Undefined
from jinja2.sandbox import SandboxedEnvironment
from jinja2.utils import Namespace

from calib.errors import CalibError
from calib.simulators.command.allowance import COUNT, KEY, SCALAR, RenderingAllowance, allowance_of
from calib.simulators.command.formats import fixed, fortran

MAX_INTEGER_BITS = 4096  # of an integer that a template works out
MAX_ROUNDED_DIGITS = 300  # to which `round` rounds, either side of the point
MAX_NUMBER_CHARACTERS = 200  # of a text that `int` takes for a number
MAX_ROWS = 10_000  # of `slice`, and elements of a row of `batch`
PLAIN_FILTERS = ("abs", "float", "length", "list", "first", "last", "upper", "lower", "default", "reverse")  # of jinja2
TESTS = (
    "boolean",
    "callable",
    "defined",
    "divisibleby",
    "even",
    "false",
    "float",
    "integer",
    "iterable",
    "lower",
    "mapping",
    "none",
    "number",
    "odd",
    "sameas",
    "sequence",
    "string",
    "true",
    "undefined",
    "upper",
)  # fmt: skip - of jinja2; the others compare, as == and `in` do
LOOP_FIELDS = frozenset(
    ("index", "index0", "revindex", "revindex0", "first", "last", "length", "depth", "depth0", "previtem", "nextitem")
    + ("cycle",)
)


COSTS = {"fixed": 16, "fortran": 4}  # operations of filters that take long
_ORDINARY = SandboxedEnvironment(undefined=StrictUndefined)  # whose filters are called


class ValueWithUnit(float):
    """A value in SI that knows its unit; arithmetic gives a plain number."""

    unit: str

    def __new__(cls, value: float, unit: str) -> "ValueWithUnit":
        """Return the value with its unit."""
        own = super().__new__(cls, value)
        own.unit = unit
        return own


class _Sandbox(SandboxedEnvironment):
    """Gives access to the fields of `Fields`, `loop` and namespaces, and to no method."""

    intercepted_binops = frozenset(["+", "-", "*", "/", "//", "**", "%"])

    def is_safe_attribute(self, obj: Any, attr: str, value: Any) -> bool:
        """Allow what `loop` says of itself, and what a template has set."""
        return (
            isinstance(obj, LoopContext)
            and attr in LOOP_FIELDS
            or isinstance(obj, Namespace)
            and not attr.startswith("_")
        )

    def call_binop(self, context: Context, operator: str, left: Any, right: Any) -> Any:
        """Refuse products with texts and lists, and integers of any length."""
        if operator == "+" and isinstance(left, str | list) and isinstance(right, str | list):
            allowance_of(context).look_at((left, right))
            sum_ = left + right  # type: ignore[operator]  # of a text and a list is refused by Python
            if isinstance(sum_, str):
                allowance_of(context).take(0, len(sum_))
            return sum_
        for operand in (left, right):
            if isinstance(operand, bool) or not isinstance(operand, int | float):
                raise CalibError(f"{operator!r} takes numbers, got {_shown(operand)}")
        if isinstance(left, int) and isinstance(right, int):
            sizes = left.bit_length(), right.bit_length()
            bits = {"*": sum(sizes), "**": sizes[0] * abs(right)}.get(operator, max(sizes) + 1)
            if bits > MAX_INTEGER_BITS:
                raise CalibError(
                    f"{_shown(left)} {operator} {_shown(right)} is too large an integer; write it as a float"
                )
        return super().call_binop(context, operator, left, right)

    def call(__self: "_Sandbox", __context: Context, __obj: Any, *args: Any, **kwargs: Any) -> Any:  # noqa: B902, N805
        """Count a call, and what it is given and gives; only what belongs to templates is called."""
        own = getattr(__obj, "__self__", None)
        if not (isinstance(__obj, CALLED) or __obj is Namespace or isinstance(own, LoopContext)):
            raise CalibError(f"{_shown(__obj)} is not called in a template")  # the method `format` of a text among them
        allowance = allowance_of(__context)
        allowance.look_at((*args, *kwargs.values()))
        result = super().call(__context, __obj, *args, **kwargs)
        if isinstance(result, str):
            allowance.take(0, len(result))
        return result


class _CountedRange:
    """`range` in templates, whose numbers are counted over all loops of one rendering."""

    def __init__(self, allowance: RenderingAllowance) -> None:
        self._allowance = allowance

    def __call__(self, *bounds: int) -> range:
        """Return the range.

        Raises
        ------
        CalibError : too many numbers altogether
        """
        numbers = range(*bounds)
        self._allowance.take(len(numbers))
        return numbers


CALLED = (Macro, BlockReference, LoopContext, _CountedRange)


@lru_cache(maxsize=1)
def sandbox() -> SandboxedEnvironment:
    """Environment of all templates."""
    environment = _Sandbox(
        undefined=StrictUndefined, autoescape=False, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
        finalize=_printable,
    )  # fmt: skip
    own: dict[str, Callable[..., Any]] = {
        "fortran": fortran, "fixed": fixed, "sin": _sine, "cos": _cosine, "int": _integer,
        "round": _rounded, "batch": _batched, "slice": _sliced,
    }  # fmt: skip
    environment.filters = {name: _of_jinja(name) for name in PLAIN_FILTERS}
    environment.filters |= {name: _counted(function, COSTS.get(name, 0)) for name, function in own.items()}
    environment.filters |= {"unit": _in_unit, "join": _joined, "sum": _sum, "min": _least, "max": _greatest}
    environment.filters |= {COUNT: _count, SCALAR: _scalar}
    environment.tests = {name: environment.tests[name] for name in TESTS}
    environment.globals = {name: environment.globals[name] for name in ("range", "namespace")}
    return environment


def given(values: Mapping[str, Any]) -> dict[str, Any]:
    """What a rendering is given: its values, and a new allowance, of which `range` takes its numbers."""
    allowance = RenderingAllowance()
    return {**values, KEY: allowance, "range": _CountedRange(allowance)}


# --- filters ---------------------------------------------------------------------------------------------------------


def _counted(function: Callable[..., Any], cost: int) -> Callable[..., Any]:
    """Return the filter so that it counts its own operations, what it is given and the text that it gives."""

    @pass_context
    @wraps(function)
    def filtered(context: Context, *args: Any, **kwargs: Any) -> Any:
        allowance = allowance_of(context)
        allowance.take(cost)
        allowance.look_at((*args, *kwargs.values()))
        result = function(*args, **kwargs)
        if isinstance(result, str):
            allowance.take(0, len(result))
        return result

    return filtered


def _of_jinja(name: str) -> Callable[..., Any]:
    """Return a filter of jinja2 so that it counts what it is given and the text that it gives."""

    @pass_context
    def filtered(context: Context, value: Any, *args: Any, **kwargs: Any) -> Any:
        allowance = allowance_of(context)
        allowance.look_at((value, *args, *kwargs.values()))
        result = _ORDINARY.call_filter(name, value, args, kwargs, context)
        if isinstance(result, str):
            allowance.take(0, len(result))
        return result

    return filtered


@pass_context
def _count(context: Context, value: Any, operations: int, characters: int) -> Any:
    """Count, and return the value."""
    allowance_of(context).take(operations, characters)
    allowance_of(context).look_at((value,))
    return value


@pass_context
def _scalar(context: Context, value: Any) -> Any:
    """Return a number, a text, a truth value or none, and count it; whatever else is compared takes any time."""
    if not (value is None or isinstance(value, str | int | float | Undefined)):
        raise CalibError(f"numbers and texts are compared, got {_shown(value)}; compare one of its parts")
    allowance_of(context).look_at((value,))
    return value


def _elements(context: Context, values: Any, attribute: str | int | None) -> list[Any]:
    """Numbers and texts of a list, or those that its elements have under a name; each is counted."""
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise CalibError(f"expected a list, got {_shown(values)}")
    elements = []
    for one in values:
        value = one if attribute is None else context.environment.getitem(one, attribute)
        elements.append(_scalar(context, value))
    return elements


@pass_context
def _joined(context: Context, values: Any, d: str = "", attribute: str | int | None = None) -> str:
    """Texts of a list, joined."""
    if isinstance(values, str):
        values = list(values)
    texts = [str(_printable(context, one)) for one in _elements(context, values, attribute)]
    separator = str(_scalar(context, d))
    allowance_of(context).take(0, sum(map(len, texts)) + len(separator) * max(0, len(texts) - 1))
    return separator.join(texts)


@pass_context
def _sum(context: Context, values: Any, attribute: str | int | None = None, start: float = 0) -> Any:
    """Sum of numbers."""
    numbers = [*_elements(context, values, attribute), start]
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise CalibError(f"sum: expected numbers, got {_shown(number)}")
    return sum(numbers[:-1], start)


@pass_context
def _least(context: Context, values: Any, attribute: str | int | None = None) -> Any:
    """Least of numbers or texts."""
    return min(_elements(context, values, attribute))


@pass_context
def _greatest(context: Context, values: Any, attribute: str | int | None = None) -> Any:
    """Greatest of numbers or texts."""
    return max(_elements(context, values, attribute))


def _integer(value: Any, default: int = 0, base: int = 10) -> int:
    """Whole number of a number or a text, without what is behind the point."""
    if isinstance(value, str) and len(value) > MAX_NUMBER_CHARACTERS:
        raise CalibError(f"int: expected a number, got a text of {len(value)} characters")
    try:
        return int(value, base) if isinstance(value, str) else int(value)
    except (TypeError, ValueError):
        try:
            return int(float(value))
        except (TypeError, ValueError, OverflowError):
            return default


def _rounded(value: float, precision: int = 0, method: str = "common") -> float:
    """Round to a number of digits behind the point: to the nearest ("common"), up ("ceil") or down ("floor")."""
    if not isinstance(precision, int) or abs(precision) > MAX_ROUNDED_DIGITS:
        raise CalibError(
            f"round: expected digits from -{MAX_ROUNDED_DIGITS} to {MAX_ROUNDED_DIGITS}, got {precision!r:.40}"
        )
    if method == "common":
        return round(value, precision)
    if method not in ("ceil", "floor"):
        raise CalibError(f"round: expected 'common', 'ceil' or 'floor', got {method!r:.40}")
    return (math.ceil if method == "ceil" else math.floor)(value * 10**precision) / 10**precision


def _batched(value: Iterable[Any], size: int, fill: Any = None) -> list[list[Any]]:
    """Lists of `size` elements, the last one filled up where there is something to fill it with."""
    _check_count("batch", size)
    elements = iter(value)
    rows = list(iter(lambda: list(itertools.islice(elements, size)), []))
    if rows and fill is not None:
        rows[-1] += [fill] * (size - len(rows[-1]))
    return rows


def _sliced(value: Iterable[Any], count: int, fill: Any = None) -> list[list[Any]]:
    """`count` lists of about one length, the later ones filled up where there is something to fill them with."""
    _check_count("slice", count)
    elements = list(value)
    short, longer = divmod(len(elements), count)
    rows, begin = [], 0
    for number in range(count):
        end = begin + short + (number < longer)
        rows.append(elements[begin:end] + ([fill] if fill is not None and number >= longer else []))
        begin = end
    return rows


def _check_count(name: str, count: int) -> None:
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MAX_ROWS:
        raise CalibError(f"{name}: expected a whole number from 1 to {MAX_ROWS}, got {count!r:.40}")


def _sine(angle: Any) -> float:
    """Sine of an angle [rad]."""
    return math.sin(_angle(angle))


def _cosine(angle: Any) -> float:
    """Cosine of an angle [rad]."""
    return math.cos(_angle(angle))


def _angle(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CalibError(f"sin, cos: expected an angle in radians, got {_shown(value)}")
    return float(value)


@pass_context
def _in_unit(context: Context, value: Any, unit: str) -> float:
    """Value in `unit` of a value in SI."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isinstance(unit, str):
        raise CalibError(
            f"unit: expected a number in SI and a unit such as 'MPa', got {_shown(value)} and {_shown(unit)}"
        )
    return allowance_of(context).in_unit(float(value), unit, value.unit if isinstance(value, ValueWithUnit) else None)


# --- what is written -------------------------------------------------------------------------------------------------


@pass_context
def _printable(context: Context, value: Any) -> Any:
    if isinstance(value, Undefined):
        return value  # which raises an error when it is written; that of an `if` without `else` is empty
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise CalibError(
            f"a placeholder gives {_shown(value)}, which is neither number nor text; name one of its parts"
        )
    if isinstance(value, str):
        allowance_of(context).take(0, len(value))
    return repr(float(value)) if isinstance(value, ValueWithUnit) else value


def _shown(value: Any) -> str:
    """Value in a message; the texts of a list may be longer than memory."""
    if isinstance(value, str):
        return repr(value[:40])
    if isinstance(value, int) and value.bit_length() > 128:
        return f"an integer of {value.bit_length()} bits"
    if value is None or isinstance(value, int | float):
        return repr(value)
    return f"a {type(value).__name__}"
