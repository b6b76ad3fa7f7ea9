"""Delimited text as columns."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.errors import CalibError
from calib.simulators.command.readers import lines, reader, rows

read = reader("delimited")


@pytest.fixture
def file(tmp_path):
    def write(text, encoding="utf-8"):
        path = tmp_path / "out.txt"
        path.write_bytes(text.encode(encoding))
        return path

    return write


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("t,x,v\n0,1,2\n0.5,3,4\n", {}),
        ("t;x;v\r\n0;1;2\r\n0.5;3;4", {}),
        ("# made\nt\tx\tv\n0\t1\t2\n0.5\t3\t4\n", {}),
        ("  t    x   v\n  0  1.0D+00  2.E0\n\n 5.d-1   3     4\n", {}),
        ("t;x;v\n0,0;1,0;2\n0,5;3;4\n", {"decimal": ","}),
        ("t x v\n0,0 1,0 2\n0,5 3 4\n", {"decimal": ","}),
        ("program 7\nof 2026\nt,x,v\n0,1,2\n0.5,3,4\n", {"skip": 2}),
        ("t,x,v\n[s],[mm],[mm/s]\n0,1,2\n0.5,3,4\n", {"header": 2}),
        ("time [s]  disp [mm]  v\n0 1 2\n.5 3 4\n", {"header": 1, "names": ["t", "x", "v"]}),
        ("! t x v\n0 1 2\n$ half\n.5 3 4\n", {"comment": "!$", "names": ["t", "x", "v"]}),
        ("x|v|t\n1|2|0\n3|4|0.5\n", {"separator": "|", "time": "t"}),
        ("x,v,t\n1,2,0\n3,4,0.5\n", {"time": 3}),
        ("t,x,v,\n0,1,2,\n0.5,3,4,\n", {}),
        ("t,note,x,v\n0,begins,1,2\n0.5,ends,3,4\n", {"columns": ["x", 4]}),
        ("x,v\n1,2\n3,4\n", {"step": 0.5}),
        ('"t","x","v"\n0,"1",2\n0.5,3,4\n', {}),
        ("0 1\t2\n0.5 3 4\n", {"separator": " ", "names": ["t", "x", "v"]}),
    ],
)
def test_columns_are_read_by_name(file, text, options):
    columns = read(file(text), **options)
    np.testing.assert_array_equal(columns.time, [0.0, 0.5])
    assert {name: list(column) for name, column in columns.values.items()} == {"x": [1.0, 3.0], "v": [2.0, 4.0]}


def test_columns_without_a_name_of_their_own_are_called_by_their_position(file):
    assert list(read(file("0 1 2\n1 2 3\n")).values) == ["2", "3"]
    assert list(read(file("t,x,x\n0,1,2\n")).values) == ["2", "3"]


def test_a_text_in_another_encoding(file):
    text = "t,µm\n0,1\n"
    assert list(read(file(text, "latin-1"), encoding="latin-1").values) == ["µm"]
    assert list(read(file(text, "utf-16"), encoding="utf-16").values) == ["µm"]
    with pytest.raises(CalibError, match="not a text in utf-8 .* state its encoding"):
        read(file(text, "latin-1"))
    with pytest.raises(CalibError, match="unknown encoding 'utf-7000'"):
        read(file(text), encoding="utf-7000")


def test_nan_and_infinities_are_passed_on(file):
    np.testing.assert_array_equal(read(file("t,x\n0,nan\n1,-Infinity\n")).values["x"], [np.nan, -np.inf])


@pytest.mark.parametrize(
    ("message", "text", "options"),
    [
        ("the file holds no rows", "", {}),
        ("expected rows of numbers, got none; did the program stop", "t,x\n", {}),
        ("line 3: expected 2 cells as in line 1, got 1", "t,x\n0,1\n1\n", {}),
        ("line 2: expected 2 cells, one for each name, got 3", "0 1\n1 2 3\n", {"names": ["t", "x"]}),
        ("line 2: expected a number in column 'x', got 'one'", "t,x\n0,one\n", {}),
        ("line 3: expected a number in column 'x', got a blank field", "t,x\n0,1\n1,\n", {}),
        ("line 2: .* '\\*\\*\\*\\*\\*\\*': the number overflowed its field", "t,x\n0,******\n", {}),
        ("line 1: .* overflowed its field", "0 ******\n1 2\n", {}),
        ("line 2: .* got '1_000'", "t,x\n0,1_000\n", {}),
        ("line 2: .* got '2020-001'", "t,x\n0,2020-001\n", {}),
        ("line 2: .* got '1,5'; if it is a decimal comma, set decimal = ','", "t;x\n0;1,5\n", {}),
        ("no single column 'X' \\(did you mean 'x'\\?\\); the columns, counted from 1, are t, x", "t,x\n0,1\n",
         {"columns": ["X"]}),
        ("no single column 7", "t,x\n0,1\n", {"time": 7}),
        ("either the column that is time or the step", "t,x\n0,1\n", {"time": 1, "step": 1.0}),
        ("separator and decimal are both ','", "t,x\n0,1\n", {"separator": ",", "decimal": ","}),
        ("two columns are called '2'", "2,2,\n0,1,2\n", {"header": 1, "columns": [1], "names": ["2", "", "x"]}),
        ("line 2: a quotation mark is not closed", 't,x\n0,"1\n2,3\n', {}),
    ],
)  # fmt: skip
def test_a_file_that_is_none_is_refused_with_its_line(file, message, text, options):
    with pytest.raises(CalibError, match=f"out.txt.*{message}"):
        read(file(text), **options)


def test_sizes_are_bounded(file, monkeypatch):
    path = file("0 1\n1 2\n")
    monkeypatch.setattr(rows, "MAX_VALUES", 3)
    with pytest.raises(CalibError, match="line 2: expected at most 3 numbers; have the program write fewer"):
        read(path)
    monkeypatch.setattr(lines, "MAX_LINE_CHARACTERS", 3)
    with pytest.raises(CalibError, match="line 1: expected at most 3 characters"):
        read(path)
    monkeypatch.setattr(lines, "MAX_TEXT_BYTES", 4)
    with pytest.raises(CalibError, match="expected at most .* MiB"):
        read(path)


def cell(value, exponent, decimal):
    return f"{value!r}".replace("e", exponent).replace(".", decimal)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # it may be the machine that is slow
@given(
    table=st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3), min_size=1),
    separator=st.sampled_from([";", "\t", "|", " "]),
    decimal=st.sampled_from(".,"),
    exponent=st.sampled_from("eEdD"),
)
def test_what_is_written_is_read_bit_for_bit(tmp_path_factory, table, separator, decimal, exponent):
    path = tmp_path_factory.getbasetemp() / "round_trip.txt"
    path.write_text("".join(separator.join(cell(v, exponent, decimal) for v in row) + "\n" for row in table))
    columns = read(path, separator=separator, decimal=decimal)
    np.testing.assert_array_equal([columns.time, *columns.values.values()], np.transpose(table))
