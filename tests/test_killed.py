"""`calib run`, killed at random moments, ends with what it would have found uninterrupted."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
KILLS = 20
TIMES = ("seconds",)  # the only entry of result.json that may differ


def study(folder):
    """studies/minimal with fewer trials, beside its records."""
    home = folder / "studies" / "minimal"
    home.mkdir(parents=True)
    text = (ROOT / "studies" / "minimal" / "study.toml").read_text()
    assert "budget = 300" in text
    (home / "study.toml").write_text(text.replace("budget = 300", "budget = 150"))
    shutil.copytree(ROOT / "experiments_ref", folder / "experiments_ref")
    return home


def command(home, out, jobs):
    return [sys.executable, "-m", "calib", "run", str(home), "--out", str(out), "--jobs", str(jobs), "--quiet"]


def found(out):
    """result.json and the trial list, without times."""
    result = json.loads((out / "result.json").read_text())
    lines = [json.loads(line) for line in (out / "trials.jsonl").read_text().splitlines()]
    trials = sorted((line for line in lines if "number" in line), key=lambda line: line["number"])
    for entry in (result, *trials):
        for name in TIMES:
            del entry[name]
    for trial in trials:
        trial["residuals"] = trial["residuals"][1]  # where they lie in the side file is a matter of the order of ending
    return result, trials


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_twenty_kills_change_nothing(jobs, tmp_path):
    home = study(tmp_path)
    subprocess.run(command(home, tmp_path / "whole", 1), check=True)
    rng = random.Random(jobs)
    kills = 0
    while kills < KILLS:
        process = subprocess.Popen(command(home, tmp_path / "killed", jobs), stderr=subprocess.DEVNULL)
        ledger = tmp_path / "killed" / "trials.jsonl"
        before = ledger.stat().st_size if ledger.exists() else 0
        limit = time.monotonic() + 300.0
        while (ledger.stat().st_size if ledger.exists() else 0) <= before and process.poll() is None:
            assert time.monotonic() < limit, "no trial within five minutes"
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.25))  # s; about one twentieth of the study
        if process.poll() is not None:
            break
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        kills += 1
    assert kills >= KILLS // 2, "the study ended before it was killed often enough"
    subprocess.run(command(home, tmp_path / "killed", jobs), check=True)
    assert found(tmp_path / "killed") == found(tmp_path / "whole")
