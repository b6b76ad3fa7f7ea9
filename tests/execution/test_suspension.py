"""Time in which a process is suspended does not count."""

import os
import signal
import subprocess
import sys
import time

import pool_functions as f
import pytest
from child_environment import environment

from calib.execution.pools.local import LocalPool
from calib.execution.suspension import SuspensionClock


def test_gaps_between_looks_add_up_and_a_busy_machine_makes_none():
    now = [0.0]
    clock = SuspensionClock(lambda: now[0], 0.25)
    for passed, suspended in [(0.25, 0.0), (1.2, 0.0), (20.25, 20.0), (0.0, 20.0), (5.25, 25.0), (-3600.0, 25.0)]:
        now[0] += passed
        assert clock.look() == pytest.approx(suspended)
    now[0] += 100.0
    clock.forget()
    assert clock.look() == pytest.approx(25.0)


@pytest.mark.slow
def test_a_call_whose_time_passed_while_the_pool_was_suspended_is_made_again(tmp_path, monkeypatch):
    """The first time it hangs and the clock says that the process was suspended; then it answers."""
    total = [0.0]

    def suspended():
        total[0] += 0.5
        return total[0]

    monkeypatch.setattr("calib.execution.pools.slot.suspended", suspended)
    with LocalPool(f.hang_at_first, 1, timeout=0.2, startup=1.0) as pool:
        [(_, answer)] = pool.map([(tmp_path / "calls", 1)])
        assert answer == "done"
        [(_, hopeless)] = pool.map([(tmp_path / "others", 99)])
    assert hopeless.status == "timeout"
    assert len((tmp_path / "others").read_text()) == 4


SCRIPT = """
import sys
import pool_functions as f
from calib.execution.pools.local import LocalPool

if __name__ == "__main__":
    with LocalPool(f.slow_square, 2, timeout=4.0, startup=60.0) as pool:
        print(sorted(pool.map([0.0, 0.0])), flush=True)
        print(sorted(pool.map([3.0, 3.0])), flush=True)
"""


@pytest.mark.slow
def test_a_pool_that_is_stopped_and_goes_on_loses_no_call(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    with subprocess.Popen(
        [sys.executable, tmp_path / "script.py"], stdout=subprocess.PIPE, text=True, env=environment()
    ) as process:
        assert process.stdout.readline() == "[(0, 0.0), (1, 0.0)]\n"
        time.sleep(0.5)
        for number, pause in ((signal.SIGSTOP, 8.0), (signal.SIGCONT, 0.0)):
            for pid in descendants(process.pid):
                os.kill(pid, number)
            time.sleep(pause)
        assert process.stdout.readline() == "[(0, 9.0), (1, 9.0)]\n"
    assert process.returncode == 0


def descendants(pid):
    """Return the number of a process and those of all that it has started."""
    listed = subprocess.run(["ps", "-e", "-o", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
    parents = [tuple(map(int, line.split())) for line in listed.splitlines()]
    found = [pid]
    for known in found:
        found += [child for child, parent in parents if parent == known]
    return found
