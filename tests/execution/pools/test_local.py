"""Evaluations in child processes: a call fails alone, and nothing outlives the parent."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pool_functions as f
import pytest
from child_environment import environment
from marked_processes import MARK, marked, new_mark, survivors

from calib.errors import CalibError
from calib.execution.pool import Failure, InProcess
from calib.execution.pools.local import LocalPool
from calib.store.trial import one_line


def results(pool, payloads):
    return dict(pool.map(payloads))


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_every_payload_is_answered_under_its_index(jobs):
    with LocalPool(f.square, jobs) as pool:
        assert results(pool, range(7)) == {i: i * i for i in range(7)}
        assert results(pool, [5]) == {0: 25}
        assert results(pool, []) == {}


def test_results_come_as_they_end():
    with LocalPool(f.slow_square, 2) as pool:
        results(pool, [0.0, 0.0])
        assert [index for index, _ in pool.map([1.5, 0.01, 0.02])] == [1, 2, 0]


class Growing:
    """Payloads, to which others are added when some have ended."""

    def __init__(self, *payloads):
        self.payloads = list(payloads)

    def __iter__(self):
        return self

    def __next__(self):
        if not self.payloads:
            raise StopIteration
        return self.payloads.pop(0)


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_follows_from_a_result_begins_at_once(jobs):
    with LocalPool(f.slow_square, jobs) as pool:
        results(pool, [0.0] * jobs)
        payloads, ended = Growing(1.5, 0.0), []
        for index, _ in pool.map(payloads):
            ended.append(index)
            payloads.payloads += [0.1] * (index in (1, 2))
    assert ended == ([0, 1, 2, 3] if jobs == 1 else [1, 2, 3, 0])


def test_processes_are_kept_from_call_to_call():
    with LocalPool(f.process, 2) as pool:
        assert len(set(results(pool, range(10)).values()) | set(results(pool, range(10)).values())) <= 2


@pytest.mark.parametrize(
    ("how", "status", "reason"),
    [
        ("raise", "raised", "ValueError: the beam is too long"),
        ("refuse", "refused", "unknown parameter 'alhpa'"),
        ("unpicklable", "raised", "pickle"),
        ("exit", "crashed", "exit code 7"),
        ("segfault", "crashed", "SIGSEGV"),
        ("killed", "crashed", "out of memory"),
    ],
)
def test_a_call_fails_alone_with_status_and_reason(how, status, reason):
    with LocalPool(f.misbehave, 2) as pool:
        answers = results(pool, ["well", how, "good", "fine"])
    assert [answers[i] for i in (0, 2, 3)] == ["well", "good", "fine"]
    assert isinstance(answers[1], Failure)
    assert answers[1].status == status
    assert reason in answers[1].reason


@pytest.mark.parametrize(
    ("how", "message", "code"),
    [("interrupt", "KeyboardInterrupt", "raise KeyboardInterrupt"), ("quit", "SystemExit: 3", "sys.exit(3)")],
)
def test_what_ends_an_interpreter_is_reported_with_the_line_that_raised_it(how, message, code):
    with LocalPool(f.misbehave, 1) as pool:
        failure = results(pool, [how])[0]
    lines = Path(f.__file__).read_text().splitlines()
    [line] = [number for number, text in enumerate(lines, 1) if text.strip() == code]
    assert failure.status == "raised"
    assert failure.reason == f"{message} ({f.__file__}, line {line}: {code})"


def test_an_exception_is_reported_with_the_line_that_raised_it():
    with InProcess(f.misbehave) as pool:
        ((index, failure),) = pool.map(["raise"])
    assert index == 0
    assert isinstance(failure, Failure)
    assert failure.status == "raised"
    lines = Path(f.__file__).read_text().splitlines()
    [line] = [number for number, text in enumerate(lines, 1) if text.strip().startswith("raise ValueError")]
    raised = 'raise ValueError("the beam is too long")'
    assert failure.reason == f"ValueError: the beam is too long ({f.__file__}, line {line}: {raised})"


@pytest.mark.parametrize(
    ("how", "message", "code"),
    [
        ("raise in a library", "LinAlgError: Singular matrix", "np.linalg.solve(np.zeros((2, 2)), np.ones(2))"),
        ("raise at length", " ... (", 'raise OverflowError("a beam too long, " * 100)'),
    ],
)
def test_the_line_told_is_that_of_the_study_s_author_whatever_the_message(how, message, code):
    with InProcess(f.misbehave) as pool:
        ((_, failure),) = pool.map([how])
    reason = one_line(failure.reason)
    assert message in reason
    assert f"({f.__file__}, line " in reason
    assert reason.endswith(f": {code})")


@pytest.mark.parametrize("how", ["hang", "hang with a deaf interpreter"])
def test_a_call_beyond_its_limit_is_killed_and_only_that_one(how):
    with LocalPool(f.misbehave, 2, timeout=1.0, startup=10.0) as pool:
        results(pool, ["a", "b", "c", "d"])
        start = time.perf_counter()
        answers = results(pool, ["well", how, "good", "fine"])
        assert time.perf_counter() - start < 100.0  # it hangs for 1000 s
    assert answers[1].status == "timeout"
    assert [answers[i] for i in (0, 2, 3)] == ["well", "good", "fine"]


def test_the_first_call_of_a_process_has_a_warm_up_allowance():
    with LocalPool(f.slow_square, 1, timeout=0.2, startup=5.0) as pool:
        assert results(pool, [0.5]) == {0: 0.25}
        assert results(pool, [100.0])[0].status == "timeout"
        assert results(pool, [0.5]) == {0: 0.25}, "a new process has its own allowance"


def test_a_first_call_that_hangs_says_how_long_it_was_waited_for_and_why():
    with LocalPool(f.slow_square, 1, timeout=0.5, startup=1.5) as pool:
        reason = results(pool, [100.0])[0].reason
    first = ", of which 1.5 s for what the first call of a process imports and compiles"
    assert reason == f"no result within 2 s of wall-clock time{first}"
    with LocalPool(f.slow_square, 1, timeout=0.5, startup=5.0) as pool:
        assert results(pool, [0.0]) == {0: 0.0}
        assert results(pool, [100.0])[0].reason == "no result within 0.5 s of wall-clock time"


def test_each_stage_has_an_allowance_of_its_own():
    """A stage that compiles more than those before it does not run into the time limit."""
    with LocalPool(f.slow_square, 1, timeout=0.2, startup=5.0) as pool:
        assert dict(pool.map([0.0], "search")) == {0: 0.0}
        assert dict(pool.map([0.5], "confirm")) == {0: 0.25}
        assert dict(pool.map([100.0], "search"))[0].status == "timeout"


def test_a_process_that_follows_one_that_hung_is_not_given_the_time_to_compile_again(monkeypatch):
    monkeypatch.setattr("calib.execution.pools.limits.MIN_STARTUP_ALLOWANCE", 0.5)
    with LocalPool(f.misbehave, 1, timeout=0.5, startup=100.0) as pool:
        assert results(pool, ["well"]) == {0: "well"}
        failures = results(pool, ["hang", "hang"]).values()
    assert {failure.status for failure in failures} == {"timeout"}
    assert max(failure.seconds for failure in failures) < 50.0  # with the time to compile it would be 100 s


@pytest.mark.parametrize("how", ["hoard", "let a program hoard"])
def test_a_call_that_holds_too_much_memory_is_killed_and_only_that_one(how):
    with LocalPool(f.misbehave, 2, memory=5e8) as pool:
        answers = results(pool, ["well", how, "good", "fine"])
        assert results(pool, ["a", "b", "c"]) == {0: "a", 1: "b", 2: "c"}
    assert answers[1].status == "memory"
    assert re.fullmatch(
        "the process and its programs held .* GB of memory, and .pool. memory allows 0.5 GB", answers[1].reason
    )
    assert [answers[i] for i in (0, 2, 3)] == ["well", "good", "fine"]


def test_a_process_killed_while_idle_is_replaced():
    with LocalPool(f.process, 1) as pool:
        (pid,) = results(pool, [0]).values()
        os.kill(pid, signal.SIGKILL)
        (other,) = results(pool, [0]).values()
        assert isinstance(other, int)
        assert other != pid


def test_leaving_the_loop_early_kills_what_runs_and_the_pool_goes_on():
    with LocalPool(f.slow_square, 2) as pool:
        start = time.perf_counter()
        for _ in pool.map([0.01, 500.0, 500.0]):
            break
        assert results(pool, [0.0]) == {0: 0.0}
        assert time.perf_counter() - start < 100.0


def test_children_compute_on_one_thread_and_the_parent_keeps_its_setting(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with LocalPool(f.threads, 1) as pool:
        assert set(results(pool, [0])[0].values()) == {"1"}
    assert os.environ["OMP_NUM_THREADS"] == "2"


def test_children_inherit_no_file_of_the_parent(tmp_path):
    with open(tmp_path / "lock", "w"), LocalPool(f.open_files, 1) as pool:
        assert not [name for name in results(pool, [0])[0] if str(tmp_path) in name]


@pytest.mark.parametrize("jobs", [0, -1, 1.5, "2", True])
def test_jobs_is_a_whole_number_from_one_on(jobs):
    with pytest.raises(CalibError, match="an integer of at least 1"):
        LocalPool(f.square, jobs)


def test_jobs_are_bounded():
    with pytest.raises(CalibError, match="jobs: 513 child processes exceed the bound of 512; state at most"):
        LocalPool(f.square, 513)


def test_a_time_out_is_positive():
    with pytest.raises(CalibError, match="positive"):
        LocalPool(f.square, 1, timeout=0.0)


def test_a_memory_limit_is_positive():
    with pytest.raises(CalibError, match="memory must be positive"):
        LocalPool(f.square, 1, memory=-1.0)


def test_a_function_that_cannot_be_sent_is_refused():
    with pytest.raises(CalibError, match="module level"):
        LocalPool(lambda x: x)


def test_a_function_that_fails_to_arrive_is_a_failure_of_the_call():
    with LocalPool(f.NotUnpicklable(), 1) as pool:
        failure = results(pool, [0])[0]
    assert failure.status == "raised"
    assert "somewhere_else" in failure.reason


def test_the_same_contract_in_this_process():
    with InProcess(f.misbehave) as pool:
        answers = results(pool, ["well", "raise", "refuse"])
    assert answers[0] == "well"
    assert [answers[i].status for i in (1, 2)] == ["raised", "refused"]


SCRIPT = """
import signal
import pool_functions as f
from calib.execution.pools.local import LocalPool
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background process begins deaf to Ctrl-C
if __name__ == "__main__":
    with LocalPool(f.{function}, 2) as pool:
        try:
            for index, result in pool.map({payloads}):
                print(result, flush=True)
        except KeyboardInterrupt:
            print("stopped", flush=True)
"""


def start(tmp_path, function, payloads, script=SCRIPT, mark=""):
    file = tmp_path / "script.py"
    file.write_text(script.format(function=function, payloads=payloads))
    return subprocess.Popen(
        [sys.executable, str(file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**environment(), MARK: mark},
        start_new_session=True,
    )


@pytest.mark.parametrize("function", ["slow_square", "spin"])
def test_children_end_when_the_parent_is_killed(tmp_path, function):
    script = SCRIPT.replace("if __name__", SPIN + "\nif __name__", 1) if function == "spin" else SCRIPT
    script = script.replace("f.{function}", "{function}") if function == "spin" else script
    mark = new_mark()
    parent = start(tmp_path, function, [0.0, 0.0, 600.0, 600.0], script, mark)
    assert parent.stdout.readline().strip() == "0.0"
    assert parent.stdout.readline().strip() == "0.0"
    time.sleep(0.3)
    assert len(marked(mark)) >= 5  # with the fork server and the resource tracker
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    assert not survivors(mark)
    parent.communicate()


SPIN = '''
import ctypes
def spin(seconds):
    """Sleep without ever giving the interpreter away, as a kernel compiled without nogil does."""
    ctypes.PyDLL(None).usleep(int(seconds * 1e6))
    return seconds * seconds
'''


def test_ctrl_c_reaches_the_parent_only(tmp_path):
    mark = new_mark()
    parent = start(tmp_path, "slow_square", [0.0, 0.0, 600.0, 600.0], mark=mark)
    parent.stdout.readline()
    parent.stdout.readline()
    time.sleep(0.2)
    os.killpg(parent.pid, signal.SIGINT)  # as a terminal does: to all of them
    out, err = parent.communicate(timeout=20)
    assert out.strip() == "stopped"
    assert "Traceback" not in err
    assert parent.returncode == 0
    assert not survivors(mark)


@pytest.mark.parametrize("delay", [0.0, 0.3, *(pytest.param(late, marks=pytest.mark.slow) for late in (0.1, 0.6, 1.0))])
def test_ctrl_c_while_the_processes_start_leaves_no_complaint(tmp_path, delay):
    script = SCRIPT.replace("        try:", "        try:\n            print('starting', flush=True)")
    mark = new_mark()
    parent = start(tmp_path, "slow_square", [600.0, 600.0], script, mark)
    assert parent.stdout.readline().strip() == "starting"
    time.sleep(delay)
    os.killpg(parent.pid, signal.SIGINT)
    out, err = parent.communicate(timeout=60)
    assert out.strip() == "stopped"
    assert err == ""
    assert not survivors(mark)


UNGUARDED = SCRIPT.replace('if __name__ == "__main__":', "if True:")


def test_a_script_needs_no_main_guard(tmp_path):
    parent = start(tmp_path, "square", [1, 2], UNGUARDED)
    out, err = parent.communicate(timeout=60)
    assert sorted(out.split()) == ["1", "4"], err  # whichever is ready first comes first


def test_a_script_may_come_from_standard_input(tmp_path):
    script = UNGUARDED.format(function="square", payloads=[1, 2])
    done = subprocess.run(
        [sys.executable, "-"], input=script, env=environment(), capture_output=True, text=True, timeout=60
    )
    assert sorted(done.stdout.split()) == ["1", "4"], done.stderr


def test_a_script_that_defines_the_function_is_told_of_the_main_guard(tmp_path):
    script = "def own(x):\n    return x\n" + UNGUARDED.replace("f.{function}", "{function}")
    parent = start(tmp_path, "own", [1, 2], script)
    _, err = parent.communicate(timeout=60)
    assert parent.returncode != 0
    assert "if __name__ == '__main__':" in err
