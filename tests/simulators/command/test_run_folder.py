"""Folders of runs: of their own names, swept when their process was killed."""

import os
import signal
import subprocess
import sys

import pytest
from child_environment import environment
from marked_processes import survivors

from calib.execution.guarded import RUN_MARK
from calib.simulators.command.run_folder import ACTIVE, run_folder, sweep

SCRIPT = """
import sys, time
from pathlib import Path
from calib.simulators.command.run_folder import run_folder
with run_folder(Path(sys.argv[1])) as folder:
    (folder.path / "deck").write_text("x")
    print(folder.path, flush=True)
    time.sleep(600)
"""


@pytest.fixture
def other(tmp_path):
    """Another process with a folder below the same root, and the path of that."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(tmp_path)], env=environment(), stdout=subprocess.PIPE, text=True
    )
    yield process, process.stdout.readline().strip()
    process.kill()
    process.communicate()


def folders(root):
    return sorted(str(path) for path in (root / ACTIVE).iterdir())


def test_a_folder_is_there_for_a_run_and_gone_behind_it(tmp_path):
    with run_folder(tmp_path) as one, run_folder(tmp_path) as another:
        assert len(folders(tmp_path)) == 2
        assert one.path != another.path
        (one.path / "deep").mkdir()
        (one.path / "deep" / "file").write_text("x")
    assert folders(tmp_path) == []


def test_a_folder_is_emptied_but_for_what_is_kept(tmp_path):
    with run_folder(tmp_path) as folder:
        for name in ("log.1", "debris"):
            (folder.path / name).write_text("x")
        (folder.path / "deep").mkdir()
        (folder.path / "link").symlink_to(tmp_path)
        folder.emptied(("log.1",))
        assert os.listdir(folder.path) == ["log.1"]


def test_a_folder_that_is_kept_takes_the_place_of_the_older_one(tmp_path):
    for text in ("old", "new"):
        with run_folder(tmp_path) as folder:
            (folder.path / "log").write_text(text)
            folder.moved("failed-1")
    assert sorted(os.listdir(tmp_path)) == [ACTIVE, "failed-1"]
    assert (tmp_path / "failed-1" / "log").read_text() == "new"


def test_the_folder_of_a_living_run_is_left_alone(tmp_path, other):
    sweep(tmp_path)
    assert folders(tmp_path) == [other[1]]


def test_the_folder_of_a_killed_run_is_swept_with_what_still_runs_of_it(tmp_path, other):
    process, folder = other
    mark = folder.rpartition("-")[2]
    orphan = subprocess.Popen(["sleep", "600"], env={RUN_MARK: mark}, start_new_session=True)
    os.kill(process.pid, signal.SIGKILL)
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # it remains a zombie, which is no living run
    with run_folder(tmp_path) as own:
        sweep(tmp_path)
        assert folders(tmp_path) == [str(own.path)]
    assert orphan.wait() == -signal.SIGKILL
    assert not survivors(mark)


def test_folders_of_other_machines_and_of_other_kinds_are_left_alone(tmp_path):
    names = ["elsewhere-1-1-0123456789ab", "notes"]
    for name in names:
        (tmp_path / ACTIVE / name).mkdir(parents=True)
    sweep(tmp_path)
    assert sorted(os.listdir(tmp_path / ACTIVE)) == names
    sweep(tmp_path / "nothing there")
