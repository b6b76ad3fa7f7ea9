"""What a long study costs: memory a trial while it runs, and the time in which it opens again when it is finished.

Run as ``python tests/benchmarks/bench_long_study.py [TRIALS]`` (20 000), or with ``--folder`` to keep the study.

Measured at 20 000 trials of 2 parameters, 222 residuals and 6 scalar features, on a busy machine: 7.7 kB a trial before
residuals were read from disk, 1.3 kB since. Opened again it takes 7.0 s of CPU (`run`), 5.2 s (`report`) and 3.0 s
(`status`) beside eight other processes on two cores; of 7 s some 2.4 s are imports, 1.3 s the ledger, 1.1 s the
confidence intervals and 0.9 s the report. Nothing is replayed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from child_environment import environment
from echo_study import write_study

from calib.store import Store
from calib.study.evaluation import Evaluation, evaluate
from calib.study_file import load

TRIALS = 20_000
TERMS = "".join(f'[[term]]\nfeature = "{name}"\n' for name in ("amplitude", "harmonics"))
SEED = 0
WAVES = 100.0


class LinearPool:
    """Evaluates nothing: residuals are linear in the values, all else is that of one evaluation."""

    def __init__(self, study) -> None:
        self._space = study.space
        self._first = evaluate(study, study.space.values(np.full(study.space.dim, 0.4)))
        rng = np.random.default_rng(SEED)
        self._slopes = rng.normal(size=(len(self._first.score.residuals), study.space.dim))

    def map(self, tasks) -> Iterator[tuple[int, Evaluation]]:
        for index, values in enumerate(tasks):
            change = [values[name] / window.high for name, window in self._space.windows.items()]
            residuals = self._first.score.residuals + np.sin(WAVES * self._slopes @ change)  # of many minima
            cost = float(np.sqrt(np.mean(residuals**2)))
            features = [{**one, "simulated": change[0] + order} for order, one in enumerate(self._first.features)]
            score = replace(self._first.score, cost=cost, residuals=residuals)
            yield index, replace(self._first, score=score, features=features)


def resident() -> float:
    """Resident memory of this process  [kB]."""
    return float(next(line for line in open("/proc/self/status") if line.startswith("VmRSS")).split()[1])


def logged(folder: Path, trials: int) -> float:
    """Run a study of so many trials in `folder`; return how much memory a trial of the second half took  [kB]."""
    path = write_study(folder, ("budget = 24", f"budget = {trials}"), ("[optimiser]", f"{TERMS}[optimiser]"),
                       ('"multistart"', '"cma"'))  # fmt: skip
    file = load(path)
    levels = {}

    def watch(trial, best, number) -> None:
        if number in (trials // 2, trials):
            levels[number] = resident()

    synced, os.fsync = os.fsync, lambda handle: None  # the disk is not what is measured
    try:
        file.study.run(Store(file.folder, keep="best"), LinearPool(file.study), on_trial=watch)
    finally:
        os.fsync = synced
    return (levels[trials] - levels[trials // 2]) / (trials - trials // 2)


def spent(folder: Path, *command: str) -> tuple[float, float]:
    """CPU and wall-clock time of a command on the study  [s]."""
    before, clock = os.times(), time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "calib", *command], cwd=folder, env=environment(), check=True, stdout=subprocess.DEVNULL
    )
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return used, time.monotonic() - clock


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("trials", nargs="?", type=int, default=TRIALS)
    parser.add_argument("--folder", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        if not (folder / "out" / "trials.jsonl").exists():
            folder.mkdir(exist_ok=True)
            print(f"{asked.trials} trials: {logged(folder, asked.trials):.2f} kB of memory a trial")
        subprocess.run([sys.executable, "-m", "calib", "run", "--quiet", "."], cwd=folder, env=environment())
        for command in (("run", "--quiet", "."), ("status", "."), ("report", ".")):
            used, clock = spent(folder, *command)
            print(f"calib {command[0]:7} {used:5.1f} s of CPU, {clock:5.1f} s")
