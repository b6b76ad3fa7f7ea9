"""NetCDF files as columns."""

import h5py
import numpy as np
import pytest
import xarray as xr

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("netcdf")
TIME = np.array([0.0, 0.5, 1.0])


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "out.nc"
    xr.Dataset(
        {
            "displacement": (("body", "time"), np.arange(6.0).reshape(2, 3)),
            "u": (("time", "node"), np.arange(6).reshape(3, 2)),
            "tip": ("time", [1.0, np.nan, 3.0]),
            "other": ("node", [1.0, 2.0]),
        },
        coords={"time": ("time", TIME, {"units": "ms"}), "body": ["beam", "layer"]},
    ).to_netcdf(path)
    return path


def test_variables_are_read_by_name_label_and_place(path):
    columns = read(path)
    np.testing.assert_array_equal(columns.time, TIME)
    assert set(columns.values) == {"displacement[beam]", "displacement[layer]", "u[1]", "u[2]", "tip"}
    np.testing.assert_array_equal(columns.values["displacement[layer]"], [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(columns.values["u[2]"], [1.0, 3.0, 5.0])


def test_columns_time_and_step_are_stated(path):
    assert list(read(path, columns=["displacement[beam]"]).values) == ["displacement[beam]"]
    assert read(path, step=0.1, columns=["tip"]).time.tolist() == [0.0, 0.1, 0.2]
    assert read(path, time="tip", columns=["time"]).values["time"].tolist() == TIME.tolist()


@pytest.mark.parametrize(
    ("message", "options"),
    [
        ("no column 'displacement\\[beem\\]'; the array 'displacement' has columns up to displacement\\[layer\\]",
         {"columns": ["displacement[beem]"]}),
        ("no array 'tipp' over time \\(did you mean 'tip'", {"columns": ["tipp"]}),
        ("no array 'clock' that is time", {"time": "clock"}),
        ("u: expected a variable over one dimension as time", {"time": "u"}),
    ],
)  # fmt: skip
def test_columns_that_are_none_are_refused(path, message, options):
    with pytest.raises(CalibError, match=f"out.nc.*{message}"):
        read(path, **options)


def test_the_checks_of_every_netcdf_file_hold(path):
    with h5py.File(path, "a") as file:
        file["far"] = h5py.ExternalLink("other.nc", "/time")
    with pytest.raises(CalibError, match="far: expected data in the file itself, got an external link"):
        read(path)
    path.write_bytes(b"CDF\x01 and no more")
    with pytest.raises(CalibError, match="not a readable netCDF file"):
        read(path)
