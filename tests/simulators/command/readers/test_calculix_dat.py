"""Printed results of CalculiX."""

import numpy as np
import pytest
from calculix_deck import INCREMENTS, PRINTED, TIME_STEP, solve

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("calculix_dat")

BLOCKS = """
 displacements (vx,vy,vz) for set NTIP and time  0.1000000E-04

        17 -1.381768E-03 -1.468496-104  1.301259E-02

 contact stress (slave node,press,tang1,tang2) for all contact elements and time 0.1000000E-04

         3  1.000000E+00  0.000000E+00  0.000000E+00

 displacements (vx,vy,vz) for set NTIP and time  0.2000000E-04

        17 -3.415391E-03 -3.068268E-04  2.928273E-02 L
"""


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    return solve(tmp_path_factory.mktemp("printed"), PRINTED).with_suffix(".dat")


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "deck.dat"
        path.write_text(text)
        return path

    return write


def test_results_of_calculix_are_read_by_set_node_and_component(solved):
    columns = read(solved)
    np.testing.assert_allclose(columns.time, TIME_STEP * np.arange(1, INCREMENTS + 1), rtol=1e-6)
    names = set(columns.values)
    assert {"NTIP.U1", "NTIP.U3", "NTIP.V3", "NTWO:2.U3", "NTWO:17.U3", "NFIX:8.RF1", "NFIX.RF3"} <= names
    assert {"EALL:1:1.SXX", "EALL:1:8.SYZ", "EALL:1:3.ENER", "EALL.ELSE", "EALL.EVOL"} <= names
    np.testing.assert_array_equal(columns.values["NTIP.U3"], columns.values["NTWO:17.U3"])
    assert np.all(columns.values["NTIP.U3"] > 0.0)  # the tip yields to the force


def test_the_total_force_is_the_sum_of_the_forces_at_the_nodes(solved):
    values = read(solved).values
    total = sum(values[f"NFIX:{node}.RF3"] for node in (1, 4, 5, 8))
    np.testing.assert_allclose(values["NFIX.RF3"], total, atol=1e-5)


def test_columns_are_chosen_in_the_order_that_is_asked_for(solved):
    assert list(read(solved, columns=["NTIP.V3", "NTIP.U1"]).values) == ["NTIP.V3", "NTIP.U1"]


def test_exponents_without_a_letter_other_results_and_marks_of_local_axes_are_no_obstacle(file):
    columns = read(file(BLOCKS))
    np.testing.assert_array_equal(columns.time, [1e-5, 2e-5])
    np.testing.assert_array_equal(columns.values["NTIP.U2"], [-1.468496e-104, -3.068268e-04])
    assert list(columns.values) == ["NTIP.U1", "NTIP.U2", "NTIP.U3"]


OTHER_TIMES = BLOCKS + BLOCKS.replace("for set NTIP and time  0.1", "for set NEND and time  0.3").replace(
    "for set NTIP and time  0.2", "for set NEND and time  0.4"
)


@pytest.mark.parametrize(
    ("message", "text", "options"),
    [
        ("expected results of \\*NODE PRINT or \\*EL PRINT, got none", "", {}),
        ("no column 'NTIP.U4' \\(did you mean 'NTIP.U[123]'\\?\\); there are NTIP.U1, NTIP.U2", BLOCKS,
         {"columns": ["NTIP.U4"]}),
        ("line 12: the file is cut off in this line", BLOCKS.rstrip(), {}),
        ("line 10: expected rows below this heading, got none", BLOCKS[: BLOCKS.rindex("        17")], {}),
        ("line 4: .* column 'NTIP.U3', got '\\*\\*\\*\\*'", BLOCKS.replace("1.301259E-02", "****"), {}),
        ("line 4: .* got '1.3x1259E-02'", BLOCKS.replace("1.301259E-02", "1.3x1259E-02"), {}),
        ("line 4: expected 1 whole numbers, then 1 or more", BLOCKS.replace("    17 -1.38", "  1.7 -1.38"), {}),
        ("line 2: expected a number in column 'time'", BLOCKS.replace("0.1000000E-04", "*************", 1), {}),
        ("NTIP.U1 has 2 instants and NTIP.U3 1, or others", BLOCKS.replace("  1.301259E-02", ""), {}),
        ("NTIP.U1 has 2 instants and NEND.U1 2, or others.* choose columns", OTHER_TIMES, {}),
        ("line 12: NTIP.U1 has two values at the time 1e-05", BLOCKS.replace("0.2000000E-04", "0.1000000E-04"), {}),
    ],
)  # fmt: skip
def test_a_file_that_is_none_is_refused_with_its_line(file, message, text, options):
    with pytest.raises(CalibError, match=f"deck.dat.*{message}"):
        read(file(text), **options)


def test_sets_of_other_instants_are_no_obstacle_where_the_columns_are_stated(file):
    np.testing.assert_array_equal(read(file(OTHER_TIMES), columns=["NEND.U1"]).time, [3e-5, 4e-5])
