"""studies/calculix_beam: a program of others, calibrated on records of another code, hangs and dies now and then."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from marked_processes import MARK, new_mark, survivors
from programs import required

from calib.study_file import load

STUDY = Path(__file__).parents[1] / "studies" / "calculix_beam"
TRUE = {"youngs": 205e9, "gap": 1.01e-3, "stop_stiffness": 1e4, "damping": 40.0}  # of the records; see their README
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def calculix():
    """The tests of this file run it."""
    required("ccx")


@pytest.mark.parametrize("name", ["knock", "quick", "loud"])
def test_at_the_true_values_it_gives_the_record_of_the_other_code(name, tmp_path):
    study = load(STUDY, out=tmp_path)
    reference = study.reference(name)
    simulated = study.study.model.run(TRUE, reference.excitation, reference.request)
    assert simulated.status == "ok", simulated.reason
    assert "resampled" not in simulated.attrs  # CalculiX writes times with seven digits
    assert np.abs(simulated.time.values - reference.record.time.values).max() < 1e-9
    for channel in ("displacement", "velocity"):
        error = simulated[channel].values - reference.record[channel].values
        assert np.sqrt((error**2).mean()) < 1.3 * reference.record[f"{channel}_sigma"].item()


def sample(folder):
    """The study with one record, two windows and five trials, one of which hangs and one dies."""
    text = (STUDY / "study.toml").read_text().replace("records/", f"{STUDY}/records/")
    text = re.sub(r'\[\[record\]\]\nname = "(quick|loud)"(.*\n)*?\n', "", text)
    head, windows = text.split("[windows]")
    windows = re.sub("^(youngs|damping) = .*\n", "", windows, flags=re.MULTILINE)
    windows = windows.replace('low = "0.4 mm", high = "2 mm"', 'low = "0.3 mm", high = "1 mm"')
    windows = windows.replace('low = "2 N/mm"', 'low = "8 N/mm"')
    for old, new in {
        "budget = 200": "budget = 5\nscreen = 4",
        "settle = 5": "settle = 1",
        "periods = 2": "periods = 1",  # 0.4 s of processor time
    }.items():
        head = head.replace(old, new)
    folder.mkdir()
    for name in ("deck.inp.j2", "deck_small_step.inp.j2", "model.inc.j2", "solver.sh.j2"):
        (folder / name).symlink_to(STUDY / name)
    (folder / "study.toml").write_text(f"{head}[windows]{windows}")
    return folder


def test_hangs_and_crashes_cost_their_trials_alone_and_leave_nothing(tmp_path):
    home, mark = sample(tmp_path / "beam"), new_mark()
    line = [sys.executable, "-m", "calib", "run", str(home), "--quiet"]
    subprocess.run(line, check=True, env={**os.environ, MARK: mark})
    assert survivors(mark) == []
    ledger = (home / "out" / "trials.jsonl").read_text().splitlines()
    trials = [trial for trial in map(json.loads, ledger) if "number" in trial]
    assert len(trials) == 5
    for trial in trials:
        hangs, dies = trial["values"]["stop_stiffness"] > 30e3, trial["values"]["gap"] < 0.5e-3
        assert trial["status"] == ("timeout" if hangs else "program failed" if dies else "ok"), trial["reason"]
        if hangs:
            assert re.search("solver.sh deck: no result within .* s of wall-clock time", trial["reason"])
        elif dies:
            assert re.search("solver.sh deck: .* signal 11.*solver.sh deck_small_step: .* signal 11", trial["reason"])
    assert sorted(trial["status"] for trial in trials) == ["ok", "ok", "ok", "program failed", "timeout"]
    result = json.loads((home / "out" / "result.json").read_text())
    assert (result["status"], result["failed"], result["reproduced"]) == ("ok", 2, True)
    assert [path.name for path in (home / "out" / "runs").rglob("*")] == ["active"]
