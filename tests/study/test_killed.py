"""`calib run`, killed at random moments, ends with what it would have found uninterrupted."""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from kills import KILLS

ROOT = Path(__file__).parents[2]
BUDGET = max(60, 15 * KILLS)
TIMES = ("seconds",)  # the only entry of result.json that may differ


def study(folder, optimiser):
    """studies/minimal beside its records, with an optimiser; shortened to what the kills need."""
    home = folder / "studies" / "minimal"
    home.mkdir(parents=True)
    text = (ROOT / "studies" / "minimal" / "study.toml").read_text()
    text = re.sub("(?m)^budget = .*", f"budget = {BUDGET}", text).replace("multistart", optimiser)
    (home / "study.toml").write_text(text)
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
        del trial["crc32"]  # of a line with its times
    return result, trials


def logged(out):
    """Number of trials in the ledger."""
    ledger = out / "trials.jsonl"
    return max(ledger.read_bytes().count(b"\n") - 1, 0) if ledger.exists() else 0  # its first line is the header


@pytest.fixture(scope="module", params=["multistart", "surrogate"])
def whole(request, tmp_path_factory):
    """Folder of the study that nothing has killed."""
    folder = tmp_path_factory.mktemp("whole") / request.param
    subprocess.run(command(study(folder, request.param), folder / "out", 1), check=True)
    return folder / "out"


@pytest.mark.slow
def test_many_kills_change_nothing(whole, tmp_path):
    """Killed while it starts, after a few more trials each, and the last time when the search is over."""
    home, killed = study(tmp_path, whole.parent.name), tmp_path / "killed"
    trials, rng = logged(whole), random.Random(2)
    for kill in range(KILLS):
        until = logged(killed) + rng.randint(0, 2 * trials // (3 * KILLS)) if kill < KILLS - 1 else trials
        process = subprocess.Popen(command(home, killed, 2), stderr=subprocess.DEVNULL)
        limit = time.monotonic() + 300.0
        while logged(killed) < until:
            assert process.poll() is None, "the study ended before it was killed often enough"
            assert time.monotonic() < limit, "no such trial within five minutes"
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.3))  # s; about ten trials
        assert process.poll() is None, "the study ended before it was killed often enough"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    subprocess.run(command(home, killed, 1), check=True)
    assert found(killed) == found(whole)
