"""result.json says what a study found."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calib.errors import CalibError
from calib.modelling.parameter import Parameter, Space, Window
from calib.report.pages import tables
from calib.store import Trial
from calib.study import CalibrationResult, ConfidenceSummary, Reach, SearchResult, result
from calib.study.result import FailureSummary, HeldOutSummary, ParameterSummary, ScoreSummary
from calib.study.summary import held_out, summarised
from calib.study_file.stored_simulator import StoredSimulator

STUDY = SimpleNamespace(
    name="s",
    model=SimpleNamespace(
        name="beam",
        bodies=("beam",),
        initial={"start": ("beam", "displacement")},
        simulator=SimpleNamespace(sites=frozenset()),
        title="beam.exe (command)",
        parameters={"gap": Parameter("gap", "m", 1e-3, "clearance"), "limit": Parameter("limit", "N", math.inf, "")},
    ),
    space=Space({"gap": Window(1e-4, 2e-3)}),
)
TRIALS = [
    Trial(0, [0.1], {"gap": 3e-4}, 0.5, {"a": 0.5}, kind="period 1", phase="screen"),
    Trial(1, [0.2], {"gap": 5e-4}, math.inf, {"a": math.inf}, status="diverged", reason="too fast"),
    Trial(2, [0.3], {"gap": 7e-4}, 0.25, {"a": 0.25}, kind="period 1"),
]
SAMPLES = Path(__file__).parents[1] / "samples" / "v0_1"
ARCHITECTURE = {
    "name", "status", "values", "units", "intervals", "undetermined", "at_edge", "unreachable", "score", "motion",
    "trials", "failed", "seconds",
}  # fmt: skip


SURE = ConfidenceSummary(
    "ok", interval={"gap": (6e-4, 8e-4)}, standard_error={"gap": 5e-5}, at_edge={"gap": "low"}
)  # fmt: skip


def of_the_study(reach=(), agreement=None, **more):
    search = SearchResult(TRIALS[2], TRIALS, list(reach), agreement, "budget spent")
    return summarised(STUDY, search, best=TRIALS[2], **more)


def test_every_promised_key_is_there():
    assert set(of_the_study().as_dict()) >= ARCHITECTURE


def test_the_model_is_described_as_far_as_a_report_shows_it():
    model = CalibrationResult.from_dict(json.loads(json.dumps(of_the_study().as_dict()))).model
    assert (model.name, model.bodies) == ("beam", ("beam",))
    assert (model.title, model.takes_laws) == ("beam.exe (command)", False)
    assert model.parameters["gap"] == ParameterSummary("m", 1e-3, "clearance")
    stored = StoredSimulator(model)
    assert stored.initial == {"start": ("beam", "displacement")}
    assert [one.nominal for one in stored.parameters] == [1e-3, math.inf]
    with pytest.raises(CalibError, match="does not simulate"):
        stored.run({}, None, (), None)


def test_values_have_units_and_intervals():
    found = of_the_study(confidence=SURE)
    assert found.values == {"gap": 7e-4}
    assert found.units == {"gap": "m"}
    assert found.intervals == {"gap": (6e-4, 8e-4)}
    assert found.at_edge == ("gap",)


def test_trials_and_failures_are_counted():
    found = of_the_study()
    assert (found.trials, found.failed, found.best_trial) == (3, 1, 2)
    assert found.failures == (FailureSummary("diverged", 1, "too fast"),)


REASONS = [  # of failed trials, status before
    (
        "program failed",
        "./knock deck.txt: it was ended by signal 6; details: its log ends: READ; kept in runs/failed-5cd4",
    ),
    ("program failed", "./knock deck.txt: it printed 'ERROR' (fail_if); details: kept in runs/failed-a1cb"),
    ("timeout", "./knock deck.txt: no result within 4.7 s of wall-clock time; details: its log ends: STEP 3"),
    (
        "program failed",
        "./knock deck.txt: it was ended by signal 6; details: its log ends: READ; kept in runs/failed-16e3",
    ),
    ("timeout", "./knock deck.txt: no result within 4.72 s of wall-clock time; details: its log ends: STEP 17"),
    ("program failed", "./knock deck.txt: it was ended by signal 11; details: kept in runs/failed-77aa"),
    ("program failed", "./knock deck.txt: it was ended by signal 6"),
]


def test_trials_that_fail_for_one_cause_are_one_line_in_result_and_report():
    trials = [
        replace(TRIALS[1], number=number, status=status, reason=reason)
        for number, (status, reason) in enumerate(REASONS)
    ]
    found = summarised(STUDY, SearchResult(None, trials, [], None, "budget spent"))
    assert [(one.trials, one.reason) for one in found.failures] == [
        (3, REASONS[0][1]),
        (2, REASONS[2][1]),
        (1, REASONS[1][1]),
        (1, REASONS[5][1]),
    ]
    rows = [(row.number, row.example, row.trials) for row in tables.failures(trials)]
    assert rows == [
        (one.trials, one.reason, numbers)
        for one, numbers in zip(found.failures, [(0, 3, 6), (2, 4), (1,), (5,)], strict=True)
    ]


def test_a_failed_study_has_no_score():
    found = summarised(STUDY, SearchResult(None, TRIALS[1:2], [], None, "budget spent"))
    assert found.status == "failed"
    assert found.score == ScoreSummary(None, {})


def test_only_what_is_not_reached_is_listed():
    reach = [
        Reach("amplitude", "r", "q3", "m", 2e-3, 0.0, 5e-4, 1e-3, nearest=1e-3, off=1e-3, reached=reached)
        for reached in (True, False)
    ]
    [feature] = of_the_study(reach=reach).unreachable
    assert (feature.measured, feature.percent) == (2e-3, 50.0)


def test_what_is_not_finite_becomes_null():
    found = of_the_study(agreement={"cost": math.inf, "of": (np.float64(1.0), np.array([1, 2]), np.nan)})
    assert found.agreement == {"cost": None, "of": [1.0, [1, 2], None]}
    json.dumps(found.as_dict(), allow_nan=False)


def test_the_agreement_of_the_starts_is_told():
    assert of_the_study(agreement={"starts": 5, "agree_in_point": 3, "agree_in_cost": 4}).starts == (3, 5)


def test_a_result_is_read_back_as_it_was_written(tmp_path):
    found = of_the_study(confidence=SURE)
    assert result.write(found, tmp_path) == tmp_path / "result.json"
    assert result.read(tmp_path) == found
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


@pytest.mark.parametrize("name", ["sample", "minimal"])
def test_a_result_of_version_0_1_is_written_as_it_is_read(tmp_path, name):
    folder = SAMPLES / name / "results"
    found = result.read(folder)
    assert all(isinstance(window, Window) for window in found.windows.values())
    assert result.write(found, tmp_path).read_text() == (folder / "result.json").read_text()


def test_what_an_older_result_does_not_say_takes_its_default():
    found = CalibrationResult.from_dict({"values": {"gap": 7e-4}, "confidence": None, "unheard_of": 1})
    assert found == CalibrationResult(values={"gap": 7e-4})


UNREADABLE = (
    "{", "[]", "null", '{"motion": "x"}', '{"confidence": {}}', '{"windows": {"gap": {"low": 1}}}', '{"holdout": []}',
    '{"remarks": "x"}',
)  # fmt: skip


@pytest.mark.parametrize("text", UNREADABLE)
def test_no_result_is_none_and_an_unreadable_one_is_refused(text, tmp_path):
    assert result.read(tmp_path) is None
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(CalibError, match="holds no result of a calibration"):
        result.read(tmp_path)


def test_a_hold_out_record_that_fails_says_why():
    score = SimpleNamespace(status="diverged", reason="too fast", cost=math.inf, terms={}, kind=None)
    assert held_out(score, math.nan) == HeldOutSummary(None, None, {}, None, "diverged", "too fast")
