"""Nodal results of CalculiX, in text and in binary."""

from contextlib import suppress

import numpy as np
import pytest
from calculix_deck import BINARY, FILED, INCREMENTS, PRINTED, solve

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("calculix_frd")

TEXT = """    1C
  100CL  101 1.00000E-05           2                     0    1           1
 -4  DISP        4    1
 -5  D1          1    2    1    0
 -5  D2          1    2    2    0
 -5  D3          1    2    3    0
 -5  ALL         1    2    0    0    1ALL
 -1         2 1.17251E-03 2.22245E-04 1.26675E-02
 -1        17-1.38177E-03-1.46850E-04         NaN
 -3
 9999
"""
SHORT = TEXT.replace("           1\n -4", "           0\n -4").replace(" -1         ", " -1    ").replace(
    " -1        17", " -1   17"
)  # fmt: skip
WITHOUT_ALL = TEXT.replace(" -5  ALL         1    2    0    0    1ALL\n", "")
IMAGINARY = TEXT.replace(" 9999\n", "") + TEXT.replace("DISP ", "DISPI").replace("    1C\n", "")


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    return solve(tmp_path_factory.mktemp("text"), PRINTED, FILED)


@pytest.fixture(scope="module")
def binary(tmp_path_factory):
    return solve(tmp_path_factory.mktemp("binary"), BINARY).with_suffix(".frd")


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "deck.frd"
        path.write_text(text)
        return path

    return write


def test_nodal_results_are_those_that_calculix_prints(solved):
    nodal, printed = read(solved.with_suffix(".frd")), reader("calculix_dat")(solved.with_suffix(".dat"))
    np.testing.assert_allclose(nodal.time, printed.time, rtol=1e-5)
    for name, other in (("17.D3", "NTIP.U3"), ("17.V1", "NTIP.V1"), ("2.D2", "NTWO:2.U2")):
        np.testing.assert_allclose(nodal.values[name], printed.values[other], rtol=1e-5)


def test_binary_results_are_those_in_text(solved, binary):
    text, numbers = read(solved.with_suffix(".frd")), read(binary)
    assert {"2.D1", "17.V3", "17.F2"} <= set(numbers.values) <= set(text.values)
    assert numbers.time.size == INCREMENTS
    for name in ("2.D1", "17.V3"):
        np.testing.assert_allclose(numbers.values[name], text.values[name], rtol=1e-5)


@pytest.mark.parametrize("chosen", [["17.D3", "2.V1"], ["2.VELO.V1", "17.DISP.D3"]])
def test_columns_are_chosen_by_node_and_component(solved, binary, chosen):
    for path in (solved.with_suffix(".frd"), binary):
        columns = read(path, columns=chosen)
        assert list(columns.values) == chosen
        everything = read(path).values
        for name in chosen:
            node, *_, component = name.split(".")
            np.testing.assert_array_equal(columns.values[name], everything[f"{node}.{component}"])


@pytest.mark.parametrize("text", [TEXT, SHORT])
def test_the_long_and_the_short_format_are_read_and_nan_is_passed_on(file, text):
    columns = read(file(text))
    np.testing.assert_array_equal(columns.time, [1e-5])
    assert {name: float(column[0]) for name, column in columns.values.items() if name != "17.D3"} == {
        "2.D1": 1.17251e-03, "2.D2": 2.22245e-04, "2.D3": 1.26675e-02, "17.D1": -1.38177e-03, "17.D2": -1.46850e-04,
    }  # fmt: skip
    assert np.isnan(columns.values["17.D3"][0])


def test_components_of_two_datasets_are_called_with_the_dataset(file):
    assert list(read(file(IMAGINARY)).values)[::6] == ["2.DISP.D1", "2.DISPI.D1"]
    with pytest.raises(CalibError, match="no column '2.D1'; the components are DISP.D1, DISPI.D1, DISP.D2"):
        read(file(IMAGINARY), columns=["2.D1"])


def test_more_than_six_numbers_continue_on_the_next_line(file):
    components = "".join(f" -5  C{i}          1    1    0    0\n" for i in range(1, 9))
    head = TEXT[: TEXT.index(" -4")] + " -4  MANY        8    1\n" + components
    row = "".join(f"{i:12.5E}" for i in range(1, 7))
    more = " -2" + 10 * " " + "".join(f"{i:12.5E}" for i in range(7, 9))
    path = file(f"{head} -1         2{row}\n{more}\n -3\n")
    assert [float(column[0]) for column in read(path).values.values()] == list(range(1, 9))


@pytest.mark.parametrize(
    ("message", "text", "options"),
    [
        ("expected results of \\*NODE FILE, got none", "", {}),
        ("no column '3.D1'; the components are D1, D2, D3, and the nodes 2, 17", TEXT, {"columns": ["3.D1"]}),
        ("expected a column such as '17.D3', node and component, got 'NTIP.U3'", TEXT, {"columns": ["NTIP.U3"]}),
        ("line 9: expected a line with an end, got one that is cut off", TEXT[: TEXT.index("E-04         NaN")], {}),
        ("line 8: expected rows of results up to the key -3, got the end", TEXT[: TEXT.index(" -1        17")], {}),
        ("line 7: expected a component, key -5, got ' -1", WITHOUT_ALL, {}),
        ("line 9: expected a number in column '17', got 'x.38177E-03'", TEXT.replace("-1.38177E", " x.38177E"), {}),
        ("line 9: .* got a blank field", TEXT.replace("         NaN", ""), {}),
        ("line 2: expected a format indicator from 0 to 3, got 7", TEXT.replace("    1\n -4", "    7\n -4"), {}),
        ("line 7: expected .* bytes of numbers, got", TEXT.replace("    1\n -4", "    2\n -4").replace(
            "           2       ", "    99999999       "), {}),
        ("line 13: 2.DISP.D1 has two values at the time 1e-05", TEXT + TEXT.replace(" 1.17251", " 2.17251"), {}),
        ("line 1: expected a line with an end", "x" * 2000, {}),
    ],
)  # fmt: skip
def test_a_file_that_is_none_is_refused_with_its_line(file, message, text, options):
    with pytest.raises(CalibError, match=f"deck.frd.*{message}"):
        read(file(text), **options)


def test_a_binary_file_that_is_cut_off_is_refused_wherever(binary, tmp_path):
    content = binary.read_bytes()
    path = tmp_path / "cut.frd"
    for size in range(1000, len(content) - 100, 111):
        path.write_bytes(content[:size])
        with suppress(CalibError):
            assert read(path).time.size < INCREMENTS


def test_a_file_that_is_too_large_is_refused(file, monkeypatch):
    monkeypatch.setattr("calib.simulators.command.readers.frd.MAX_TEXT_BYTES", 100)
    with pytest.raises(CalibError, match="expected at most .* MiB"):
        read(file(TEXT))
