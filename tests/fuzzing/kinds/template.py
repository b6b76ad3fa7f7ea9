"""Templates of input decks: damaged ones, and those that want out of the sandbox, or much time or memory."""

# ruff: noqa: E501 - one case a line

import random
from pathlib import Path

from bouncer import TEMPLATE as BOUNCER
from fuzzing.mutations import text_damaged

from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.command.deck import KNOWN, deck_values
from calib.simulators.command.quantities import declared_parameters
from calib.simulators.command.templates import TemplateText, check_names, rendered

PARAMETERS = declared_parameters(
    {"stiffness": "1e4 1/s^2", "damping": "20 1/s", "gap": "1 mm", "restitution": 0.6, "youngs": "70 GPa"}
)
DECK = """\
*MATERIAL
{{ youngs | unit("MPa") | fortran("E12.5") }}, {{ gap | unit("mm") | fixed(8) }}
{% for i in range(4) %}
*NODE {{ i }} {{ (i * restitution) | fortran("F8.3") }}
{% if loop.last %}end{% endif %}
{% endfor %}
{% set ns = namespace(total=0) %}
{% for t in request.times %}
{% set ns.total = ns.total + t %}
{{ t | fixed(10) }} {{ (excitation.omega * t + excitation.phase) | cos }}
{% endfor %}
{% macro line(a, b) %}{{ a }},{{ b }}{% endmacro %}
{{ line(stiffness, damping) }} {{ [1, 2, 3] | join(",") }} {{ ns.total | round(3) }}
"""
SAMPLES = {"bouncer": BOUNCER, "deck": DECK}
ATOMS = [
    "gap", "youngs", "restitution", "excitation", "request", "request.times", "excitation.samples", "cores", "loop", "range",
    "namespace", "self", "caller", "cycler", "lipsum", "joiner", "dict", "config", "[]", "{}", "()", "''", "'a'", "1", "0",
    "-1", "1e308", "1e999", "10**9", "2**4000", "'9' * 5000", "none", "true", "range(10**9)", "range(5000000)", "range(3)",
    "'a' * 10**10", "[0] * 10**9", "'%s' % gap", "'%999999999d' % 1", "'{:>999999999}'.format(1)", "namespace()",
    "namespace(s='a')", "gap.unit", "gap.__class__", "''.__class__.__mro__", "[].__class__.__base__.__subclasses__()",
    "request.__init__.__globals__", "self._TemplateReference__context", "range.__call__.__globals__", "loop.index0",
    "excitation['__class__']", "gap.real", "gap.hex()", "'a'.encode()", "request.keys()", "request['times']", "x", "m(1)",
    "request.times[::-1]", "request.times[10**30]", "'a'[10**10]", "(1, 2, 3)", "{'a': 1}", "{1: {}}", "'\\x00'",
]  # fmt: skip
FILTERS = [
    "unit('mm')", "unit('9**9**9 m')", "unit(1)", "unit('')", "fortran('E12.5')", "fortran('E999.999')", "fortran('F200.199')",
    "fortran('I200.199')", "fortran('')", "fixed(8)", "fixed(10**9)", "fixed(-1)", "fixed(200)", "round(10**9)",
    "round(10**9, 'ceil')", "round(308, 'floor')", "round(-10**8, 'ceil')", "round(2, 'odd')", "join('a' * 9)", "join(gap)",
    "join", "sum", "sum(start=[])", "sum(attribute='x')", "list", "length", "first", "last", "min", "max", "min(attribute='a')",
    "upper", "lower", "default(1)", "default('a', true)", "reverse", "batch(10**9)", "batch(10**9, 0)", "batch(0)", "batch(2, 'x')",
    "slice(10**9)", "slice(10**7, 'x')", "slice(0)", "int", "int(0, 36)", "float", "abs", "sin", "cos", "attr('__class__')",
    "map('upper')", "tojson", "pprint", "center(10**9)", "indent(10**9)", "format(1)", "wordwrap(1)", "xmlattr", "random",
]  # fmt: skip
TESTS = [
    "defined",
    "none",
    "number",
    "string",
    "iterable",
    "odd",
    "divisibleby(0)",
    "in request.times",
    "sameas(1)",
    "eq(1)",
]
ATTACKS = [
    "{% include '../outside/secret.j2' %}",
    "{% include '/etc/passwd' %}",
    "{% extends '../outside/secret.j2' %}",
    "{% import '../outside/secret.j2' as s %}{{ s }}",
    "{% from '../outside/secret.j2' import x with context %}",
    "{% for i in range(10**9) %}{{ i }}{% endfor %}",
    "{% for i in range(2000) %}{% for j in range(2000) %}{% for k in range(2000) %}x{% endfor %}{% endfor %}{% endfor %}",
    "{% for a in request.times %}{% for b in request.times %}{% for c in request.times %}{% for d in request.times %}"
    "{% for e in request.times %}{% for f in request.times %}{{ f }}{% endfor %}{% endfor %}{% endfor %}{% endfor %}"
    "{% endfor %}{% endfor %}",
    "{% set x = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9] %}{% for a in x %}{% for b in x %}{% for c in x %}{% for d in x %}{% for e in x %}"
    "{% for f in x %}{% for g in x %}{% for h in x %}{% for i in x %}{{ i }}{% endfor %}{% endfor %}{% endfor %}{% endfor %}"
    "{% endfor %}{% endfor %}{% endfor %}{% endfor %}{% endfor %}",
    "{% macro m(n) %}{{ m(n) }}{{ m(n) }}{% endmacro %}{{ m(1) }}",
    "{% macro m(n) %}{% if n > 0 %}{{ m(n - 1) }}{{ m(n - 1) }}{% endif %}{% endmacro %}{{ m(60) }}",
    "{% macro m(n) %}{% if n > 0 %}{{ m(n - 1) }}{% for i in range(2) %}{{ m(n - 1) }}{% endfor %}{% endif %}{% endmacro %}{{ m(50) }}",
    "{% set ns = namespace(s='aaaaaaaa') %}{% for i in range(100) %}{% set ns.s = ns.s ~ ns.s %}{% endfor %}{{ ns.s }}",
    "{% set ns = namespace(s='aaaaaaaa') %}{% for i in range(100) %}{% set ns.s = ns.s + ns.s %}{% endfor %}{{ ns.s }}",
    "{% set ns = namespace(s=[1]) %}{% for i in range(100) %}{% set ns.s = ns.s + ns.s %}{% endfor %}{{ ns.s | length }}",
    "{% set ns = namespace(s=[1]) %}{% for i in range(100) %}{% set ns.s = [ns.s, ns.s] %}{% endfor %}{{ ns.s }}",
    "{% set ns = namespace(s=1) %}{% for i in range(5000000) %}{% set ns.s = ns.s + ns.s %}{% endfor %}{{ ns.s }}",
    "{% set ns = namespace(s='ab') %}{% for i in range(40) %}{% set ns.s %}{{ ns.s }}{{ ns.s }}{% endset %}{% endfor %}{{ ns.s }}",
    "{% macro d(s) %}{{ s }}{{ s }}{% endmacro %}{{ " + "d(" * 60 + "'abc'" + ")" * 60 + " }}",
    "{% macro m() %}{% for i in range(5000000) %}" + "long constant text " * 50 + "{% endfor %}{% endmacro %}{{ m() | length }}",
    "{% filter upper %}{% for i in range(5000000) %}" + "x" * 1000 + "{% endfor %}{% endfilter %}",
    "{% set x %}{% for i in range(5000000) %}" + "x" * 1000 + "{% endfor %}{% endset %}",
    "{% for i in range(5000000) %}" + "x" * 1000 + "{% endfor %}",
    "{% for i in range(5000000) %}{{ i | fortran('E20.12') }}{{ i | unit('mm') }}{% endfor %}",
    "{% for i in range(4000) %}{{ range(1000) | join(',' ) }}{% endfor %}",
    "{% for i in range(3000) %}{{ request.times | join('" + "x" * 10000 + "') }}{% endfor %}",
    "{% set b = range(1000000) | list %}{% for i in range(1000000) %}{% if -1 in b %}x{% endif %}{% endfor %}",
    "{% set b = range(1000000) | list %}{% for i in range(1000000) %}{% set c = b[1:] %}{% endfor %}",
    "{% set b = range(1000000) | list %}{% for i in range(1000000) %}{{ b | sum }}{% endfor %}",
    "{% set b = range(1000000) | list %}{% for i in range(1000000) %}{% if b == b[:] %}x{% endif %}{% endfor %}",
    "{% set b = range(1000000) | list %}{% for i in range(1000000) %}{% if b is eq(b) %}x{% endif %}{% endfor %}",
    "{% for i in [[1, [2]]] recursive %}{{ loop(i) if i is iterable }}{% endfor %}",
    "{% set x = [] %}{% for i in x recursive %}{{ loop([1]) }}{% endfor %}",
    "{% for i in [1, 2] recursive %}{{ loop([1, 2]) }}{% endfor %}",
    "{% set ns = namespace(a=1) %}{% set ns.b = ns %}{{ ns }}{{ ns.b.b.b.a }}",
    "{{ '" + "a" * 100000 + "' }}",
    "{{ " + "(" * 500 + "1" + ")" * 500 + " }}",
    "{{ " + "[" * 90 + "]" * 90 + " }}",
    "{{ " + "-" * 5000 + "1 }}",
    "{{ " + "not " * 5000 + "1 }}",
    "{{ 1" + " + 1" * 20000 + " }}",
    "{{ gap" + " | float" * 5000 + " }}",
    "{% if 1 %}" * 500 + "{% endif %}" * 500,
    "{% for i in [1] %}" * 30 + "{% endfor %}" * 30,
    "{% raw %}" + "{{" * 10000,
    "{#" + "x" * 100000,
    "{{ 9" + "9" * 5000 + " }}",
    "{{ 0x" + "f" * 100000 + " }}",
    "{{ 2**4000 * 2**4000 * 1.0 }}",
    "{{ 10**400 / 3 }}",
    "{{ 1 // 0 }}{{ 1 % 0 }}{{ 0 ** -1 }}",
    "{{ (-1) ** 0.5 }}",
    "{{ 1e308 * 1e308 }}",
    "{{ loop.cycle(1) }}",
    "{% call gap() %}{% endcall %}",
    "{% set range = 1 %}{% for i in range(3) %}{% endfor %}",
    "{% set gap = 'x' %}{{ gap }}",
    "{% set unit = 1 %}{% macro unit() %}{{ unit() }}{% endmacro %}{{ unit() }}",
    "{% autoescape true %}{{ '<' }}{% endautoescape %}",
    "{% do gap %}",
    "{% trans %}x{% endtrans %}",
    "{% debug %}",
    "{% with a = 1 %}{{ a }}{% endwith %}",
    "{{ youngs }}\x00\x1b[2J\u202e\ud7ff",
]  # fmt: skip


def _expression(rng: random.Random, depth: int = 0) -> str:
    if depth > 3 or rng.random() < 0.3:
        return rng.choice(ATOMS)
    left = _expression(rng, depth + 1)
    match rng.randrange(7):
        case 0 | 1 | 2:
            return f"({left}) | {rng.choice(FILTERS)}"
        case 3 | 4:
            operator = rng.choice(["+", "-", "*", "/", "//", "%", "**", "~", "==", "<", "in", "and", "or"])
            return f"({left}) {operator} ({_expression(rng, depth + 1)})"
        case 5:
            return f"({left}) is {rng.choice(TESTS)}"
    return rng.choice([f"({left})[{_expression(rng, depth + 1)}]", f"({left}).{rng.choice(['a', '__class__', 'unit', 'real'])}",
                       f"[{left}] + [{left}]", f"range({left})", f"({left})()", f"({left})[1:]"])  # fmt: skip


def _statement(rng: random.Random, depth: int = 0) -> str:
    inner = _statement(rng, depth + 1) if depth < 4 else "x"
    return rng.choice([
        f"{{{{ {_expression(rng)} }}}}",
        f"{{{{ {_expression(rng)} }}}}{inner}",
        f"{{% for x in {_expression(rng)} %}}{inner}{{% endfor %}}",
        f"{{% if {_expression(rng)} %}}{inner}{{% endif %}}",
        f"{{% set x = {_expression(rng)} %}}{inner}",
        f"{{% set x %}}{inner}{{% endset %}}{{{{ x }}}}",
        f"{{% macro m(x) %}}{inner}{{% endmacro %}}{{{{ m({_expression(rng)}) }}}}",
        f"{{% set ns = namespace(s={_expression(rng)}) %}}{{% for x in range(30) %}}{{% set ns.s = ns.s ~ ns.s %}}{inner}{{% endfor %}}",
        f"{{% filter {rng.choice(FILTERS)} %}}{inner}{{% endfilter %}}",
    ])  # fmt: skip


class _Templates:
    name = "template"

    def samples(self) -> list[str]:
        return list(SAMPLES)

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        text, done = SAMPLES[sample], []
        if rng is not None:
            match rng.randrange(4):
                case 0:
                    damaged = text_damaged(text.encode(), rng)
                    text, done = damaged.decode("utf-8", "replace"), ["bytes"]
                case 1:
                    attack = rng.choice(ATTACKS)
                    text, done = text + attack, [attack[:200]]
                case _:
                    lines = text.splitlines(keepends=True)
                    done = [_statement(rng) for _ in range(rng.randint(1, 2))]
                    for statement in done:
                        lines.insert(rng.randrange(len(lines) + 1), statement + "\n")
                    text = "".join(lines)
        (folder / "deck.inp.j2").write_bytes(text.encode("utf-8", "surrogatepass"))
        return done

    def read(self, folder: Path) -> None:
        template = TemplateText("deck.inp.j2", (folder / "deck.inp.j2").read_bytes().decode("utf-8", "replace"))
        nominal = {p.name: p.nominal for p in PARAMETERS}
        drive = Excitation("mass", "force", frequency=20.0, amplitude=1e-3, phase=0.5)
        values = deck_values(PARAMETERS, nominal, drive, Request(periods=2, samples=200), 3, 2)
        [text] = rendered([template], values)
        text.encode()
        check_names([template], [], {**{name: () for name in nominal}, **KNOWN})

    def readable(self, folder: Path) -> frozenset[str]:
        return frozenset()


TEMPLATE = _Templates()
