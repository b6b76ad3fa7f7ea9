"""Numbers as decks take them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import CalibError
from calib.simulators.command.formats import fixed, fortran


@pytest.mark.parametrize(
    ("value", "descriptor", "text"),
    [
        (70e9, "E12.5", " 0.70000E+11"),
        (-70e9, "E12.5", "-0.70000E+11"),
        (0.0, "E12.5", " 0.00000E+00"),
        (9.999999e-5, "E10.3", " 0.100E-03"),
        (1.0, "D12.5", " 0.10000D+01"),
        (1.0, "ES12.5", " 1.00000E+00"),
        (1e100, "E12.5", " 0.10000+101"),
        (1e-200, "E14.5E3", "  0.10000E-199"),
        (1.5, "F8.3", "   1.500"),
        (-0.25, "F4.2", "-.25"),
        (0.25, "F3.2", ".25"),
        (-70e9, "E11.5", "-.70000E+11"),
        (7.0, "I5", "    7"),
        (-7, "I5.3", " -007"),
        (3.0000000000001, "I2", " 3"),
        (1.0, "e12.5", " 0.10000E+01"),
    ],
)
def test_a_number_is_written_as_fortran_writes_it(value, descriptor, text):
    assert fortran(value, descriptor) == text


@pytest.mark.parametrize(
    ("value", "descriptor", "reason"),
    [
        (-70e9, "E10.5", "does not fit E10.5"),
        (1234.5, "F6.3", "does not fit"),
        (1.5, "I5", "a whole number"),
        (123456, "I5", "does not fit"),
        (float("nan"), "E12.5", "a finite number"),
        ("7", "E12.5", "a finite number"),
        (1.0, "G12.5", "a descriptor such as"),
        (1.0, "E12", "digits behind the point"),
        (1.0, "E999.1", "a width from 1 to"),
        (1e300, "E12.5E1", "an exponent of 1 digit"),
    ],
)
def test_what_does_not_fit_is_refused_where_fortran_writes_asterisks(value, descriptor, reason):
    with pytest.raises(CalibError, match=reason):
        fortran(value, descriptor)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_seventeen_digits_give_every_double_back(value):
    text = fortran(value, "E26.17E3")
    assert float(text) == value


@given(st.floats(min_value=-1e90, max_value=1e90), st.integers(8, 20))
def test_a_fixed_field_has_its_width_and_the_digits_that_it_takes(value, width):
    text = fixed(value, width)
    assert len(text) == width
    digits = width - 7  # sign, point, E and exponent of up to three characters, one digit before the point
    assert float(text) == pytest.approx(value, rel=10.0 ** (1 - digits), abs=1e-300)


@pytest.mark.parametrize(
    ("value", "width", "text"),
    [
        (2.1e11, 8, "  2.1E11"),
        (0.3, 8, "      .3"),
        (1.0, 8, "      1."),
        (-1.234567e-5, 8, "-1.23E-5"),
        (7, 8, "       7"),
        ("STEEL", 8, "   STEEL"),
        (123456.789, 8, "123456.8"),
    ],
)
def test_a_fixed_field_has_a_decimal_point(value, width, text):
    assert fixed(value, width) == text


def test_a_fixed_field_may_begin_on_the_left():
    assert fixed(1.5, 6, "left") == "1.5   "


@pytest.mark.parametrize(("value", "width"), [("too long a name", 8), (-1.5e-100, 6), (123456789, 8), (1.0, 0)])
def test_what_does_not_fit_a_field_is_refused(value, width):
    with pytest.raises(CalibError, match="fixed|does not fit"):
        fixed(value, width)
