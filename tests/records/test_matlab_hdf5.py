"""MATLAB 7.3 files hold what those of version 5 hold, and damaged ones are refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io.matlab
from matlab_73 import save_73
from scipy.io import savemat

from calib.errors import CalibError
from calib.records.delimited import TextLayout
from calib.records.matlab import matlab_arrays
from calib.records.sheet_file import read_sheet
from calib.records.table import Channel, Table, TimeColumn, read

TIME = np.array([0.0, 0.5, 1.0])
U = np.arange(6.0).reshape(2, 3)
CELLS = np.empty((1, 2), object)
CELLS[0, 0], CELLS[0, 1] = TIME**2, "text"
RUNS = [{"force": TIME * k, "label": f"run {k}"} for k in (1.0, 2.0)]
VARIABLES = {
    "t": TIME, "u": U, "z": TIME * (1.0 + 2.0j), "gain": 3.0, "label": "by hand", "none": np.zeros((0, 0)),
    "cells": CELLS, "out": {"tip": TIME**3, "more": {"deep": np.ones(4), "cells": CELLS}},
}  # fmt: skip


def runs_of_version_5():
    """Structures as SciPy writes an array of them."""
    runs = np.empty((1, 2), [("force", object), ("label", object)])
    for k, run in enumerate(RUNS):
        runs[0, k] = run["force"], run["label"]
    return runs


def sheet(path):
    return read_sheet(path, path.read_bytes(), TextLayout())


def test_both_versions_give_the_same_columns_and_the_same_reasons(tmp_path):
    save_73(tmp_path / "new.mat", VARIABLES | {"runs": RUNS})
    savemat(tmp_path / "old.mat", VARIABLES | {"runs": runs_of_version_5()})
    new, old = sheet(tmp_path / "new.mat"), sheet(tmp_path / "old.mat")
    assert set(new.columns) == set(old.columns)
    assert {"t", "u(:,3)", "real(z)", "imag(z)", "cells{1,1}", "out.tip", "out.more.deep", "runs(2).force"} < set(
        new.columns
    )
    for name, column in old.columns.items():
        np.testing.assert_array_equal(new.columns[name], column, err_msg=name)
    assert set(new.unfit) == set(old.unfit)
    same = [name for name in old.unfit if "fields" not in old.unfit[name]]
    assert {name: new.unfit[name] for name in same} == {name: old.unfit[name] for name in same}


def test_a_file_that_matlab_wrote_is_read():
    [path] = Path(scipy.io.matlab.__path__[0]).glob("tests/data/testhdf5_*.mat")
    angles = np.asarray(sheet(path).columns["testdouble"])
    np.testing.assert_allclose(angles, np.arange(9.0) * np.pi / 4.0, rtol=1e-15)


def test_a_table_of_a_record_may_be_of_version_73(tmp_path):
    save_73(tmp_path / "bench.mat", {"runs": [{"t": TIME, "x": TIME**2}, {"t": TIME, "x": TIME**3}]})
    x = Channel("runs(2).x", "mass", "displacement", "mm")
    record, _ = read(Table(tmp_path / "bench.mat", [x], time=TimeColumn("runs(2).t")))
    np.testing.assert_allclose(record.displacement.sel(body="mass"), 1e-3 * TIME**3, rtol=1e-15)


def test_what_is_no_array_of_numbers_is_told(tmp_path):
    path = tmp_path / "x.mat"
    save_73(path, {"t": TIME, "T": np.arange(6.0), "s": {"data": TIME}, "image": np.ones((2, 3), np.uint8)})
    with h5py.File(path, "r+") as file:
        file["T"].attrs["MATLAB_object_decode"] = np.int32(3)
        file["T"].attrs["MATLAB_class"] = np.bytes_("table")
        file["s"].attrs["MATLAB_sparse"] = np.uint64(3)
        file["nothing"] = h5py.Empty("f8")
    arrays, unread = matlab_arrays(path, path.read_bytes())
    assert set(arrays) == {"t", "image"}
    assert set(unread) == {"T", "s", "nothing"}
    assert unread["s"].startswith("a sparse matrix")
    with pytest.raises(CalibError, match=r"column 'T.force': 'T' is a MATLAB table; save its numbers as arrays"):
        sheet(path).find("T.force")


def test_cells_that_hold_themselves_have_an_end(tmp_path):
    path = tmp_path / "x.mat"
    save_73(path, {"cells": CELLS})
    with h5py.File(path, "r+") as file:
        file["cells"][0, 0] = file["cells"].ref
    with pytest.raises(
        CalibError, match=r"x.mat: not a readable MATLAB 7.3 file .*within one another 20 times at most"
    ):
        matlab_arrays(path, path.read_bytes())


def test_a_variable_beyond_the_bound_is_left_out_and_the_others_are_read(tmp_path, monkeypatch):
    path = tmp_path / "x.mat"
    save_73(path, {"camera": np.zeros((100, 200), np.uint8), "t": TIME})
    monkeypatch.setattr("calib.records.matlab_hdf5.MAX_EXPANDED_BYTES", 10_000)
    found = sheet(path)
    np.testing.assert_array_equal(found.find("t"), TIME)
    with pytest.raises(CalibError, match=r"column 'camera' is too large: .* GiB; keep fewer samples"):
        found.find("camera")


def test_a_link_is_refused(tmp_path):
    path = tmp_path / "x.mat"
    save_73(path, {"t": TIME})
    with h5py.File(path, "r+") as file:
        file["other"] = h5py.ExternalLink("elsewhere.h5", "/t")
    with pytest.raises(CalibError, match="other: expected data in the file itself, got an external link"):
        sheet(path)


def test_a_file_with_any_byte_changed_or_cut_off_is_read_or_refused(tmp_path):
    path = tmp_path / "x.mat"
    save_73(path, VARIABLES | {"runs": RUNS})
    content = path.read_bytes()
    rng = np.random.default_rng(7)
    for place in rng.integers(0, len(content), 60).tolist():
        changed = bytearray(content)
        changed[place] = int(rng.integers(256))
        for damaged in (bytes(changed), content[:place]):
            path.write_bytes(damaged)
            try:
                sheet(path)
            except CalibError as error:
                if not str(error).startswith(str(path)):
                    raise
