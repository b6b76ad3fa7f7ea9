"""Overhead of a pool for each evaluation, and what a second worker brings: `PYTHONPATH=tests python THIS`.

Evaluations sleep, so that other work on the machine matters little. The scheduler and the workers of Dask are processes
of their own, one thread each; the executor is one of executorlib. The overhead is the time per evaluation of many that
do nothing, on two workers that always have the next one, and the CPU time that all processes together spend on it; the
latency is the time of one evaluation by itself.
"""

import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import pool_functions as f
from dask_processes import DaskProcesses

from calib.execution.pool import OpenPool
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers

CALLS, ALONE = 200, 50  # of the overhead, of the latency
LONG, LONG_CALLS = 0.5, 20  # s; evaluations of the speed of two workers
REPEATS = 5  # of which the fastest counts


def overhead(pool: OpenPool) -> float:
    """Seconds for each of many evaluations that do nothing."""
    return min(_seconds(pool, [0.0] * CALLS) for _ in range(REPEATS)) / CALLS


def latency(pool: OpenPool) -> float:
    """Seconds of an evaluation that does nothing, by itself."""
    taken = []
    for _ in range(ALONE):
        taken.append(_seconds(pool, [0.0]))
    return sorted(taken)[len(taken) // 2]


def cpu_seconds() -> float:
    """CPU seconds of this process and of all that it, or one of them, has started and that still run."""
    parents, spent = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has just ended
            fields = stat.read_text().rpartition(")")[2].split()
            number = int(stat.parent.name)
            parents[number] = int(fields[1])
            spent[number] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    own = {os.getpid()}
    while more := {number for number, parent in parents.items() if parent in own} - own:
        own |= more
    return sum(spent[number] for number in own)


def _seconds(pool: OpenPool, payloads: list[float]) -> float:
    begin = time.perf_counter()
    assert len(list(pool.map(payloads))) == len(payloads)
    return time.perf_counter() - begin


def long_runs(pool: OpenPool) -> float:
    """Seconds of evaluations of half a second."""
    return _seconds(pool, [LONG] * LONG_CALLS)


def measured(name: str, one: PoolSettings, two: PoolSettings, join=lambda: None) -> None:
    """Print the figures of a pool; `join` adds the second worker."""
    with workers(f.slow_square, one) as pool:
        list(pool.map([0.0] * 4))
        alone, single = latency(pool), long_runs(pool)
    join()
    with workers(f.slow_square, two) as pool:
        list(pool.map([0.1] * 8))
        before = cpu_seconds()
        each = overhead(pool)
        spent, double = (cpu_seconds() - before) / (REPEATS * CALLS), long_runs(pool)
    print(
        f"{name:12} overhead {1e3 * each:5.2f} ms ({1e3 * spent:5.2f} ms of CPU), latency {1e3 * alone:5.1f} ms, "
        f"two workers / one {single / double:.2f}"
    )


def main() -> None:
    """Print the figures of each kind of pool."""
    measured("local", PoolSettings(jobs=1), PoolSettings(jobs=2))
    with tempfile.TemporaryDirectory() as folder, DaskProcesses(Path(folder) / "dask") as cluster:
        cluster.add_worker()
        pool = PoolSettings("dask", scheduler=cluster.address)
        measured("dask", pool, pool, cluster.add_worker)
    nodes = [
        PoolSettings(
            "executor", executor="executorlib:SingleNodeExecutor", options={"max_workers": n, "block_allocation": True}
        )
        for n in (1, 2)
    ]
    measured("executorlib", *nodes)


if __name__ == "__main__":
    main()
