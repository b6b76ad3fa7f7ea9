"""HDF5 files as columns."""

import h5py
import numpy as np
import pytest

from calib.errors import CalibError
from calib.simulators.command.readers import reader

read = reader("hdf5")
TIME = np.array([0.0, 0.5, 1.0])


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "out.h5"
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["results/tip"] = np.float32([1.0, np.nan, 3.0])
        file["results/u"] = np.arange(6).reshape(3, 2)
        file["mesh/nodes"] = np.ones((100, 2))
        file["label"] = "by hand"
        file["results/again"] = file["results"]  # a group in itself
        file["spectrum"] = np.ones(3, complex)
    return path


def test_datasets_are_read_by_path_and_place(path):
    columns = read(path)
    np.testing.assert_array_equal(columns.time, TIME)
    assert set(columns.values) == {"results/tip", "results/u[1]", "results/u[2]"}
    np.testing.assert_array_equal(columns.values["results/u[2]"], [1.0, 3.0, 5.0])
    assert list(read(path, columns=["results/u[1]"]).values) == ["results/u[1]"]


def test_a_step_takes_the_place_of_time(path):
    np.testing.assert_array_equal(read(path, step=0.1, columns=["results/tip"]).time, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(read(path, time="results/tip", columns=["time"]).values["time"], TIME)


def external_link(file, other):
    file["far"] = h5py.ExternalLink(str(other), "/time")


def soft_link(file, other):
    file["results/near"] = h5py.SoftLink("/time")


def external_storage(file, other):
    file.create_dataset("results/far", (3,), float, external=[(str(other), 0, 24)])


def virtual(file, other):
    layout = h5py.VirtualLayout((3,), float)
    layout[:] = h5py.VirtualSource(str(other), "time", (3,))
    file.create_virtual_dataset("results/far", layout)


@pytest.mark.parametrize(
    ("damage", "kind"),
    [
        (external_link, "an external link"),
        (soft_link, "a soft link"),
        (external_storage, "external storage"),
        (virtual, "a virtual dataset"),
    ],
)
def test_data_in_other_files_are_refused(path, damage, kind):
    with h5py.File(path, "a") as file:
        damage(file, path.with_name("other.h5"))
    with pytest.raises(CalibError, match=f"expected data in the file itself, got {kind}"):
        read(path)


def test_sizes_are_looked_at_before_anything_is_allocated(path):
    with h5py.File(path, "a") as file:
        file.create_dataset("huge", (3, 10**10), "f8", chunks=(1, 1000))
    with pytest.raises(CalibError, match="out.h5: huge: expected at most 1 GiB in all arrays, got 224 GiB; choose"):
        read(path)
    assert read(path, columns=["results/tip"]).time.size == 3


def test_what_is_no_hdf5_is_refused(tmp_path, path):
    other = tmp_path / "other.h5"
    content = path.read_bytes()
    for size in (0, 100, 1000, len(content) - 500):
        other.write_bytes(content[:size])
        with pytest.raises(CalibError, match="other.h5: not a readable HDF5 file"):
            read(other)


def test_too_many_groups_are_refused(path, monkeypatch):
    monkeypatch.setattr("calib.execution.hdf5.MAX_GROUPS", 2)
    with pytest.raises(CalibError, match="expected at most 2 groups"):
        read(path)
