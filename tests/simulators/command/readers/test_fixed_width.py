"""Text in columns of fixed width, as Fortran writes it."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calib.errors import CalibError
from calib.simulators.command.readers import check_options, reader

read = reader("fixed_width")


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "out.txt"
        path.write_text(text)
        return path

    return write


def test_adjoining_numbers_and_exponents_without_a_letter_are_read(file):
    path = file("  t         x\n# comment\n 0.0-1.234-105 1.0D+03\n\n 0.5 2.000E+00-1.0D-03\n")
    columns = read(path, widths=[4, 10, 8], skip=1, names=["t", "x", "v"])
    np.testing.assert_array_equal(columns.time, [0.0, 0.5])
    np.testing.assert_array_equal(columns.values["x"], [-1.234e-105, 2.0])
    np.testing.assert_array_equal(columns.values["v"], [1e3, -1e-3])


def test_columns_are_called_by_their_position_and_chosen_so(file):
    path = file("tip 1.0 2.0\nmid 3.0 4.0\n")
    columns = read(path, widths=[4, 4, 4], columns=[3], time=2)
    assert list(columns.values) == ["3"]
    np.testing.assert_array_equal(columns.time, [1.0, 3.0])
    np.testing.assert_array_equal(read(path, widths=[4, 4, 4], columns=[3], step=0.5).time, [0.0, 0.5])


@pytest.mark.parametrize("name", ["fixed_width", "delimited"])
def test_headers_within_a_table_and_a_log_after_it_are_passed_over(file, name):
    text = "    TIME   DISP\n 0.0 1.0\n1  KNOCK 2.3 PAGE 2\n    TIME   DISP\n 1.0 2.0\n LOG: END OF RUN\n"
    widths = {"widths": [4, 4]} if name == "fixed_width" else {"names": ["t", "x"]}
    columns = reader(name)(file(text), comment=["TIME", "LOG:", "/KNOCK .* PAGE/"], **widths)
    np.testing.assert_array_equal(columns.time, [0.0, 1.0])
    with pytest.raises(CalibError, match=r"""line 6: .*; if the line is no row, .* comment = \["LOG:"\]"""):
        reader(name)(file(text), comment=["TIME", "/PAGE/"], **widths)


@pytest.mark.parametrize("name", ["fixed_width", "delimited"])
def test_comments_are_checked_before_there_is_a_file(name):
    widths = {"widths": [4]} if name == "fixed_width" else {}
    with pytest.raises(CalibError, match=r"option 'comment' of the reader '\w+': '/\(/' is no regular expression"):
        check_options(name, {"comment": ["/(/"], **widths})


@pytest.mark.parametrize(
    ("message", "text", "options"),
    [
        ("line 1: .*column '2', got '\\*\\*\\*\\*': the number overflowed its field", " 1.0****\n", {}),
        ("line 2: .*column '2', got a blank field; is the line cut off", " 1.0 2.0\n 1.0\n", {}),
        ("line 1: expected a number in column '2', got 'x'", " 1.0   x\n", {}),
        ("line 1: expected 2 columns of together 8 characters, got 12", " 1.0 2.0 3.0\n", {}),
        ("expected rows of numbers, got none", "", {}),
        ("expected 2 names, one for each width, got 1", " 1.0 2.0\n", {"names": ["t"]}),
        ("two columns are called '2'", " 1.0 2.0\n", {"names": ["2", ""]}),
    ],
)
def test_a_file_that_is_none_is_refused_with_its_line(file, message, text, options):
    with pytest.raises(CalibError, match=f"out.txt.*{message}"):
        read(file(text), widths=[4, 4], **options)


@pytest.mark.parametrize("widths", [[], [0, 4], [4.0], "44"])
def test_widths_are_numbers_of_characters(widths):
    with pytest.raises(CalibError, match="option 'widths'"):
        check_options("fixed_width", {"widths": widths})


def test_widths_are_required():
    with pytest.raises(CalibError, match="the reader 'fixed_width' needs widths"):
        check_options("fixed_width", {})


def fortran(value, width, digits):
    """Write as Fortran's edit descriptor 1P,Ew.d does."""
    mantissa, _, exponent = f"{value:.{digits}E}".partition("E")
    tail = f"E{int(exponent):+03d}" if abs(int(exponent)) < 100 else f"{int(exponent):+04d}"
    field = mantissa + tail
    return field.rjust(width) if len(field) <= width else "*" * width


@settings(max_examples=50)
@given(
    table=st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3), min_size=1),
    width=st.integers(12, 24),
    digits=st.integers(2, 17),
)
def test_what_fortran_writes_is_read_to_its_digits_or_refused(tmp_path_factory, table, width, digits):
    path = tmp_path_factory.getbasetemp() / "fixed_width.txt"
    fields = [[fortran(value, width, digits) for value in row] for row in table]
    path.write_text("".join("".join(row) + "\n" for row in fields))
    expected = [[float(f"{value:.{digits}E}") for value in row] for row in table]
    assume(all(math.isfinite(value) for row in expected for value in row))
    if any("*" in field for row in fields for field in row):
        with pytest.raises(CalibError, match="overflowed its field"):
            read(path, widths=[width] * 3)
    else:
        columns = read(path, widths=[width] * 3)
        np.testing.assert_array_equal([columns.time, *columns.values.values()], np.transpose(expected))
