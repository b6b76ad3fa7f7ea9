"""Quantities as people write them."""

import contextlib
import math
import re
import time

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from calib.errors import CalibError
from calib.units import count, in_si, shown, to_si


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("1 mm", "m", 1e-3),
        ("35.15 N/V", "N/V", 35.15),
        ("90 deg", "rad", math.pi / 2),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("26 kHz", "Hz", 26000.0),
        ("1 kip", "N", 4448.2216152605),
        ("5 N s/m", "N s/m", 5.0),
        ("3 %", "1", 0.03),
        ("2", "", 2.0),
        ("-1.5e-3 m", "m", -1.5e-3),
        ("inf m", "m", math.inf),
        ("(2 m/V) * (3 mV)", "m", 6e-3),
        ("\u22121.5e\u22123 m", "m", -1.5e-3),  # the minus sign of a word processor
        ("3 m s-1", "m/s", 3.0),
        ("7850 kg m\u22123", "kg/m^3", 7850.0),
        ("5 N·s/m", "N s/m", 5.0),
        ("1/2 in", "m", 0.0127),
        ("5 (mm)", "m", 5e-3),
        ("1 deg * (-1.0)", "rad", -math.pi / 180.0),
        ("0.25 turn", "rad", math.pi / 2),
        ("1 N m/turn", "N m/rad", 0.5 / math.pi),
    ],
)
def test_a_text_becomes_its_si_number(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("number", [3, 0.25, -math.inf])
def test_a_bare_number_is_si_already(number):
    assert to_si(number, "m") == number


@pytest.mark.parametrize(
    ("text", "unit"),
    [("26.24 Hz", "rad/s"), ("26.24 Hz", "1/s"), ("164.9 rad/s", "Hz"), ("60 rpm", "1/s"), ("5 1/s", "Hz"),
     ("26 cycle/s", "1/s"), ("26 revolution/s", "1/s"), ("1560 rev/min", "1/s"), ("5 rad/s", "turn/s"),
     ("26 rev/s", "Hz^2 s"), ("26 Hz", "rpm")],
)  # fmt: skip
def test_hertz_is_never_converted_to_another_rate(text, unit):
    with pytest.raises(CalibError, match="hertz counts cycles"):
        to_si(text, unit)


@pytest.mark.parametrize("text", ["1500 rev/min", "1500 rpm", "25 rev/s", "25 turn/s", "25 cycle/s", "90000 rev/h"])
@pytest.mark.parametrize(("unit", "value"), [("rad/s", 50.0 * math.pi), ("Hz", 25.0)])
def test_a_speed_of_rotation_is_an_angular_velocity_and_a_frequency(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("2 N/rpm", "N/Hz", 120.0),
        ("2 N/rpm", "N s/rad", 60.0 / math.pi),
        ("3 mm s/rev", "m/Hz", 3e-3),
        ("1 rev/s^2", "rad/s^2", 2.0 * math.pi),
        ("1 rev/s^2", "Hz/s", 1.0),
    ],
)
def test_units_that_contain_a_speed_of_rotation_are_converted_too(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


def test_a_column_in_revolutions_a_minute_has_a_factor():
    assert in_si("rpm", "Hz") == pytest.approx(1.0 / 60.0)
    assert in_si("rev/min") == in_si("rpm") == pytest.approx(math.pi / 30.0)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("5 mm +- 1 mm", "m", "as in '5 m', got '5 mm +- 1 mm', a number with its uncertainty"),  # would be 4 mm
        ("5 mm +/- 1 mm", "m", "a number with its uncertainty"),
        ("5 mm ± 1 mm", "m", "a number with its uncertainty"),
        ("5.00(2) mm", "m", "got '5.00(2) mm', a number with its uncertainty"),  # would be 10 mm
        ("1.5(3) kN/m", "N/m", "a number with its uncertainty"),
        ("26.24(1) Hz", "Hz", "a number with its uncertainty"),
        ("1 1/2 in", "m", "two numbers"),  # would be half an inch
        ("2 1/2", "1", "two numbers"),
        ("1-1/2 in", "m", "a sum or a difference"),
        ("2-3 mm", "m", "a sum or a difference"),
        ("5 mm - 1 mm", "m", "a sum or a difference"),
    ],
)
def test_a_text_with_more_than_one_number_is_never_worked_out(text, unit, says):
    with pytest.raises(CalibError, match=re.escape(says)):
        to_si(text, unit)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("1 Nm", "N m", "'N m' for 'Nm'"),  # the registry has a unit Nm, of yarn
        ("1 kNm/rad", "N m/rad", "'kN m' for 'kNm'"),
        ("1 Nmm", "N m", "unknown unit 'Nmm' in '1 Nmm'; write a product of units with a blank, 'N mm' for 'Nmm'"),
        ("1 Ns/m", "N s/m", "'N s' for 'Ns'"),
    ],
)
def test_a_product_without_a_blank_is_answered_with_the_blank(text, unit, says):
    with pytest.raises(CalibError, match=re.escape(says)):
        to_si(text, unit)


@pytest.mark.parametrize(
    ("text", "unit", "value"), [("3 1/s", "1/s", 3.0), ("3 1", "1", 3.0), ("0.5 1 / m", "1/m", 0.5)]
)
def test_the_one_of_a_reciprocal_is_no_second_number(text, unit, value):
    assert to_si(text, unit) == value


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("1 mm", "s", "can be given in s"),
        ("1 mm", "1", "can be given in 1"),
        ("5 milimeter", "m", "did you mean 'millimeter'"),
        ("0.5", "m", "write '0.5 m'"),
        ("1,5 mm", "m", "expected something like '1 m'"),  # would be read as 15 mm
        ("1 500 mm", "m", "two numbers"),  # would be read as 500 mm
        ("12 500 N/m", "N/m", "two numbers"),
        ("1\u202f500 mm", "m", "two numbers"),
        ("1 mm 2", "m", "two numbers"),
        ("mm", "m", "expected something like '1 m'"),
        ("", "m", "expected something like '1 m'"),
        ("1 m *", "m", "expected something like '1 m'"),
        ("1 (", "m", "expected something like '1 m'"),
        ("1/0 m", "m", "expected something like '1 m'"),
        ("20 degC", "K", "expected something like '1 K'"),
        ("nan m", "m", "expected a number of m"),
        (math.nan, "m", "expected a number of m"),
        (True, "m", "a number or a text with a unit"),
        ([1.0], "m", "a number or a text with a unit"),
    ],
)
def test_a_mistake_is_answered_with_what_was_expected(text, unit, says):
    with pytest.raises(CalibError, match=says.replace("(", r"\(")):
        to_si(text, unit)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("9**9**9 m", "an exponent is one number"),
        ("1e9**1e9 m", "an exponent is one number"),
        ("9^(9^9^9) m", "an exponent is one number"),
        ("9 cubed cubed cubed m", "unknown unit 'cubed'"),
        ("9⁹⁹⁹⁹⁹⁹⁹⁹⁹ m", "exceeds the bound of 1000"),
        ("9**999999999 m", "exceeds the bound of 1000"),
        ("2 m^1e300", "an exponent is one number"),
        ("1 * ((((9**9)**9)**9)**9) m", "exceeds the bound of 1000"),
        ("9**999 m", "can be represented"),
        ("(-1)**0.5 m", "can be represented"),
        ("1 " + "m*" * 10**6 + "m", "2000003 characters"),
        ("1" * 101, "exceeds the bound of 100"),
    ],
)
def test_what_would_take_long_is_refused_at_once(text, says):
    to_si("1 m", "m")  # the registry is read once
    begin = time.monotonic()
    with pytest.raises(CalibError, match=says):
        to_si(text, "m")
    assert time.monotonic() - begin < 2.0


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [("2 mm²", "m^2", 2e-6), ("2 mm^(2)", "m^2", 2e-6),
     ("4 mm ** -1", "1/m", 4e3), ("3 km^(1/2)", "m^0.5", 3 * 1e3**0.5),
     ("1 kg^2 m^4 / s^3 / A^2", "kg^2*m^4/(s^3*A^2)", 1.0), ("(2 mm)**2", "m^2", 4e-6)],
)  # fmt: skip
def test_powers_of_units_are_read(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


PIECES = ("m", "s", "Hz", "degC", "dB", "kg", "%", "µm", "squared", "cubed", "per", "9", "1e9", ".5", "1e999", "inf",
          "nan", "0", "**", "^", "*", "/", "//", "(", ")", "+", "-", "²", "⁹", " ", "_", ".", "e", "j",
          "if")  # fmt: skip


@pytest.mark.slow
@settings(max_examples=400, deadline=5000, database=None)
@given(
    text=st.lists(st.sampled_from(PIECES), max_size=14).map("".join) | st.text(max_size=20),
    unit=st.sampled_from(["m", "1", "rad/s", "K", "V/Hz^0.5"]),
)
@example(text="9**9**9", unit="m")
def test_any_text_is_a_number_or_a_mistake(text, unit):
    for quantity in (text, f"1{text}", f"1 {text}"):
        with contextlib.suppress(CalibError):
            assert not math.isnan(to_si(quantity, unit))


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.5e-3, "m", "1.5 mm"),
        (0.2, "1", "0.2"),
        (26.24, "Hz", "26.24 Hz"),
        (None, "m", "-"),
        (9.38e-8, "s", "0.0938 us"),
        (-3e-6, "m", "-3 um"),
        (0.0, "s", "0 ms"),
        (0.99994, "m", "999.9 mm"),
        (0.99996, "m", "1 m"),
        (-0.99996, "s", "-1 s"),
        (9.9999e-6, "m", "0.01 mm"),
        (1e4, "N/m", "10000 N/m"),
        (9999.7, "N/m", "10000 N/m"),
        (-12345.6, "N/m", "-12346 N/m"),
        (99949.6, "Pa", "99950 Pa"),
        (99999.6, "Pa", "1e+05 Pa"),
        (123456.0, "Pa", "1.235e+05 Pa"),
        (0.001, "1/s", "0.001 1/s"),
        (math.inf, "1/s", "inf 1/s"),
    ],
)
def test_values_are_shown_in_units_that_people_read(value, unit, text):
    assert shown(value, unit) == text


def test_one_thing_is_no_plural():
    assert [count(n, "trial") for n in (0, 1, 2)] == ["0 trials", "1 trial", "2 trials"]
