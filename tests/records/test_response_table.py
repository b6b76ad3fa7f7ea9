"""Frequency responses read from delimited text."""

import numpy as np
import pytest

from calib.errors import CalibError
from calib.records import is_response, read, write
from calib.records.response import complex_amplitude, sweeps, tolerances

HEADER = "frequency [Hz], level [mN], direction, mass amplitude [mm], mass phase [deg], mass sigma [um]\n"
ROWS = "1.0, 500, up, 2, -90, 10\n2.0, 500, up, 4, 0, 20\n2.0, 500, down, 1, 180, 5\n1.5, 500, down, 1, 90, 5\n"


def written(folder, text):
    path = folder / "stepped.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_are_brought_to_si_and_cut_into_sweeps(tmp_path):
    record = read(written(tmp_path, "# place: mass\n# quantity: force\n" + HEADER + ROWS))
    assert is_response(record)
    assert (record.attrs["place"], record.attrs["quantity"]) == ("mass", "force")
    np.testing.assert_allclose(complex_amplitude(record)[0], [-2e-3j, 4e-3, -1e-3, 1e-3j], atol=1e-18)
    np.testing.assert_allclose(record.level, 0.5)
    np.testing.assert_allclose(record.response_sigma[0], [1e-5, 2e-5, 5e-6, 5e-6])
    assert [points.tolist() for _, points in sweeps(record)] == [[0, 1], [2, 3]]
    assert record.direction.values.tolist() == [1.0, 1.0, -1.0, -1.0]
    np.testing.assert_allclose(tolerances(record)[0], [0.1, 0.1, 0.05, 0.05])


def test_a_response_goes_through_a_file_unchanged(tmp_path):
    record = read(written(tmp_path, HEADER + ROWS))
    write(record, tmp_path / "stepped.nc")
    assert read(tmp_path / "stepped.nc").equals(record)


def test_without_a_direction_it_is_that_of_the_frequencies(tmp_path):
    text = "frequency [kHz], level [N], mass in-phase [m], mass quadrature [m]\n3, 1, 1, 0\n2, 1, 1, 0\n"
    record = read(written(tmp_path, text))
    np.testing.assert_allclose(record.frequency, [3000.0, 2000.0])
    assert record.direction.values.tolist() == [-1.0, -1.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + ROWS.replace("2, -90", "2, x"), "stepped.csv, line 2: expected a number in column 5, got 'x'"),
        (HEADER + ROWS.replace("up, 2", "on, 2"), "line 2: expected a direction 'up' or 'down', got 'on'"),
        (HEADER.replace("[mm]", "[kg]") + ROWS, "column 4"),
        (HEADER.replace(" [mm]", "") + ROWS, "column 'mass amplitude' states no unit"),
        (HEADER.replace("level [mN]", "level [s]") + ROWS, "expected a unit of force or displacement"),
        (HEADER.replace("mass phase", "mass fase") + ROWS, "column 'mass fase [deg]' is not known.*'mass phase'"),
        (HEADER + ROWS.replace("1.0, 500", "-1.0, 500"), "frequency is expected above 0"),
        (HEADER, "no rows below the header"),
        (
            HEADER.replace("direction, ", "") + ROWS.replace("up, ", "").replace("down, ", ""),
            "from line 2 on rise and fall; add a column 'direction'",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place_and_remedy(tmp_path, text, message):
    with pytest.raises(CalibError, match=message.replace("[", r"\[")):
        read(written(tmp_path, text))
