"""Files of NumPy as columns."""

import io
import zipfile

import numpy as np
import pytest
from numpy.lib import format as npy

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("numpy")
TIME = np.array([0.0, 0.5, 1.0])
TABLE = np.column_stack([TIME, [1.0, 2.0, 3.0], [4, 5, np.nan]])


@pytest.fixture
def saved(tmp_path):
    def save(array=None, **arrays):
        path = tmp_path / ("out.npy" if array is not None else "out.npz")
        np.save(path, array) if array is not None else np.savez_compressed(path, **arrays)
        return path

    return save


@pytest.mark.parametrize(
    ("table", "options"),
    [
        (TABLE, {}),
        (np.asfortranarray(TABLE), {}),
        (TABLE.astype(">f4"), {}),
        (TABLE.T, {"transpose": True}),
        (TABLE[:, [1, 0, 2]], {"time": 2}),
        (TABLE[:, [1, 2]], {"step": 0.5}),
    ],
)
def test_a_table_is_read_by_position(saved, table, options):
    columns = read(saved(table), **options)
    np.testing.assert_array_equal(columns.time, TIME)
    np.testing.assert_array_equal(list(columns.values.values()), TABLE.T[1:])


def test_a_table_with_fields_is_read_by_field(saved):
    table = np.zeros(3, [("t", float), ("tip", "f4"), ("count", int)])
    table["t"], table["tip"] = TIME, [1, 2, 3]
    columns = read(saved(table), columns=["tip"])
    np.testing.assert_array_equal(columns.time, TIME)
    assert {name: list(column) for name, column in columns.values.items()} == {"tip": [1.0, 2.0, 3.0]}


def test_a_vector_needs_a_step(saved):
    assert read(saved(TIME), step=0.1).values["1"].tolist() == TIME.tolist()


def test_arrays_of_an_archive_are_read_by_name_and_place(saved):
    u = np.arange(12.0).reshape(2, 3, 2)
    path = saved(t=TIME[:, np.newaxis], tip=TIME**2, u=u, label="by hand", other=np.ones(7), scalar=3.0)
    columns = read(path)
    assert list(columns.values) == ["tip", "u[1,1]", "u[1,2]", "u[2,1]", "u[2,2]"]
    np.testing.assert_array_equal(columns.time, TIME)
    np.testing.assert_array_equal(columns.values["u[2,1]"], u[1, :, 0])
    chosen = read(path, time="tip", columns=["u[1, 2]", "t"])
    np.testing.assert_array_equal(chosen.time, TIME**2)
    np.testing.assert_array_equal(chosen.values["u[1, 2]"], u[0, :, 1])


@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("no array 'tipp' \\(did you mean 'tip'\\?\\); there are time, tip, u", {"columns": ["tipp"]}),
        ("no column 'u'; the array 'u' has columns up to u\\[2\\]", {"columns": ["u"]}),
        ("no column 'u\\[3\\]'; the array 'u' has columns up to u\\[2\\]", {"columns": ["u[3]"]}),
        ("no column 'u\\[0\\]'", {"columns": ["u[0]"]}),
        ("no column 'u\\[1,1\\]'", {"columns": ["u[1,1]"]}),
        ("no column 'tip\\[1\\]'; the array 'tip' has one column", {"columns": ["tip[1]"]}),
        ("no array 'tim' \\(did you mean 'time'\\?\\) that is time", {"time": "tim"}),
        ("either the array that is time or the step", {"time": "time", "step": 1.0}),
        ("u: expected a vector as time, got an array of shape \\(3, 2\\)", {"time": "u"}),
        ("expected arrays of one number of samples, got {.*'other': 7", {"step": 1.0}),
    ],
)
def test_columns_that_are_none_are_refused(saved, message, options):
    path = saved(time=TIME, tip=TIME**2, u=np.ones((3, 2)), other=np.ones(7))
    with pytest.raises(CalibError, match=f"out.npz.*{message}"):
        read(path, **options)


def test_arrays_without_time_are_refused(saved):
    with pytest.raises(CalibError, match="no array .time. or .t. that is time; state time, or step; the arrays.*tip"):
        read(saved(tip=TIME))
    with pytest.raises(CalibError, match="expected arrays with the 3 samples of time, got none"):
        read(saved(t=TIME, tip=np.ones(4)))


def test_objects_and_other_shapes_are_refused(saved):
    with pytest.raises(CalibError, match="expected arrays of numbers, got objects"):
        read(saved(np.array([{}, None])))
    with pytest.raises(CalibError, match="expected a table.*got an array of shape \\(1, 2, 3\\)"):
        read(saved(np.ones((1, 2, 3))))
    with pytest.raises(CalibError, match="got an array of shape \\(\\)"):
        read(saved(np.array(1.0)))
    with pytest.raises(CalibError, match="expected arrays with the 3 samples of time, got none"):
        read(saved(np.ones((3, 2)) * 1j))
    with pytest.raises(CalibError, match="out.npz: .*time: expected real numbers"):
        read(saved(t=TIME * 1j, tip=TIME))


def header(shape):
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return file.getvalue()


@pytest.mark.parametrize("shape", [(10**12, 2), (2**28, 2), (-1, 2)])
def test_sizes_are_looked_at_before_anything_is_allocated(tmp_path, shape):
    path = tmp_path / "out.npy"
    path.write_bytes(header(shape) + bytes(16))
    with pytest.raises(CalibError, match="expected .* bytes of numbers, got at most|not a readable file"):
        read(path)
    archive = tmp_path / "out.npz"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("t.npy", header(shape) + bytes(16))
    with pytest.raises(CalibError, match="expected .* bytes of numbers, got at most|not a readable file"):
        read(archive)


def test_an_archive_that_expands_beyond_the_bound_is_refused(saved, monkeypatch):
    monkeypatch.setattr("calib.simulators.command.readers.npy.MAX_DATASET_BYTES", 1000)
    with pytest.raises(CalibError, match="expected at most .* GiB of numbers"):
        read(saved(t=np.zeros(10_000)))


def test_a_file_that_is_cut_off_is_refused(saved):
    path = saved(TABLE)
    content = path.read_bytes()
    for size in (0, 5, 20, len(content) - 1):
        path.write_bytes(content[:size])
        with pytest.raises(CalibError, match="out.npy"):
            read(path)
