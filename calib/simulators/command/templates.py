"""Templates of input decks: jinja2 in a sandbox, strict about names."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from jinja2 import Environment, StrictUndefined, Template, TemplateError, nodes
from jinja2.exceptions import TemplateSyntaxError, UndefinedError
from jinja2.meta import find_undeclared_variables
from jinja2.runtime import BlockReference, LoopContext, Macro, Undefined
from jinja2.sandbox import SandboxedEnvironment
from jinja2.utils import Namespace

from calib.errors import CalibError, nearest
from calib.execution.apart import apart
from calib.simulators.command.formats import fixed, fortran
from calib.units import coherent, from_si

SUFFIX = ".j2"  # of a file that is rendered
MAX_RENDERING_SECONDS = 10  # s of processor time, of all files of one run
MAX_RENDERING_BYTES = 2**29  # bytes of memory, of all files of one run
SHOWN_LINE_CHARACTERS = 100  # of the line of a template in a message
MAX_INTEGER_BITS = 4096  # of an integer that a template works out
KEPT_FILTERS = (
    "abs",
    "float",
    "int",
    "round",
    "length",
    "list",
    "first",
    "last",
    "join",
    "sum",
    "min",
    "max",
    "upper",
    "lower",
    "default",
    "reverse",
    "batch",
    "slice",
)  # fmt: skip - of jinja2; none of them makes much of little


class ValueWithUnit(float):
    """A value in SI that knows its unit and name; arithmetic gives a plain number."""

    unit: str
    name: str

    def __new__(cls, value: float, unit: str, name: str) -> "ValueWithUnit":
        """Return the value with its unit and the name that templates know it by."""
        own = super().__new__(cls, value)
        own.unit, own.name = unit, name
        return own


class TemplateFault(CalibError):
    """A template that cannot be rendered; `names` are the placeholders of its line."""

    names: frozenset[str] = frozenset()


class Fields(dict[str, Any]):
    """Named values, as `excitation` and `request` are in a template."""


@dataclass(frozen=True)
class TemplateText:
    """A template with the name by which messages know it."""

    name: str
    text: str


class _Sandbox(SandboxedEnvironment):
    """Gives access to the fields of `Fields`, `loop` and namespaces, and to no method."""

    intercepted_binops = frozenset(["*", "**", "%"])

    def is_safe_attribute(self, obj: Any, attr: str, value: Any) -> bool:
        """Allow what `loop` says of itself, and what a template has set."""
        return isinstance(obj, LoopContext | Namespace) and not attr.startswith("_")

    def is_safe_callable(self, obj: Any) -> bool:
        """Allow what belongs to templates; the sandbox of jinja2 gives out the method `format` of a text."""
        return obj is range or obj is Namespace or isinstance(obj, Macro | BlockReference | LoopContext)

    def call_binop(self, context: Any, operator: str, left: Any, right: Any) -> Any:
        """Refuse products with texts and lists, and integers of any length."""
        for operand in (left, right):
            if isinstance(operand, bool) or not isinstance(operand, int | float):
                raise CalibError(f"{operator!r} takes numbers, got {operand!r:.40}")
        if isinstance(left, int) and isinstance(right, int):
            sizes = left.bit_length(), right.bit_length()
            bits = sum(sizes) if operator == "*" else sizes[0] * abs(right) if operator == "**" else 0
            if bits > MAX_INTEGER_BITS:
                raise CalibError(
                    f"integers of {sizes[0]} and {sizes[1]} bits: {operator!r} of them is too large; write floats"
                )
        return super().call_binop(context, operator, left, right)


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = _Sandbox(
        undefined=StrictUndefined, autoescape=False, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
        finalize=_printable, optimized=False,  # what is constant is worked out when it is rendered, within its limits
    )  # fmt: skip
    environment.filters = {name: environment.filters[name] for name in KEPT_FILTERS}
    environment.filters |= {"unit": _in_unit, "fortran": fortran, "fixed": fixed, "sin": _sine, "cos": _cosine}
    environment.globals = {"range": range, "namespace": Namespace}
    return environment


def _sine(angle: Any) -> float:
    """Sine of an angle [rad]."""
    return math.sin(_angle(angle))


def _cosine(angle: Any) -> float:
    """Cosine of an angle [rad]."""
    return math.cos(_angle(angle))


def _angle(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CalibError(f"sin, cos: expected an angle in radians, got {value!r:.40}")
    return float(value)


def _printable(value: Any) -> Any:
    if isinstance(value, Undefined):
        return value  # which raises an error when it is written; that of an `if` without `else` is empty
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise CalibError(f"a placeholder gives {value!r:.40}, which is neither number nor text; name one of its parts")
    if isinstance(value, ValueWithUnit):
        return repr(float(value))
    return value


def _in_unit(value: Any, unit: str) -> float:
    """Value in `unit` of a value in SI."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isinstance(unit, str):
        raise CalibError(f"unit: expected a number in SI and a unit such as 'MPa', got {value!r:.40} and {unit!r:.40}")
    if not isinstance(value, ValueWithUnit):
        return from_si(float(value), unit)
    try:
        return from_si(float(value), unit, value.unit)
    except CalibError as error:
        coherent(unit)  # which refuses an unknown unit
        reason = str(error) if "hertz" in str(error) else f"take a unit of {value.unit}, or none"
        raise CalibError(f"{value.name} is in {value.unit or '1'} and is not given in {unit!r}: {reason}") from error


def check_names(
    templates: Sequence[TemplateText], parameters: Sequence[str], known: Mapping[str, Sequence[str]]
) -> None:
    """Check that templates name what there is, and all parameters.

    Parameters
    ----------
    known : what else there is -> its fields; none of a plain value

    Raises
    ------
    CalibError : no template; an unknown name or field, with its line; a parameter that no template names
    """
    used: set[str] = set()
    for template in templates:
        with_mistakes = _Reported(template)
        tree = with_mistakes(lambda: _environment().parse(template.text))  # noqa: B023 - called at once
        with_mistakes(lambda: _compiled(template))  # noqa: B023 - called at once
        free = find_undeclared_variables(tree) - {"range", "namespace"}
        used |= free
        names = [*parameters, *known]
        for name in sorted(free - set(names)):
            raise CalibError(
                f"{template.name}:{_line(tree, name)}: unknown placeholder {name!r}{nearest(name, names)}; known are "
                f"{', '.join(names)}: add it to `parameters`, or mend the template"
            )
        for thing, field, line in _fields(tree):
            if thing in known and thing not in parameters and field not in known[thing]:
                raise CalibError(
                    f"{template.name}:{line}: {thing} has no {field!r}{nearest(field, known[thing])}; it has "
                    f"{', '.join(known[thing])}"
                )
    unused = [name for name in parameters if name not in used]
    if unused:
        where = ", ".join(template.name for template in templates)
        raise CalibError(
            f"parameters: {', '.join(unused)}: no placeholder of {where} names it; write {{{{ {unused[0]} }}}} where "
            "it belongs, or drop it"
        )


def rendered(templates: Sequence[TemplateText], values: Mapping[str, Any]) -> list[str]:
    """Render templates, in one process that is forked for it.

    Raises
    ------
    CalibError : something in it is undefined, does not fit its field or is no number, with the line
    """
    try:
        return apart(
            lambda: [_rendered(template, values) for template in templates], MAX_RENDERING_SECONDS, MAX_RENDERING_BYTES
        )
    except OSError as error:
        names = ", ".join(template.name for template in templates)
        raise TemplateFault(f"{names}: cannot be rendered: {error}; is a loop too long?") from error


def _rendered(template: TemplateText, values: Mapping[str, Any]) -> str:
    def render() -> str:
        text = _compiled(template).render(values)
        text.encode()
        return text

    return str(_Reported(template)(render))


@lru_cache(maxsize=256)
def _compiled(template: TemplateText) -> Template:
    return _environment().from_string(template.text)


class _Reported:
    """Calls something, and reports what a template gets wrong with its name and line."""

    def __init__(self, template: TemplateText):
        self._template = template

    def __call__(self, call: Callable[[], Any]) -> Any:
        try:
            return call()
        except TemplateSyntaxError as error:
            raise CalibError(f"{self._template.name}:{error.lineno}: this is no template: {error.message}") from error
        except UndefinedError as error:
            raise self._fault(error, f"undefined: {error.message}") from error
        except CalibError as error:
            raise self._fault(error, str(error)) from error
        except (TemplateError, ArithmeticError, LookupError, MemoryError, RecursionError, TypeError, ValueError,
                AttributeError, NameError, SyntaxError) as error:  # fmt: skip
            # NameError: jinja2 compiles 1e999 to the name inf
            raise self._fault(error, f"cannot be rendered: {error!r:.200}") from error

    def _fault(self, error: BaseException, reason: str) -> TemplateFault:
        """Return an error with the line of the template that jinja2 has put into the traceback."""
        line, trace = 0, error.__traceback__
        while trace is not None:
            if trace.tb_frame.f_code.co_filename == "<template>":
                line = trace.tb_lineno
            trace = trace.tb_next
        if not line:
            return TemplateFault(f"{self._template.name}: {reason}")
        text = self._template.text.split("\n")[line - 1].strip()
        fault = TemplateFault(f"{self._template.name}:{line}: {reason}; in {text:.{SHOWN_LINE_CHARACTERS}}")
        tree = _environment().parse(self._template.text)
        fault.names = frozenset(node.name for node in tree.find_all(nodes.Name) if node.lineno == line)
        return fault


def _fields(tree: nodes.Template) -> Iterator[tuple[str, str, int]]:
    """Name, field and line of every `name.field` and `name["field"]`."""
    for node in tree.find_all(nodes.Getattr):
        if isinstance(node.node, nodes.Name):
            yield node.node.name, node.attr, node.lineno
    for item in tree.find_all(nodes.Getitem):
        if isinstance(item.node, nodes.Name) and isinstance(item.arg, nodes.Const) and isinstance(item.arg.value, str):
            yield item.node.name, item.arg.value, item.lineno


def named_fields(templates: Sequence[TemplateText], thing: str) -> frozenset[str] | None:
    """Fields of `thing` that templates name; None where one takes it as a whole, so that any may be used."""
    named: list[str] = []
    for template in templates:
        tree = _environment().parse(template.text)
        own = [field for name, field, _ in _fields(tree) if name == thing]
        if len(own) < sum(node.name == thing for node in tree.find_all(nodes.Name)):
            return None
        named += own
    return frozenset(named)


def _line(tree: nodes.Template, name: str) -> int:
    return next((node.lineno for node in tree.find_all(nodes.Name) if node.name == name), 1)
