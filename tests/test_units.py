"""Quantities as people write them."""

import math

import pytest

from calib.errors import CalibError
from calib.units import shown, to_si


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
    ],
)
def test_a_text_becomes_its_si_number(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("number", [3, 0.25, -math.inf])
def test_a_bare_number_is_si_already(number):
    assert to_si(number, "m") == number


@pytest.mark.parametrize(
    ("text", "unit"),
    [("26.24 Hz", "rad/s"), ("26.24 Hz", "1/s"), ("164.9 rad/s", "Hz"), ("60 rpm", "Hz"), ("5 1/s", "Hz")],
)
def test_hertz_is_never_converted_to_another_rate(text, unit):
    with pytest.raises(CalibError, match="hertz counts cycles"):
        to_si(text, unit)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("1 mm", "s", "can be given in s"),
        ("1 mm", "1", "can be given in 1"),
        ("5 milimeter", "m", "did you mean 'millimeter'"),
        ("0.5", "m", "write '0.5 m'"),
        ("1,5 mm", "m", "expected something like '1 m'"),  # would be read as 15 mm
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
    ("value", "unit", "text"),
    [
        (1.5e-3, "m", "1.5 mm"),
        (0.2, "1", "0.2"),
        (26.24, "Hz", "26.24 Hz"),
        (None, "m", "-"),
        (9.38e-8, "s", "0.0938 us"),
        (-3e-6, "m", "-3 um"),
        (0.0, "s", "0 ms"),
    ],
)
def test_values_are_shown_in_units_that_people_read(value, unit, text):
    assert shown(value, unit) == text
