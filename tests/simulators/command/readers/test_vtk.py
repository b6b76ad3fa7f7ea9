"""Series of VTK files as columns."""

import meshio
import numpy as np
import pytest

from calib.errors import CalibError
from calib.simulators.command.readers import check_options, reader

read = reader("vtk")
PLACES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
COUNT = 3


def mesh(i, places=PLACES):
    u = np.arange(12.0).reshape(4, 3) + 100 * i
    data = {"displacement": u[: len(places)], "pressure": np.arange(4.0)[: len(places)] + i}
    return meshio.Mesh(places, [("line", [[0, 1], [1, 2]])], point_data=data)


def collection(*entries):
    rows = "".join(f'<DataSet timestep="{time}" group="" part="0" file="{file}"/>' for time, file in entries)
    return f'<?xml version="1.0"?><VTKFile type="Collection" version="0.1"><Collection>{rows}</Collection></VTKFile>'


@pytest.fixture
def series(tmp_path):
    for i in range(COUNT):
        meshio.write(tmp_path / f"out_{10 * i:04d}.vtu", mesh(i))
    path = tmp_path / "out.pvd"
    path.write_text(collection(*((0.5 * i, f"out_{10 * i:04d}.vtu") for i in range(COUNT))))
    return path


def test_point_data_are_read_at_a_number_and_at_the_nearest_place(series):
    columns = read(series, points={"tip": 2, "edge": [0.9, 0.1, 0.0], "plane": [1, 0]})
    np.testing.assert_array_equal(columns.time, [0.0, 0.5, 1.0])
    assert columns.values["tip.displacement[3]"].tolist() == [8.0, 108.0, 208.0]
    assert columns.values["edge.pressure"].tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(columns.values["plane.displacement[1]"], columns.values["edge.displacement[1]"])
    assert list(read(series, points={"tip": 2}, columns=["tip.pressure"]).values) == ["tip.pressure"]


def test_numbered_files_have_a_stated_step(series):
    first = series.with_name("out_0000.vtu")
    np.testing.assert_array_equal(read(first, points={"tip": 2}, step=0.05).time, [0.0, 0.5, 1.0])
    second = series.with_name("out_0010.vtu")
    np.testing.assert_array_equal(read(second, points={"tip": 2}, step=0.05).time, [0.5, 1.0])


@pytest.mark.parametrize("binary", [True, False])
def test_legacy_files_are_read_alike(tmp_path, binary):
    for i in range(COUNT):
        meshio.vtk.write(tmp_path / f"out{i}.vtk", mesh(i), binary=binary)
    columns = read(tmp_path / "out0.vtk", points={"tip": 2}, step=0.5)
    assert columns.values["tip.displacement[3]"].tolist() == [8.0, 108.0, 208.0]


@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("point 'tip': expected a number from 0 to 3, got 4", {"points": {"tip": 4}}),
        (
            "point 'tip': expected a place in the box .* got \\[1000",
            {"points": {"tip": [1000, 0, 0]}},
        ),
        ("point 'tip': expected a place", {"points": {"tip": [float("nan"), 0, 0]}}),
        ("no column 'tip.u'; there are tip.displacement\\[1\\]", {"points": {"tip": 1}, "columns": ["tip.u"]}),
        ("a .pvd states its times; drop step", {"points": {"tip": 1}, "step": 1.0}),
    ],
)
def test_points_that_are_none_are_refused(series, message, options):
    with pytest.raises(CalibError, match=message):
        read(series, **options)


@pytest.mark.parametrize("points", [{}, {"tip": -1}, {"tip": "1"}, {"tip": [1.0]}, {"tip": 1.5}, [1]])
def test_points_are_numbers_or_places_by_name(points):
    with pytest.raises(CalibError, match="option 'points' of the reader 'vtk'"):
        check_options("vtk", {"points": points})


@pytest.mark.parametrize(
    ("message", "text"),
    [
        ("not a readable .pvd file", ""),
        ("not a readable .pvd file", collection((0, "out_0000.vtu"))[:-20]),
        ("not a readable .pvd file", '<!DOCTYPE a [<!ENTITY b "c">]>' + collection((0, "out_0000.vtu"))[21:]),
        ("expected a DataSet for each time, got none", collection()),
        ("expected files in its own folder, got '../out.vtu'", collection((0, "../out.vtu"))),
        ("expected files in its own folder, got '/etc/out.vtu'", collection((0, "/etc/out.vtu"))),
        ("'out_0099.vtu' is not there", collection((0, "out_0099.vtu"))),
        ("expected files of the kinds .vtu, .vtk, got 'out.pvtu'", collection((0, "out.pvtu"))),
        ("expected a number in column 'timestep', got 'x'", collection(("x", "out_0000.vtu"))),
        ("expected one file for each time, got 2 at 0", collection((0, "out_0000.vtu"), (0, "out_0010.vtu"))),
    ],
)
def test_a_collection_that_is_none_is_refused(series, message, text):
    series.write_text(text)
    with pytest.raises(CalibError, match=f"out.pvd.*{message}"):
        read(series, points={"tip": 1})


def test_a_link_to_a_file_elsewhere_is_refused(series):
    first, later = series.with_name("out_0000.vtu"), series.with_name("out_0010.vtu")
    elsewhere = series.parent.parent / "elsewhere.vtu"
    later.rename(elsewhere)
    later.symlink_to(elsewhere)
    for path, options in ((series, {}), (first, {"step": 1.0})):
        with pytest.raises(CalibError, match="expected files in its own folder, got 'out_0010.vtu'"):
            read(path, points={"tip": 1}, **options)
    elsewhere.unlink()


def test_series_that_are_none_are_refused(series):
    first = series.with_name("out_0000.vtu")
    with pytest.raises(CalibError, match="numbered files state no time; state step"):
        read(first, points={"tip": 1})
    alone = first.rename(series.with_name("out.vtu"))
    with pytest.raises(CalibError, match="expected the first of numbered files, such as out_0000.vtu"):
        read(alone, points={"tip": 1}, step=1.0)
    other = alone.rename(series.with_name("out.pvtu"))
    with pytest.raises(CalibError, match="expected a .pvd, .vtu or .vtk file; of a .pvtu"):
        read(other, points={"tip": 1})
    (series.with_name("out_010.vtu")).write_text("")
    with pytest.raises(CalibError, match="has the same number; remove one"):
        read(series.with_name("out_0010.vtu"), points={"tip": 1}, step=1.0)


def test_damaged_files_and_changing_meshes_are_refused(series):
    path = series.with_name("out_0010.vtu")
    content = path.read_bytes()
    for size in (0, 100, len(content) // 2, len(content) - 20):
        path.write_bytes(content[:size])
        with pytest.raises(CalibError, match="out_0010.vtu: not a readable VTK file"):
            read(series, points={"tip": 1})
    meshio.write(path, mesh(1, PLACES[:3]))
    with pytest.raises(CalibError, match="out_0010.vtu: expected the 4 points of the first file, got 3"):
        read(series, points={"tip": 1})
