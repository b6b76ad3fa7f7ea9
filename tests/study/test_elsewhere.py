"""A study on workers elsewhere is bit for bit the one in this process, also when workers and schedulers are killed."""

import os
import random
import signal
import subprocess
import sys
import time
from functools import cache, partial

import pytest
from child_environment import environment
from dask_processes import DaskProcesses
from kills import KILLS
from study_fakes import lines, run, study

from calib.execution.pools import started
from calib.execution.pools.settings import PoolSettings
from calib.optimisers.cma import CmaEs
from calib.optimisers.multistart import Multistart
from calib.optimisers.optuna import OptunaSampler
from calib.optimisers.scipy import Scipy
from calib.optimisers.surrogate import Surrogate
from calib.store import Store, read

OPTIMISERS = {
    "multistart": Multistart,
    "surrogate": Surrogate,
    "cma": CmaEs,
    "optuna": OptunaSampler,
    "differential evolution": Scipy,
    "least squares": partial(Scipy, method="least_squares"),
}
SINGLE_NODE = PoolSettings(
    "executor", executor="executorlib:SingleNodeExecutor", options={"max_workers": 2, "block_allocation": True}
)


@pytest.fixture(scope="module")
def single_node():
    yield SINGLE_NODE
    started.end_all()


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """Lines of the ledger of a study in this process, by the name of its optimiser; each is run once."""

    @cache
    def run_here(name):
        return lines(run(study(**settings(name)), tmp_path_factory.mktemp("here")).trials)

    return run_here


def settings(name):
    """A study of which some trials fail."""
    return {"budget": 20, "optimiser": OPTIMISERS[name], "trouble": "diverge"}


def on(pool, folder, name):
    """Lines of the ledger of the same study on a pool."""
    return lines(study(**settings(name), pool=pool, timeout=60.0).run(Store(folder, view=None)).trials)


def test_a_study_on_dask_is_bit_for_bit_the_local_one(cluster, here, tmp_path):
    assert on(PoolSettings("dask", scheduler=cluster.address), tmp_path, "multistart") == here("multistart")


@pytest.mark.slow
@pytest.mark.parametrize("optimiser", OPTIMISERS)
def test_so_it_is_on_executorlib_for_every_optimiser(optimiser, single_node, here, tmp_path):
    assert on(single_node, tmp_path, optimiser) == here(optimiser)


@pytest.mark.slow
def test_so_it_is_on_three_workers_for_every_optimiser(here, tmp_path):
    with DaskProcesses(tmp_path / "dask") as processes:
        for _ in range(3):
            processes.add_worker()
        pool = PoolSettings("dask", scheduler=processes.address)
        for name in OPTIMISERS:
            assert on(pool, tmp_path / name, name) == here(name), name


SCRIPT = """
import sys
from calib.errors import WorkersLost
from calib.execution.pools.settings import PoolSettings
from calib.store import Store
from study_fakes import study
if __name__ == "__main__":
    folder, address = sys.argv[1:]
    pool = PoolSettings("dask", scheduler=address)
    try:
        study({budget}, seconds={seconds}, pool=pool, timeout=60.0).run(Store(folder))
    except WorkersLost as lost:
        print(lost)
        sys.exit(3)
"""
BUDGET, SECONDS = 32 + 16 * KILLS, 0.2
VICTIMS = ["worker", "scheduler", "study"]  # each is killed once at least, if there are three kills or more


@pytest.mark.slow
def test_random_kills_of_workers_scheduler_and_study_change_nothing(tmp_path):
    """A worker that is killed is replaced; a scheduler ends the run with code 3; the study is gone on with."""
    script, out, rng = tmp_path / "script.py", tmp_path / "out", random.Random(7)
    script.write_text(SCRIPT.format(budget=BUDGET, seconds=SECONDS))
    with DaskProcesses(tmp_path / "dask") as cluster:
        for _ in range(2):
            cluster.add_worker()

        def begun():
            return subprocess.Popen(
                [sys.executable, "-W", "ignore", str(script), str(out), cluster.address],
                env=environment(), stdout=subprocess.PIPE, text=True,
            )  # fmt: skip

        running, hits, victims = begun(), [], rng.sample(VICTIMS, len(VICTIMS))
        while len(hits) < KILLS:
            _wait_for_trials(out, _logged(out) + rng.randint(1, 6), running)
            time.sleep(rng.uniform(0.0, 0.3))
            hits.append(victims.pop() if victims else rng.choice(VICTIMS))
            if hits[-1] == "worker":
                cluster.kill_worker(rng.choice(cluster.workers))
                cluster.add_worker()
                continue
            if hits[-1] == "scheduler":
                cluster.kill_scheduler()
                said, _ = running.communicate(timeout=60)
                assert running.returncode == 3, said
                assert "the connection to the Dask scheduler" in said
                cluster.restart()
                for _ in range(2):
                    cluster.add_worker()
            else:
                os.kill(running.pid, signal.SIGKILL)
                running.communicate()
            running = begun()
        assert set(hits) == set(VICTIMS)
        running.communicate(timeout=300)
        assert running.returncode == 0
    whole = run(study(BUDGET), tmp_path / "whole").trials
    assert lines(read(out)[1]) == lines(whole)


def _logged(out):
    ledger = out / "trials.jsonl"
    return max(ledger.read_bytes().count(b"\n") - 1, 0) if ledger.exists() else 0


def _wait_for_trials(out, count, running):
    deadline = time.monotonic() + 120.0
    while _logged(out) < count:
        assert running.poll() is None, "the study ended before it was killed often enough"
        assert time.monotonic() < deadline, "no such trial within two minutes"
        time.sleep(0.02)
