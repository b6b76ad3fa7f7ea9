"""Programs that end with all that they have started."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from child_environment import environment
from marked_processes import MARK, marked, new_mark, survivors

from calib.execution.guarded import run_guarded

# a shell in the group, one in a session of its own, and an orphan of it in a session of its own
FAMILY = "sleep 600 & setsid sh -c 'setsid sleep 600 & sleep 600' & "
MEMBERS = 4


def ended(words, folder, mark="", watch=lambda: "", **more):
    with open(folder / "log", "wb") as log:
        return run_guarded(words, folder, log, {**os.environ, MARK: mark, **more}, new_mark(), watch)


@pytest.mark.parametrize(
    ("line", "code", "reason"),
    [
        ("echo done", 0, ""),
        ("exit 3", 3, "it ended with exit code 3"),
        ("kill -SEGV $$", None, "it was ended by signal 11"),
    ],
)
def test_the_end_of_a_program_is_told(tmp_path, line, code, reason):
    end = ended(["sh", "-c", line], tmp_path)
    assert (end.code, end.reason) == (code, reason)
    assert end.seconds > 0.0


def test_a_program_that_is_not_there_is_told(tmp_path):
    end = ended(["nonesuch-program"], tmp_path)
    assert end.code is None
    assert end.reason == "it cannot be executed: No such file or directory"


def test_a_program_runs_in_its_folder_without_input_or_shell_and_prints_to_the_log(tmp_path):
    program = "import os, sys; print(os.getcwd(), sys.argv[1:], repr(sys.stdin.read())); print('bad', file=sys.stderr)"
    ended([sys.executable, "-uc", program, "$HOME", "a b;c"], tmp_path)
    assert (tmp_path / "log").read_text() == f"{tmp_path} ['$HOME', 'a b;c'] ''\nbad\n"


def test_a_program_finds_its_signals_and_descriptors_as_a_shell_leaves_them(tmp_path):
    program = "import os, signal; print(sorted(os.listdir('/proc/self/fd'))[:4], signal.pthread_sigmask(0, []))"
    ended([sys.executable, "-c", program], tmp_path)
    assert (tmp_path / "log").read_text() == "['0', '1', '2', '3'] set()\n"  # 3 is that of the listing
    ended(["sh", "-c", "yes | head -1; echo ${PIPESTATUS:-ended}"], tmp_path)
    assert (tmp_path / "log").read_text() == "y\nended\n"


def test_what_a_program_leaves_behind_is_ended(tmp_path):
    mark = new_mark()
    assert ended(["sh", "-c", FAMILY + "exit 0"], tmp_path, mark).code == 0
    assert not marked(mark)


def test_a_program_that_is_given_up_is_ended_with_its_sessions_and_orphans(tmp_path):
    mark, seen = new_mark(), []

    def watch():
        seen[:] = marked(mark)
        return "it takes too long" if len(seen) > MEMBERS else ""

    end = ended(["sh", "-c", FAMILY + "wait"], tmp_path, mark, watch)
    assert (end.code, end.reason) == (None, "it takes too long")
    assert not marked(mark)


def test_an_exception_in_the_watch_ends_the_program(tmp_path):
    mark = new_mark()

    def watch():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ended(["sh", "-c", FAMILY + "wait"], tmp_path, mark, watch)
    assert not marked(mark)


def test_a_killed_guardian_takes_the_program_with_it(tmp_path):
    mark = new_mark()

    def watch():
        if len(processes := marked(mark)) > MEMBERS:
            [guardian] = {parent(pid) for pid in processes} & guardians()
            os.kill(guardian, signal.SIGKILL)
        return ""

    end = ended(["sh", "-c", FAMILY + "wait"], tmp_path, mark, watch)
    assert end.reason == "its guardian was killed"
    assert not survivors(mark)


def parent(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def guardians():
    numbers = [int(path.name) for path in Path("/proc").glob("[0-9]*")]
    return {pid for pid in numbers if b"guardian.py" in cmdline(pid)}


def cmdline(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:  # it has just ended
        return b""


def test_the_environment_is_the_program_s_alone(tmp_path):
    end = ended(["sh", "-c", "echo $OWN; tr '\\0' '\\n' < /proc/$PPID/environ | grep -c OWN"], tmp_path, OWN="a=b c")
    assert end.code == 1, "grep finds none"
    assert (tmp_path / "log").read_text() == "a=b c\n0\n"


SCRIPT = f"""
import os, sys
from pathlib import Path
from calib.execution.guarded import run_guarded
from calib.execution.process_group import lead_process_group
lead_process_group()
folder = Path(sys.argv[1])
with open(folder / "log", "wb") as log:
    run_guarded(["sh", "-c", {FAMILY!r} + "echo begun > begun; wait"], folder, log, dict(os.environ), "test")
"""


@pytest.mark.parametrize("kill", [os.kill, os.killpg])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_when_the_starter_or_its_group_is_killed(tmp_path, number, kill):
    mark = new_mark()
    starter = subprocess.Popen([sys.executable, "-c", SCRIPT, str(tmp_path)], env={**environment(), MARK: mark})
    limit = time.monotonic() + 60.0
    while not (tmp_path / "begun").exists() or len(marked(mark)) < MEMBERS + 3:
        assert time.monotonic() < limit
        time.sleep(0.01)
    kill(starter.pid, number)
    assert not survivors(mark)
    starter.wait()
