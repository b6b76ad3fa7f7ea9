"""MATLAB files as columns."""

import numpy as np
import pytest
from matlab_73 import save_73
from scipy.io import savemat

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("matlab")
TIME = np.array([0.0, 0.5, 1.0])
U = np.arange(6.0).reshape(2, 3)
CELLS = np.empty((1, 2), object)
CELLS[0, 0], CELLS[0, 1] = TIME**2, np.array([[1.0], [2.0], [3.0]])
VARIABLES = {"t": TIME[:, np.newaxis], "tip": TIME**2, "u": U, "x": CELLS, "label": "by hand", "other": np.ones(5)}


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
    save_73(path, VARIABLES | {"out": {"tip": TIME**3}})
    columns = read(path)
    np.testing.assert_array_equal(columns.time, TIME)
    assert set(columns.values) == {"tip", "u[1]", "u[2]", "x{1,1}", "x{1,2}", "out.tip"}
    np.testing.assert_array_equal(columns.values["u[2]"], U[1])
    np.testing.assert_array_equal(columns.values["x{1,1}"], TIME**2)
    assert read(path, columns=["out.tip"], step=0.1).time.tolist() == [0.0, 0.1, 0.2]


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
