"""What it costs to log a trial: CPU time of ledger and journal view together, and of the loop around them.

Run as ``python tests/benchmarks/bench_bookkeeping.py`` or with ``pytest tests/benchmarks/bench_bookkeeping.py``.

Measured at 2000 trials of 8 parameters, 400 residuals and 8 scalar features, on a busy machine of 2 cores:
ledger alone 0.7 ms CPU a trial, ledger and journal view 1.1 ms, of which half is the two syncs to disk; opening the
folder again 0.3 s CPU. The loop around them (pool, replay, scores) adds 1 ms. The wall-clock time is the disk's.
Reading the ledger takes 2.1 to 2.4 times the CPU time of a plain `json.loads` of each of its lines.
"""

import json
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from calib.store import Store, StudyHeader, Trial, read

TRIALS = 2000
LIMIT = 5e-3  # s of CPU a trial, ledger and view together
MAX_READING_RATIO = 4.0  # CPU time to read a ledger over that of a plain json.loads of each line
REPEATS = 3  # readings, of which the quickest counts
NAMES = [f"parameter_{i}" for i in range(8)]
WINDOWS = {name: {"low": 1e-3, "high": 1.0, "scale": "log"} for name in NAMES}
HEADER = StudyHeader("bookkeeping", {"windows": WINDOWS}, screen=0, budget=TRIALS)


def trial(number: int) -> Trial:
    """A trial as a study of two records makes it."""
    rng = np.random.default_rng(number)
    u = rng.random(len(NAMES))
    feature = {"label": "amplitude", "record": "clapping", "body": "layer", "unit": "m", "tolerance": 1e-5}
    return Trial(
        number=number,
        u=u.tolist(),
        values=dict(zip(NAMES, 10.0 ** (3.0 * (u - 1.0)), strict=True)),
        cost=float(rng.random()),
        terms={"phase_curve(layer)": float(rng.random()), "amplitude(layer)": float(rng.random())},
        kind="period-1",
        seconds=0.1,
        features=[{**feature, "measured": float(rng.random()), "simulated": float(rng.random())} for _ in range(8)],
        residuals=rng.normal(size=400),
    )


def cpu() -> float:
    """CPU time of this process, user and system  [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def cost(folder: Path, view: str | None) -> tuple[float, float, float]:
    """CPU and wall-clock time a trial to log, and CPU to open the folder again  [s]."""
    trials = [trial(number) for number in range(TRIALS)]
    store = Store(folder, view)
    store.open(HEADER)
    begin, clock = cpu(), time.perf_counter()
    for one in trials:
        store.append(one)
    store.close()
    logging, wall = (cpu() - begin) / TRIALS, (time.perf_counter() - clock) / TRIALS
    begin = cpu()
    with Store(folder, view) as store:
        assert len(store.open(HEADER)) == TRIALS
    return logging, wall, cpu() - begin


def test_logging_a_trial_costs_less_than_five_milliseconds(tmp_path):
    assert cost(tmp_path, "journal")[0] < LIMIT


def reading_ratio(folder: Path) -> float:
    """CPU time to read the ledger of a folder over that of a plain `json.loads` of each line  [1]."""

    def plainly() -> None:
        with open(folder / "trials.jsonl", "rb") as file:
            assert len([json.loads(line) for line in file]) == TRIALS + 1

    def spent(reading) -> float:
        begin = cpu()
        reading()
        return cpu() - begin

    return min(spent(lambda: read(folder)) for _ in range(REPEATS)) / min(spent(plainly) for _ in range(REPEATS))


def test_opening_a_ledger_costs_a_few_times_a_plain_reading_of_its_lines(tmp_path):
    cost(tmp_path, None)
    assert reading_ratio(tmp_path) < MAX_READING_RATIO


if __name__ == "__main__":
    for name, view in (("ledger alone", None), ("ledger and journal view", "journal")):
        with tempfile.TemporaryDirectory(dir=Path.cwd()) as place:
            logging, wall, opening = cost(Path(place), view)
            ratio = reading_ratio(Path(place))
        spent = f"{1e3 * logging:.2f} ms CPU and {1e3 * wall:.2f} ms a trial"
        print(f"{name:24} {spent}, {opening:.2f} s CPU to open again, {ratio:.1f} times json.loads to read")
