"""A third party's simulator that changes between two runs, or from one evaluation to the next."""

import json
import sys
import warnings

import pytest
from echo_study import write_study
from undrawn import undrawn

from calib.store import read
from calib.store.trial import FORMER_CODE
from calib.workflows.calibrate import calibrate

MODULE = """\
import os
from tiny_simulators import Echo

class Bench(Echo):
    def run(self, values, excitation, laws, request):
        gain = {gain}
        return super().run({{**values, "gain": gain * values["gain"]}}, excitation, laws, request)
"""
STEADY, HALVED = "1.0", "1.0 / 2.0"
RANDOM = "1.0 + 0.05 * int.from_bytes(os.urandom(4)) / 2**32"
STUDY = ("tiny_simulators:Echo", "identity_bench:Bench")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the study with this gain of the simulator beside it, as a new process would."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    path = write_study(tmp_path, STUDY)

    def calibrated(gain, budget):
        (tmp_path / "identity_bench.py").write_text(MODULE.format(gain=gain))
        sys.modules.pop("identity_bench", None)
        return calibrate(path, budget=budget, quiet=True)

    yield calibrated
    sys.modules.pop("identity_bench", None)


@undrawn()
def test_a_gain_that_was_halved_between_two_runs_is_told_and_old_scores_are_gone(run, tmp_path):
    first = run(STEADY, 12)
    with pytest.warns(UserWarning, match="the code of module identity_bench has changed"):
        second = run(HALVED, 16)
    header, trials = read(tmp_path / "out")
    assert {trial.status for trial in trials[:12]} == {FORMER_CODE}
    assert trials[12].u == next(trial for trial in trials if trial.number == first.best_trial).u
    assert second.best_trial >= 12
    assert second.score.total == min(trial.cost for trial in trials)
    assert second.reproduced
    assert list(header.code) == ["identity_bench"]
    saved = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [failure["status"] for failure in saved["failures"]] == [FORMER_CODE]


def test_an_unchanged_simulator_goes_on_without_a_word(run, tmp_path):
    with undrawn():
        run(STEADY, 12)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = run(STEADY, 16)
    assert (found.reproduced, found.remarks, found.failed) == (True, (), 0)
    assert {trial.segment for trial in read(tmp_path / "out")[1]} <= {0, 1}
    assert "same score" in (tmp_path / "out" / "report.html").read_text()


def test_a_simulator_that_is_not_deterministic_is_told_with_both_numbers(run, tmp_path):
    found = run(RANDOM, 12)
    assert found.reproduced is False
    remark = found.remarks[0]
    assert f"was logged at a distance of {found.score.total:.6g} and is at" in remark
    assert "not deterministic" in remark
    page = (tmp_path / "out" / "report.html").read_text()
    assert "not reproducible" in page
    assert "cannot be reproduced" in page
