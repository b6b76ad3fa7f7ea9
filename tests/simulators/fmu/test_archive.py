"""The unpacked files of an FMU: one folder a process, removed whenever and however the process ends."""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import zipfile
from contextlib import contextmanager

import pytest
from child_environment import environment

from calib.errors import CalibError
from calib.execution.files import checksum
from calib.simulators.fmu import archive
from calib.simulators.fmu.archive import PREFIX, unpacked


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Folder of temporary files of this process and its children, with a file beside it that can be unpacked."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as file:
        file.writestr("resources/a.txt", "a")
    yield folder
    unpacked.cache_clear()


@contextmanager
def unpacking(folder):
    """Process that has unpacked the file, and ends when its input is closed."""
    path = folder.parent / "a.fmu"
    script = (
        "from pathlib import Path\nfrom calib.simulators.fmu.archive import unpacked\n"
        f"print(unpacked(Path({str(path)!r}), {checksum(path)!r}), flush=True)\nopen(0).read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "env": environment()}
    with subprocess.Popen([sys.executable, "-c", script], **pipes) as process:
        assert process.stdout.readline().strip().startswith(str(folder / PREFIX))
        yield process


def left(folder):
    return [one.name for one in folder.glob(f"{PREFIX}*")]


@pytest.mark.slow
def test_a_folder_is_removed_at_the_end_of_its_process_or_by_the_next_where_that_was_killed(temporary):
    with unpacking(temporary) as killed, unpacking(temporary):
        killed.send_signal(signal.SIGKILL)
        killed.wait(30)
        assert len(left(temporary)) == 2
        path = temporary.parent / "a.fmu"
        own = unpacked(path, checksum(path))
        assert (own / "resources" / "a.txt").read_text() == "a"
        assert len(left(temporary)) == 2, "that of the process that lives, and the new one"
    assert left(temporary) == [own.name], "a process that ends removes its own"


def test_a_file_is_unpacked_once_a_process(temporary):
    path = temporary.parent / "a.fmu"
    assert unpacked(path, checksum(path)) == unpacked(path, checksum(path))
    assert len(left(temporary)) == 1


def test_a_file_that_has_changed_since_the_study_was_read_is_refused(temporary):
    with pytest.raises(CalibError, match="has changed since the study was read"):
        unpacked(temporary.parent / "a.fmu", "0" * 64)


def test_a_file_that_would_fill_the_disk_is_refused(temporary, monkeypatch):
    monkeypatch.setattr(archive, "MAX_UNPACKED_BYTES", 0)
    path = temporary.parent / "a.fmu"
    with pytest.raises(CalibError, match="takes 1 bytes unpacked"):
        unpacked(path, checksum(path))
    assert left(temporary) == []


def test_other_processes_share_the_folder_of_the_one_that_sends_them_a_simulator(fmu, temporary):
    sent = pickle.loads(pickle.dumps(fmu()))
    assert sent._unpacked.is_dir()
    assert os.fspath(sent._unpacked).startswith(os.fspath(temporary))
