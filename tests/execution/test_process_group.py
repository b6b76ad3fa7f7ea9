"""Programs that a call has started end with the process that made the call."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pool_functions as f
import pytest
from child_environment import environment
from marked_processes import MARK, marked, new_mark, survivors

from calib.execution.pools.local import LocalPool

PROGRAMS = 3  # that one call of f.solve starts: sleep, a shell, and its sleep


def wait_for(file):
    """Number of the process whose call has written `file`."""
    deadline = time.monotonic() + 60.0
    while not (file.exists() and file.read_text()):
        assert time.monotonic() < deadline, "the call has not begun within a minute"
        time.sleep(0.01)
    return int(file.read_text())


@pytest.mark.parametrize(
    ("how", "status"), [("hang", "timeout"), ("exit", "crashed"), ("killed", "crashed"), ("segfault", "crashed")]
)
def test_they_end_when_the_call_fails_with_its_process(tmp_path, how, status):
    mark = new_mark()
    with LocalPool(f.solve, 1, timeout=0.5, startup=1.5) as pool:
        [(_, failure)] = pool.map([(tmp_path / "begun", mark, how)])
        assert failure.status == status
        assert (tmp_path / "begun").exists()
        assert not survivors(mark)


def test_they_end_when_the_loop_is_left_early(tmp_path):
    idle, busy = new_mark(), new_mark()
    with LocalPool(f.solve, 2) as pool:
        for _ in pool.map([(tmp_path / "idle", idle, "well"), (tmp_path / "busy", busy, "hang")]):
            wait_for(tmp_path / "busy")
            break
        assert not survivors(busy)
        assert len(marked(idle)) == PROGRAMS, "the other process goes on"
    assert not survivors(idle)


def test_they_end_when_the_pool_is_closed(tmp_path):
    mark = new_mark()
    pool = LocalPool(f.solve, 2)
    calls = pool.map([(tmp_path / "idle", mark, "well"), (tmp_path / "busy", mark, "hang")])
    next(calls)
    wait_for(tmp_path / "busy")
    assert len(marked(mark)) == 2 * PROGRAMS
    pool.close()
    assert not survivors(mark)


def test_a_signal_to_the_group_leaves_nothing(tmp_path):
    mark = new_mark()
    with LocalPool(f.solve, 2) as pool:
        calls = pool.map([(tmp_path / "idle", new_mark(), "well"), (tmp_path / "busy", mark, "hang")])
        next(calls)
        os.killpg(wait_for(tmp_path / "busy"), signal.SIGTERM)
        assert next(calls)[1].status == "crashed"
        assert not survivors(mark)


def test_the_guardian_is_no_child_of_the_process_and_holds_no_file(tmp_path):
    with LocalPool(f.child, 1) as pool:
        assert dict(pool.map([0])) == {0: "none"}
    with LocalPool(f.process, 1) as pool:
        [(_, leader)] = pool.map([0])
        [guardian] = members(leader) - {leader}
        deadline = time.monotonic() + 10.0
        while len(files := os.listdir(f"/proc/{guardian}/fd")) > 1 and time.monotonic() < deadline:
            time.sleep(0.01)  # it has just been forked
        assert len(files) == 1
    deadline = time.monotonic() + 10.0
    while members(leader) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not members(leader)


def members(group):
    """Processes of a process group that are alive (not zombies)."""
    numbers = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, own = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue  # it has just ended
        if int(own) == group and state != "Z":
            numbers.add(int(stat.parent.name))
    return numbers


SCRIPT = """
import signal, sys
import pool_functions as f
from calib.execution.pools.local import LocalPool
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background process begins deaf to Ctrl-C
if __name__ == "__main__":
    folder, mark = sys.argv[1:]
    print("starting", flush=True)
    with LocalPool(f.solve, 2) as pool:
        list(pool.map([(f"{folder}/{number}", mark, "hang") for number in range(2)]))
"""


def start(folder, mark):
    script = folder / "script.py"
    script.write_text(SCRIPT)
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), mark],
        env={**environment(), MARK: mark}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        start_new_session=True,
    )  # fmt: skip


@pytest.mark.parametrize("kill", [os.kill, os.killpg])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL, signal.SIGABRT])
def test_nothing_is_left_when_the_parent_is_ended(tmp_path, number, kill):
    mark = new_mark()
    parent = start(tmp_path, mark)
    wait_for(tmp_path / "0")
    wait_for(tmp_path / "1")
    assert len(marked(mark)) >= 2 * PROGRAMS + 5  # two processes, the parent, the fork server, the resource tracker
    kill(parent.pid, number)
    assert not survivors(mark)
    parent.communicate()


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))])
def test_nothing_is_left_when_the_parent_is_killed_at_any_moment(tmp_path, seed):
    mark, rng = new_mark(), random.Random(seed)
    parent = start(tmp_path, mark)
    parent.stdout.readline()
    time.sleep(rng.uniform(0.0, 2.0))
    rng.choice([os.kill, os.killpg])(parent.pid, signal.SIGKILL)
    assert not survivors(mark)
    parent.communicate()
