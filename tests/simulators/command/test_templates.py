"""Templates: what they may name, what they may not do."""

import math
import pickle

import numpy as np
import pytest

from calib.errors import CalibError
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.command.deck import KNOWN, deck_values
from calib.simulators.command.quantities import declared_parameters
from calib.simulators.command.templates import TemplateFault, TemplateText, check_names, rendered

PARAMETERS = declared_parameters({"youngs": "70 GPa", "gap": "1 mm", "ratio": 0.3})
DRIVE = Excitation("tip", "base motion", frequency=20.0, amplitude=1e-3, phase=0.5)


def values(excitation=DRIVE, settle=3, **request):
    nominal = {p.name: p.nominal for p in PARAMETERS}
    return deck_values(PARAMETERS, nominal, excitation, Request(**{"periods": 2, "samples": 10, **request}), settle, 2)


def deck(text, **more):
    [content] = rendered([TemplateText("deck.inp.j2", text)], values(**more))
    return content


def checked(text, parameters=("youngs",)):
    check_names([TemplateText("deck.inp.j2", text)], list(parameters), KNOWN)


def test_parameters_have_the_si_unit_of_their_quantity():
    assert [(p.name, p.unit, p.nominal) for p in PARAMETERS] == [
        ("youngs", "Pa", 70e9), ("gap", "m", 1e-3), ("ratio", "1", 0.3),
    ]  # fmt: skip


def test_a_placeholder_is_the_value_in_si_with_all_its_digits():
    assert deck("{{ youngs }} {{ gap }}") == "70000000000.0 0.001"


def test_a_value_is_converted_and_formatted():
    assert deck('E={{ youngs | unit("MPa") | fortran("E12.5") }}') == "E= 0.70000E+05"
    assert deck('{{ gap | unit("mm") | fixed(8) }}') == "      1."


def test_arithmetic_gives_plain_numbers_whose_unit_is_taken_as_coherent():
    assert deck('{{ (youngs * (1 + ratio)) | unit("GPa") }}') == "91.0"


def test_a_harmonic_input_becomes_a_table():
    text = '{{ (excitation.omega * 0.0125 + excitation.phase) | cos | fortran("F9.6") }} {{ 0 | sin }}'
    assert deck(text) == f"{math.cos(0.5 * math.pi + 0.5):9.6f} 0.0"


@pytest.mark.parametrize("angle", ["'x'", "true", "(1e300 * 1e300)"])
def test_sine_and_cosine_take_angles(angle):
    with pytest.raises(CalibError, match="expected an angle in radians"):
        deck(f"{{{{ {angle} | sin }}}}")


def test_a_number_beyond_all_others_is_refused():
    with pytest.raises(CalibError, match=r"deck.inp.j2:1: cannot be rendered: NameError"):
        deck("{{ 1e999 + youngs }}")


def test_a_unit_of_another_dimension_is_refused():
    with pytest.raises(CalibError, match=r"deck.inp.j2:2: youngs is in Pa and is not given in 'mm': .*; in {{ y"):
        deck('\n{{ youngs | unit("mm") }}')
    with pytest.raises(CalibError, match=r"excitation.omega is in rad/s and .* 'Hz': .*hertz counts cycles"):
        deck('{{ excitation.omega | unit("Hz") }}')


def test_an_unknown_unit_is_answered_with_the_nearest():
    with pytest.raises(CalibError, match=r"unknown unit 'mmm' .*did you mean 'mm'\?"):
        deck('{{ gap | unit("mmm") }}')


def test_a_fault_names_the_placeholders_of_its_line():
    with pytest.raises(TemplateFault, match=r"""deck.inp.j2:3: 70000.0 does not fit F6.5: .*; in {{ gap }}{{ youngs"""):
        deck("{{ ratio }}\n\n{{ gap }}{{ youngs | unit('MPa') | fortran('F6.5') }}\n{{ cores }}")
    with pytest.raises(TemplateFault) as fault:
        deck("{{ ratio }}\n\n{{ gap }}{{ youngs | unit('MPa') | fortran('F6.5') }}\n{{ cores }}")
    assert fault.value.names == {"gap", "youngs"}


def test_loops_and_conditions_leave_no_empty_lines():
    text = "{% for i in range(3) %}\n*NODE {{ i }}\n{% if i == 1 %}\nmiddle\n{% endif %}\n{% endfor %}\nend\n"
    assert deck(text) == "*NODE 0\n*NODE 1\nmiddle\n*NODE 2\nend\n"


def test_excitation_and_request_are_there():
    text = "{{ excitation.frequency }} {{ excitation.amplitude }} {{ excitation.phase }} {{ excitation.omega }}"
    assert [float(word) for word in deck(text).split()] == [20.0, 1e-3, 0.5, pytest.approx(2.0 * math.pi * 20.0)]
    assert deck("{{ excitation.quantity }} at {{ excitation.place }}") == "base motion at tip"
    words = deck("{{ request.periods }} {{ request.settle }} {{ request.start }} {{ request.end }} {{ request.step }}")
    assert [float(word) for word in words.split()] == [2, 3, 0.15, 0.25, pytest.approx(0.005)]
    assert len(deck("{% for t in request.times %}{{ t }}\n{% endfor %}").split()) == 20
    assert deck("{{ cores }}") == "2"


def test_a_recorded_input_is_a_table():
    recorded = Excitation("tip", "force", time=np.array([0.0, 0.1, 0.2]), value=np.array([1.0, -1.0, 0.5]))
    text = "{% for s in excitation.samples %}{{ s.time }}, {{ s.value }}\n{% endfor %}"
    assert deck(text, excitation=recorded) == "0.0, 1.0\n0.1, -1.0\n0.2, 0.5\n"
    assert deck("{{ excitation.value | length }}", excitation=recorded) == "3"
    assert deck("{% if excitation.recorded %}AMPLITUDE{% endif %}", excitation=recorded) == "AMPLITUDE"
    with pytest.raises(CalibError, match="'frequency'"):
        deck("{{ excitation.frequency }}", excitation=recorded)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a\n{{ yuongs }}", r"deck.inp.j2:2: unknown placeholder 'yuongs' \(did you mean 'youngs'\?\)"),
        ("{{ youngs }}{{ excitation.freqency }}", r"deck.inp.j2:1: excitation has no 'freqency' \(did you mean"),
        ("{{ youngs }}{{ request['perids'] }}", r"request has no 'perids'"),
        ("{{ youngs }}{{ cores.x }}", "cores has no 'x'"),
        ("nothing", "youngs: no placeholder of deck.inp.j2 names it"),
        ("{{ youngs | fotran('E12.5') }}", "this is no template: No filter named 'fotran'"),
        ("{{ youngs ", "this is no template"),
        ("{% for i in range(3) %}", "this is no template"),
        ("{{ youngs }}{% include 'other' %}", "cannot be rendered|no loader"),
        ("{{ " + "(" * 3000 + "youngs" + ")" * 3000 + " }}", "deck.inp.j2"),
    ],
)
def test_a_mistake_is_refused_with_its_line(text, reason):
    with pytest.raises(CalibError, match=reason):
        _ = checked(text), deck(text)


def test_names_that_a_template_sets_itself_are_known():
    checked("{% set n = 3 %}{% for i in range(n) %}{{ i * youngs }}{{ loop.index }}{% endfor %}")


@pytest.mark.parametrize(
    "text",
    [
        "{{ youngs.__class__ }}", "{{ excitation.quantity.upper() }}", "{{ ''.__class__.__mro__ }}",
        "{{ 'x' * 999999999 }}", "{{ 9 ** (9 ** 9) }}", "{{ '%999999999d' % 5 }}",
        "{{ 'x'.center(999999999) }}", "{{ [0] * 999999999 }}", "{{ 1 / 0 }}", "{{ none }}", "{{ youngs > 1 }}",
        "{{ excitation }}", "{{ 1e308 * 10 | fortran('E12.5') }}", "{{ cycler }}", "{{ youngs | attr('unit') }}",
        "{{ 99999999999999999999 ** 9999 }}", "{% set n = namespace(x=1) %}{{ n.__init__ }}", "{{ range }}",
    ],
)  # fmt: skip
def test_what_is_no_deck_is_refused(text):
    with pytest.raises(CalibError, match="deck.inp.j2"):
        deck(text)


LOOPS = "".join(f"{{% for {name} in b %}}" for name in "acdefg") + "{% endfor %}" * 6


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{% set b = range(300) | list %}" + LOOPS, "more than 1 s"),
        (
            "{% macro m(n) %}{% if n > 0 %}{{ m(n - 1) }}{{ m(n - 1) }}{% endif %}{% endmacro %}{{ m(60) }}",
            "more than 1 s",
        ),
        ("{{ 1.5 | round(10**9, 'ceil') }}", "more than 1 s|MemoryError"),
        ("{% set n = namespace(s=[1]) %}{% for i in range(60) %}{% set n.s = n.s + n.s %}{% endfor %}", "MemoryError"),
        ("{% set n = namespace(s='ab') %}{% for i in range(60) %}{% set n.s = n.s ~ n.s %}{% endfor %}", "MemoryError"),
        ("{{ [1] | batch(10**9, 0) | list }}", "MemoryError"),
    ],
)
def test_a_rendering_takes_so_much_time_and_memory(monkeypatch, text, reason):
    monkeypatch.setattr("calib.simulators.command.templates.MAX_RENDERING_SECONDS", 1)
    monkeypatch.setattr("calib.simulators.command.templates.MAX_RENDERING_BYTES", 2**26)
    with pytest.raises(CalibError, match=f"deck.inp.j2.*({reason})"):
        deck(text)


@pytest.mark.parametrize(
    "text",
    [
        "{{ [1] }}", "{{ '9' * 500 | int }}", "{{ '{:>999999999}'.format(1) }}", "{{ loop.changed([1]) }}",
        "{{ 2**4000 + 2**4096 }}", "{{ '\\ud800' }}",
    ],
)  # fmt: skip
def test_what_is_no_text_of_a_deck_is_refused(text):
    with pytest.raises(CalibError, match="deck.inp.j2"):
        deck(text)


def test_lists_are_batched_sliced_joined_and_compared_by_their_elements():
    assert deck("{% for r in [1, 2, 3] | batch(2, 0) %}{{ r | join(',') }};{% endfor %}") == "1,2;3,0;"
    assert deck("{% for r in [1, 2, 3] | slice(2, 0) %}{{ r | join(',') }};{% endfor %}") == "1,2;3,0;"
    assert deck("{{ 2 if 2 in [1, 2] }} {{ [1, 5, 2] | max }} {{ [0.5, 1] | sum }} {{ 'a' ~ 1 }}") == "2 5 1.5 a1"
    assert deck("{{ 7.26 | round(1, 'floor') }} {{ 7.26 | round(1) }}") == "7.2 7.3"


def test_a_loop_may_count_in_a_namespace():
    text = "{% set n = namespace(total=0) %}{% for i in range(4) %}{% set n.total = n.total + i %}{% endfor %}"
    assert deck(text + "{{ n.total }}") == "6"


def test_a_value_that_does_not_fit_its_field_is_refused():
    with pytest.raises(CalibError, match="deck.inp.j2:1: .* does not fit F8.3"):
        deck('{{ youngs | fortran("F8.3") }}')


def test_texts_of_templates_survive_a_pickle():
    text = TemplateText("a.j2", "{{ gap }}")
    assert rendered([pickle.loads(pickle.dumps(text))], values()) == ["0.001"]


@pytest.mark.parametrize(
    ("stated", "reason"),
    [
        ({"a b": 1.0}, "letters, digits"),
        ({"a": "1 furlong per"}, "a"),
        ({"a": {"nominal": "1 mm", "lo": 0}}, r"unknown key 'lo' \(did you mean 'low'\?\)"),
        ({"a": {"low": 0}}, "nominal is missing"),
        ({"a": {"nominal": "1 mm", "low": "2 mm"}}, "outside"),
        ({"a": {"nominal": "1 mm", "low": "2 s"}}, "given in m"),
        ({"a": True}, "a number or a text with a unit"),
        ({"a": "inf"}, "finite"),
        ("gap", "expected a table"),
    ],
)
def test_a_parameter_that_is_none_is_refused(stated, reason):
    with pytest.raises(CalibError, match=reason):
        declared_parameters(stated)


def test_bounds_null_and_meaning_of_a_parameter_are_taken():
    [p] = declared_parameters({"c": {"nominal": "5 N s/m", "low": 0, "null": 0, "meaning": "damping"}})
    assert (p.unit, p.nominal, p.low, p.null, p.meaning) == ("N s/m", 5.0, 0.0, 0.0, "damping")
