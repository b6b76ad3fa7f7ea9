"""Frequency responses read from tables."""

import numpy as np
import pytest
from scipy.io import savemat

from calib.errors import CalibError
from calib.records import is_response, read, write
from calib.records.delimited import TextLayout
from calib.records.response import complex_amplitude, sweeps, tolerances
from calib.records.response_columns import ResponseColumns, StatedLevel, UnitColumn
from calib.records.response_table import ResponseTable, read_response_columns

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
    "header",
    [
        HEADER.title()
        .replace("[Mn]", "[mN]")
        .replace("[Mm]", "[mm]")
        .replace("[Um]", "[um]")
        .replace("[Deg]", "[deg]"),
        HEADER.replace("[", "(").replace("]", ")"),
        "sep=,\n" + HEADER,
    ],
)
def test_headers_as_spreadsheets_have_them_are_read(tmp_path, header):
    record, usual = read(written(tmp_path, header + ROWS)), read(written(tmp_path, HEADER + ROWS))
    np.testing.assert_array_equal(complex_amplitude(record), complex_amplitude(usual))
    np.testing.assert_array_equal(record.level, usual.level)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            HEADER.replace("direction", "Level [N]") + ROWS.replace("up", "1"),
            "two columns are 'level', one of them 'Le",
        ),
        (HEADER + ROWS.replace("2, -90", "2, x"), "stepped.csv, line 2: expected a number in column 5, got 'x'"),
        (HEADER + ROWS.replace("up, 2", "on, 2"), "line 2: expected a direction 'up' or 'down', got 'on'"),
        (HEADER.replace("[mm]", "[kg]") + ROWS, "column 4"),
        (HEADER.replace(" [mm]", "") + ROWS, "column 'mass amplitude' states no unit"),
        (
            HEADER + ROWS.replace(", 4, 0, 20", ", -4, 0, 20"),
            "line 3: an amplitude is expected at or above 0, got -4 mm",
        ),
        (HEADER.replace("level [mN]", "level [s]") + ROWS, "expected a unit of force or displacement"),
        (HEADER.replace("mass phase", "mass fase") + ROWS, "column 'mass fase [deg]' is not known.*'mass phase'"),
        (HEADER + ROWS.replace("1.0, 500", "-1.0, 500"), "frequency is expected above 0"),
        (HEADER, "no rows below the header"),
        (
            HEADER.replace("direction, ", "") + ROWS.replace("up, ", "").replace("down, ", ""),
            "from line 2 on rise and fall; state a column 'direction'",
        ),
    ],
)
def test_a_mistake_is_told_with_its_place_and_remedy(tmp_path, text, message):
    with pytest.raises(CalibError, match=message.replace("[", r"\[")):
        read(written(tmp_path, text))


OMEGA = 2.0 * np.pi * np.array([10.0, 20.0])  # of ROW_PAIR  [rad/s]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("um", 1e-6 * np.ones(2)),
        ("mm/s", 1e-3 / (1j * OMEGA)),
        ("m/s^2", -1.0 / OMEGA**2),
        ("g", -9.80665 / OMEGA**2),
        ("mg", -9.80665e-3 / OMEGA**2),
        ("um/N", 2e-6 * np.ones(2)),  # a receptance, at 2 N
        ("g/N", -2.0 * 9.80665 / OMEGA**2),
    ],
)
@pytest.mark.parametrize("parts", ["polar", "cartesian"])
def test_amplitudes_of_velocity_and_acceleration_become_those_of_displacement(tmp_path, unit, factor, parts):
    measured = np.array([3.0 * np.exp(0.7j), 4.0 * np.exp(-2.0j)])
    if parts == "polar":
        names, numbers = f"mass amplitude [{unit}], mass phase [rad]", [np.abs(measured), np.angle(measured)]
    else:
        names, numbers = f"mass in-phase [{unit}], mass quadrature [{unit}]", [measured.real, measured.imag]
    rows = "".join(
        f"{f}, 2, {a!r}, {b!r}\n" for f, a, b in zip((10, 20), *(map(float, n) for n in numbers), strict=True)
    )
    record = read(written(tmp_path, f"frequency [Hz], level [N], {names}\n{rows}"))
    np.testing.assert_allclose(complex_amplitude(record)[0], measured * factor, rtol=1e-12)


def test_a_phase_may_be_of_another_motion_than_the_amplitude(tmp_path):
    text = "frequency [Hz], level [N], mass amplitude [m/s^2], mass phase of displacement [deg]\n10, 1, 5, -90\n"
    record = read(written(tmp_path, text))
    np.testing.assert_allclose(complex_amplitude(record)[0], -5j / OMEGA[0] ** 2, rtol=1e-12)


def test_an_uncertainty_is_converted_by_its_own_unit(tmp_path):
    text = "frequency [Hz], level [N], mass amplitude [mm], mass phase [deg], mass sigma [m/s^2]\n10, 1, 5, 0, 0.1\n"
    record = read(written(tmp_path, text))
    np.testing.assert_allclose(record.response_sigma[0], 0.1 / OMEGA[0] ** 2, rtol=1e-12)


def test_the_acceleration_of_a_base_is_a_level_and_turns_the_phase(tmp_path):
    text = "frequency [Hz], level [g], mass amplitude [mm], mass phase [deg]\n10, 0.1, 5, -30\n20, 0.1, 5, -30\n"
    record = read(written(tmp_path, text))
    np.testing.assert_allclose(record.level, 0.980665 / OMEGA**2, rtol=1e-12)
    assert record.level.attrs["units"] == "m"
    np.testing.assert_allclose(np.angle(complex_amplitude(record)[0], deg=True), 150.0)
    assert len(sweeps(record)) == 1


def test_a_level_measured_point_by_point_does_not_end_a_sweep(tmp_path):
    """Of a test at constant response: two sweeps up and one down, with a force of its own at each point."""
    ways = [(1.0, 1.1, 1.2), (1.0, 1.1, 1.2), (1.2, 1.1, 1.0)]
    rows = [f"{f}, {3.0 + i + f}, 5, -90\n" for i, way in enumerate(ways) for f in way]
    header = "frequency [Hz], level [N], mass amplitude [mm], mass phase [deg]\n"
    record = read(written(tmp_path, header + "".join(rows)))
    assert [points.tolist() for _, points in sweeps(record)] == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    assert record.direction.values.tolist() == 6 * [1.0] + 3 * [-1.0]


def test_levels_at_one_frequency_are_a_sweep_each(tmp_path):
    header = "frequency [Hz], level [N], mass amplitude [mm], mass phase [deg]\n"
    record = read(written(tmp_path, header + "1, 1, 5, -90\n1, 2, 9, -90\n1, 3, 12, -90\n"))
    assert len(sweeps(record)) == 3


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            "level [N], mass amplitude [g/s], mass phase [deg]",
            "column 3: .*such as 'mm', 'mm/s', 'm/s^2' or 'g', or",
        ),
        ("level [N], mass amplitude [mm/kg], mass phase [deg]", "over a unit of the excitation, such as 'mm/N', got"),
        ("level [N], mass amplitude [deg], mass phase [mm]", "column 3: expected a unit of displacement"),
        ("level [N], mass amplitude [mm], mass phase [Hz]", "column 4: expected a quantity that can be given in rad"),
        (
            "level [deg], mass amplitude [mm], mass phase [deg]",
            "column 2: the level is the amplitude of the exc",
        ),
        ("level [N], mass in-phase [mm], mass quadrature [mm/s]", "quadrature is in 'mm/s', but in-phase in 'mm'"),
        ("level [N], mass amplitude [mm], mass quadrature [mm]", r"of body 'mass' there are the columns \['amplitude'"),
        ("level [N], mass amplitude [mm], mass phase of force [deg]", "of is one of displacement, velocity, accel"),
    ],
)
def test_a_unit_in_the_wrong_column_is_refused(tmp_path, header, message):
    with pytest.raises(CalibError, match=message.replace("^2", r"\^2")):
        read(written(tmp_path, f"frequency [Hz], {header}\n10, 1, 5, -90\n"))


def test_a_frequency_that_is_not_above_zero_is_named_with_its_line(tmp_path):
    text = "frequency [Hz], level [N], mass amplitude [m/s^2], mass phase [deg]\n10, 1, 5, 0\n0, 1, 5, 0\n"
    with pytest.raises(CalibError, match="line 3: frequency is expected above 0, got 0 Hz"):
        read(written(tmp_path, text))


# --- columns that are stated

HELD = {  # a test at constant response of 5 and 10 m/s^2, in two structures
    "frequency": [np.array([[10.0, 20.0, 30.0]]), np.array([[20.0, 30.0]])],
    "force": [np.array([[3.0], [1.0], [2.0]]), np.array([[4.0], [6.0]])],
    "amplitude": [np.full((3, 1), 5.0), np.full((2, 1), 10.0)],
    "phase": [np.array([[-0.1], [-1.5], [-3.0]]), np.array([[-1.4], [-2.9]])],
}


def stated(prefix, **more):
    of_body = {
        ("mass", "amplitude"): UnitColumn(f"{prefix}amplitude", "m/s^2"),
        ("mass", "phase"): UnitColumn(f"{prefix}phase", "rad", of="displacement"),
    }
    level = UnitColumn(f"{prefix}force", "N")
    return ResponseColumns(UnitColumn(f"{prefix}frequency", "Hz"), of_body, level, **more)


@pytest.fixture
def held(tmp_path):
    """Return a MATLAB file with the sweeps in an array of structures within one, and in a cell array of them."""
    array = np.zeros((1, 2), dtype=[(name, object) for name in HELD])
    cells = np.empty((1, 2), dtype=object)
    for place in (0, 1):
        cells[0, place] = {name: sweeps_[place] for name, sweeps_ in HELD.items()}
        for name, values in HELD.items():
            array[name][0, place] = values[place]
    savemat(tmp_path / "held.mat", {"data": {"held": array}, "cells": cells})
    return tmp_path / "held.mat"


@pytest.mark.parametrize("prefix", ["data.held(*).", "cells{1,*}."])
def test_sweeps_in_structures_and_cells_are_one_response(held, prefix):
    record = read_response_columns(ResponseTable(held, stated(prefix)))
    assert [(n, points.tolist()) for n, points in sweeps(record)] == [(1.0, [0, 1, 2]), (2.0, [3, 4])]
    np.testing.assert_allclose(record.level, [3.0, 1.0, 2.0, 4.0, 6.0])
    omega = 2.0 * np.pi * record.frequency.values
    np.testing.assert_allclose(np.abs(complex_amplitude(record)[0]) * omega**2, [5.0] * 3 + [10.0] * 2)
    np.testing.assert_allclose(np.angle(complex_amplitude(record)[0]), [-0.1, -1.5, -3.0, -1.4, -2.9])


def test_elements_are_chosen_by_number(held):
    record = read_response_columns(ResponseTable(held, stated("data.held(*)."), elements=[2]))
    assert record.frequency.values.tolist() == [20.0, 30.0]
    record = read_response_columns(ResponseTable(held, stated("data.held(1)."), first=1))
    assert record.frequency.values.tolist() == [20.0, 30.0]


@pytest.mark.parametrize(
    ("prefix", "more", "message"),
    [
        (
            "data.held(*).",
            {"elements": [1, 3]},
            r"no single column 'data.held\(3\).frequency' \(did you mean",
        ),
        ("data.hold(*).", {}, r"there is no single column 'data.hold\(1\).frequency'"),
        ("data.held(1).", {"elements": [1]}, "elements are those that '\\*' in the name of a column stands for"),
        ("data.held(*).", {"first": 2}, "first = 2 of the rows was asked for, but the file has 2"),
    ],
)
def test_an_element_that_is_not_there_is_told(held, prefix, more, message):
    with pytest.raises(CalibError, match=message):
        read_response_columns(ResponseTable(held, stated(prefix), **more))


def test_a_complex_matrix_is_read_by_its_columns_and_parts(tmp_path):
    """As modal analysis exports frequency response functions: one column a body, in g over N."""
    function = np.array([[1.0 + 2.0j, 3.0 - 1.0j], [0.5j, 2.0]])
    savemat(tmp_path / "frf.mat", {"f": np.array([10.0, 20.0]), "H": function})
    of_body = {
        (body, what): UnitColumn(f"{part}(H(:,{k}))", "g/N")
        for k, body in enumerate(("left", "right"), 1)
        for what, part in (("in-phase", "real"), ("quadrature", "imag"))
    }
    columns = ResponseColumns(UnitColumn("f", "Hz"), of_body, StatedLevel(2.0, "N"))
    record = read_response_columns(ResponseTable(tmp_path / "frf.mat", columns))
    np.testing.assert_allclose(complex_amplitude(record), -2.0 * 9.80665 * function.T / OMEGA**2, rtol=1e-12)


def test_a_text_of_a_data_logger_is_read_by_stated_columns(tmp_path):
    path = tmp_path / "logged.txt"
    path.write_text("Messung 3\nFrequenz;Kraft;a;phi;Nr\nHz;N;g;Grad;-\n10,0;1,5;0,2;-90;1\n20,0;1,5;0,1;-90;2\n")
    layout = TextLayout(decimal=",", skip=1, header=2)
    of_body = {
        ("mass", "amplitude"): UnitColumn("a", "V", "2 g/V"),
        ("mass", "phase"): UnitColumn("phi", "deg", -1.0),
    }
    columns = ResponseColumns(
        UnitColumn("Frequenz", "Hz"), of_body, UnitColumn("Kraft", "N"), "0.01 Hz", {"mass": "0.05 g"}, sweep="Nr"
    )
    record = read_response_columns(ResponseTable(path, columns, text=layout))
    np.testing.assert_allclose(complex_amplitude(record)[0], np.array([0.4j, 0.2j]) * (-9.80665 / OMEGA**2), rtol=1e-12)
    np.testing.assert_allclose(record.response_sigma[0], 0.05 * 9.80665 / OMEGA**2, rtol=1e-12)
    np.testing.assert_allclose(record.frequency_sigma, 0.01)
    assert len(sweeps(record)) == 2
