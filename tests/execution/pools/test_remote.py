"""Evaluations on workers of another program: the same guarantees as in child processes of this one."""

import os
import re
import sys
import time
from dataclasses import replace

import pool_functions as f
import pytest
from dask_processes import DaskProcesses
from marked_processes import marked, new_mark, survivors

from calib.errors import CalibError, WorkersLost
from calib.execution.pools import started
from calib.execution.pools.results import ResultFolder, keep, kept
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers


@pytest.fixture(scope="module")
def executors():
    yield
    started.end_all()


@pytest.fixture(params=["dask", pytest.param("executor", marks=pytest.mark.slow)])
def settings(request, cluster, executors):
    if request.param == "dask":
        return PoolSettings("dask", scheduler=cluster.address)
    return PoolSettings("executor", executor="concurrent.futures:ProcessPoolExecutor", options={"max_workers": 2})


def results(pool, payloads):
    return dict(pool.map(payloads))


def test_a_call_fails_alone_with_status_and_reason(settings):
    with workers(f.misbehave, settings, 60.0) as pool:
        answers = results(pool, ["well", "raise", "refuse", "unpicklable", "exit", "segfault", "killed", "fine"])
    assert [answers[i] for i in (0, 7)] == ["well", "fine"]
    statuses = [answers[i].status for i in range(1, 7)]
    assert statuses == ["raised", "refused", "raised", "crashed", "crashed", "crashed"]
    assert "ValueError: the beam is too long" in answers[1].reason


def test_a_call_beyond_its_time_limit_is_killed_and_only_that_one(settings):
    with workers(f.misbehave, settings, 2.0) as pool:
        assert results(pool, ["a", "b", "c", "d"]) == {0: "a", 1: "b", 2: "c", 3: "d"}
        answers = results(pool, ["well", "hang", "good", "fine"])
    assert [answers[i] for i in (0, 2, 3)] == ["well", "good", "fine"]
    assert answers[1].status == "timeout"


def test_a_call_that_holds_too_much_memory_is_killed_and_only_that_one(settings):
    with workers(f.misbehave, replace(settings, memory=5e8), 60.0) as pool:
        answers = results(pool, ["well", "let a program hoard", "good", "fine"])
    assert [answers[i] for i in (0, 2, 3)] == ["well", "good", "fine"]
    assert answers[1].status == "memory"


def test_a_process_of_the_worker_is_kept_and_is_no_worker(settings):
    with workers(f.process, settings) as pool:
        processes = set(results(pool, range(12)).values())
    assert len(processes) <= 4
    assert os.getpid() not in processes


def test_leaving_the_loop_early_kills_what_runs_on_dask(cluster, tmp_path):
    mark = new_mark()
    with workers(f.solve, PoolSettings("dask", scheduler=cluster.address)) as pool:
        for _ in pool.map([(tmp_path / "idle", new_mark(), "well"), (tmp_path / "busy", mark, "hang")]):
            wait_until((tmp_path / "busy").exists)
            break
        assert not survivors(mark)
        assert len(results(pool, [(tmp_path / "more", new_mark(), "well")])) == 1, "the pool goes on"


def test_what_runs_on_an_executor_ends_when_its_pool_is_closed(executors, tmp_path):
    settings = PoolSettings("executor", executor="concurrent.futures:ThreadPoolExecutor", options={"max_workers": 2})
    mark, folder = new_mark(), ResultFolder(tmp_path / "kept", "study", content)
    with workers(f.solve, settings, results=folder) as pool:
        for _ in pool.map([(tmp_path / "idle", new_mark(), "well"), (tmp_path / "busy", mark, "hang")]):
            wait_until((tmp_path / "busy").exists)
            break
        assert marked(mark)
    wait_until(lambda: not marked(mark))
    with workers(f.square, settings, results=folder) as pool:
        assert results(pool, [3]) == {0: 9}, "the executor's workers are free for the next pool"


def wait_until(holds):
    deadline = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def content(payload):
    return str(payload)


def test_a_result_lies_in_the_folder_until_the_caller_takes_the_next(settings, tmp_path):
    folder, notes = ResultFolder(tmp_path / "kept", "study", content), []
    with workers(f.square, settings, results=folder, on_note=notes.append) as pool:
        loop = pool.map([3, 4])
        index, _ = next(loop)
        assert kept(folder.path, folder.key([3, 4][index])) is not None
        assert len(list(loop)) == 1
        keep(folder.path, folder.key(5), b"\x80\x04K*.")  # 42, as an earlier run might have left it
        assert results(pool, [5]) == {0: 42}
        assert results(pool, [5]) == {0: 25}, "it is taken over once"
    assert not folder.path.exists()
    assert len(notes) == 1
    assert re.fullmatch(f"each result is kept in {folder.path} by its worker before it is reported", notes[0])


def test_a_damaged_result_is_none(tmp_path):
    keep(tmp_path, "key", b"result")
    assert kept(tmp_path, "key") == b"result"
    (tmp_path / "key").write_bytes((tmp_path / "key").read_bytes()[:-1])
    assert kept(tmp_path, "key") is None


def test_a_worker_of_other_code_is_refused_with_what_differs(settings, monkeypatch):
    monkeypatch.setattr("calib.execution.pools.identity._package_digest", lambda: "0123456789ab")
    with (
        pytest.raises(CalibError, match=r"worker .* is no fit one: calib is .* there, .* source 0123456789ab here"),
        workers(f.square, settings) as pool,
    ):
        results(pool, [1])


@pytest.mark.slow
def test_a_worker_that_dies_costs_its_calls_alone_and_they_are_made_again(tmp_path):
    with DaskProcesses(tmp_path / "dask") as own:
        first = own.add_worker()
        with workers(f.slow_square, PoolSettings("dask", scheduler=own.address)) as pool:
            loop = pool.map([0.1, 0.2, 0.3, 0.4])
            answers = dict([next(loop)])
            own.kill_worker(first)
            own.add_worker()
            answers |= dict(loop)
            assert answers == {k: payload**2 for k, payload in enumerate([0.1, 0.2, 0.3, 0.4])}
            loop = pool.map([0.1, 500.0])
            next(loop)
            own.kill_scheduler()
            with pytest.raises(WorkersLost, match="the connection to the Dask scheduler at tcp.* is lost"):
                next(loop)


def test_threads_of_this_process_may_be_the_workers(executors):
    settings = PoolSettings("executor", executor="concurrent.futures:ThreadPoolExecutor", options={"max_workers": 2})
    with workers(f.misbehave, settings) as pool:
        assert pool.width == 2
        assert results(pool, ["well", "segfault"])[1].status == "crashed"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"kind": "dask"}, "needs scheduler or cluster; got none of them"),
        ({"kind": "dask", "scheduler": "tcp://a:1", "cluster": "a:B"}, "got scheduler and cluster"),
        ({"kind": "local", "executor": "a:B"}, 'executor belongs to kind = "executor"'),
        ({"kind": "executor", "executor": "loky"}, 'expected "module:Class"'),
        ({"kind": "dusk"}, "did you mean 'dask'"),
        ({"options": {"cores": 2}}, "there is none here"),
        ({"jobs": 0}, "a whole number from 1 on"),
        ({"jobs": 513}, "exceed the bound of 512"),
    ],
)
def test_settings_that_do_not_fit_together_are_refused(given, message):
    with pytest.raises(CalibError, match=message):
        PoolSettings(**given)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (PoolSettings("executor", executor="no_such_module:Pool"), "needs the module 'no_such_module'"),
        (PoolSettings("executor", executor="concurrent.futures:Pool"), "does not load"),
        (PoolSettings("executor", executor="test_remote_names:X"), "test_remote_names"),
        (PoolSettings("executor", executor="builtins:dict"), "is no executor: it has no submit and no shutdown"),
        (
            PoolSettings("executor", executor="concurrent.futures:ThreadPoolExecutor", options={"workers": 2}),
            "does not start with them",
        ),
    ],
)
def test_what_is_no_executor_is_refused(settings, message):
    with pytest.raises(CalibError, match=message):
        workers(f.square, settings)


def test_a_missing_package_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "calib.execution.pools.dask", raising=False)
    with pytest.raises(CalibError, match=r'`pip install "calib\[dask\]"` installs it'):
        workers(f.square, PoolSettings("dask", scheduler="tcp://127.0.0.1:1"))
