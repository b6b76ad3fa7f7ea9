"""Files that are whole or absent."""

import errno
import os
from pathlib import Path

import pytest
import xarray as xr

from calib.execution.files import whole
from calib.execution.netcdf import write_dataset


def test_a_file_takes_its_name_when_it_is_whole(tmp_path):
    with whole(tmp_path / "new.txt") as temporary:
        temporary.write_text("all of it")
        assert not (tmp_path / "new.txt").exists()
    assert (tmp_path / "new.txt").read_text() == "all of it"


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o002, 0o664), (0o077, 0o600)])
def test_permissions_of_a_file_follow_the_umask(tmp_path, umask, mode):
    before = os.umask(umask)
    try:
        with whole(tmp_path / "new.txt") as temporary:
            temporary.write_text("all of it")
        write_dataset(xr.Dataset({"x": 1.0}), tmp_path / "new.nc")
    finally:
        os.umask(before)
    assert {name: (tmp_path / name).stat().st_mode & 0o777 for name in ("new.txt", "new.nc")} == {
        "new.txt": mode,
        "new.nc": mode,
    }


def written(path, text, error=None):
    with whole(path) as temporary:
        temporary.write_text(text)
        if error is not None:
            raise error


def test_a_file_that_fails_half_way_leaves_the_old_one_and_nothing_beside(tmp_path):
    path = tmp_path / "old.txt"
    path.write_text("the old one")
    with pytest.raises(OSError, match="disk full"):
        written(path, "half of it", OSError("disk full"))
    assert path.read_text() == "the old one"
    assert list(tmp_path.iterdir()) == [path]


def test_ctrl_c_just_after_the_file_took_its_name_is_no_failure_to_write(tmp_path, monkeypatch):
    replace = Path.replace

    def interrupted(self, target):
        replace(self, target)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        written(tmp_path / "new.txt", "all of it")
    assert (tmp_path / "new.txt").read_text() == "all of it"


def test_a_folder_that_is_not_there_is_told_by_the_name_of_the_file(tmp_path):
    path = tmp_path / "nowhere" / "new.txt"
    with pytest.raises(FileNotFoundError) as raised:
        written(path, "all of it")
    assert raised.value.filename == str(path)


def test_an_error_while_a_file_is_written_names_it(tmp_path):
    with pytest.raises(OSError, match="No space left") as said, whole(tmp_path / "x"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert said.value.filename == str(tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


def test_a_dataset_for_which_there_is_no_room_is_an_error_of_the_system(tmp_path, monkeypatch):
    def full(*_, **__):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", full)
    with pytest.raises(OSError, match="is the disk full") as said:
        write_dataset(xr.Dataset({"x": 1.0}), tmp_path / "x.nc")
    assert said.value.filename == str(tmp_path / "x.nc")
