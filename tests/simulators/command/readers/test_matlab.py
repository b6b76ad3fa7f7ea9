"""MATLAB files as columns."""

import struct

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("matlab")
TIME = np.array([0.0, 0.5, 1.0])
U = np.arange(6.0).reshape(2, 3)
CELLS = np.empty((1, 2), object)
CELLS[0, 0], CELLS[0, 1] = TIME**2, np.array([[1.0], [2.0], [3.0]])
VARIABLES = {"t": TIME[:, np.newaxis], "tip": TIME**2, "u": U, "x": CELLS, "label": "by hand", "other": np.ones(5)}


def save_73(path, variables):
    """Write as MATLAB 7.3 does: HDF5 behind a header of 512 bytes, arrays transposed, references in a group."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in variables.items():
            file[name] = np.atleast_2d(array).T if np.ndim(array) < 2 else array.T
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["label"] = np.frombuffer(b"by hand", np.uint8).astype("u2")[:3]
        file["label"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"] = np.ones((1, 3))
        file["out/tip"] = np.ones((1, 3))
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<H", 0x0200) + b"IM")


@pytest.mark.parametrize("compressed", [False, True])
def test_variables_of_version_5_are_read_by_name_place_and_cell(tmp_path, compressed):
    path = tmp_path / "out.mat"
    savemat(path, VARIABLES, do_compression=compressed)
    columns = read(path)
    np.testing.assert_array_equal(columns.time, TIME)
    assert list(columns.values) == ["tip", "u[1]", "u[2]", "x{1,1}", "x{1,2}"]
    np.testing.assert_array_equal(columns.values["u[2]"], U[1])
    np.testing.assert_array_equal(columns.values["x{1,1}"], TIME**2)
    assert read(path, columns=["x{1,2}"], step=0.1).time.tolist() == [0.0, 0.1, 0.2]


def test_variables_of_version_73_are_read_alike(tmp_path):
    path = tmp_path / "out.mat"
    save_73(path, {"t": TIME, "tip": TIME**2, "u": U})
    columns = read(path)
    np.testing.assert_array_equal(columns.time, TIME)
    assert set(columns.values) == {"tip", "u[1]", "u[2]", "out/tip"}
    np.testing.assert_array_equal(columns.values["u[2]"], U[1])
    assert read(path, columns=["tip"], step=0.1).time.tolist() == [0.0, 0.1, 0.2]


def test_what_expands_beyond_the_bound_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "out.mat"
    savemat(path, {"t": np.zeros(100_000)}, do_compression=True)
    monkeypatch.setattr("calib.records.matlab_elements.MAX_EXPANDED_BYTES", 10_000)
    with pytest.raises(CalibError, match="expected at most .* GiB; keep fewer"):
        read(path)


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    path = tmp_path / "out.mat"
    for save in (savemat, save_73):
        save(path, {"t": TIME, "tip": TIME})
        content = path.read_bytes()
        for size in (0, 100, 150, len(content) - 40):
            path.write_bytes(content[:size])
            with pytest.raises(CalibError, match="out.mat"):
                read(path)
