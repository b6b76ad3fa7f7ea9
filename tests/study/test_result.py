"""result.json says what a study found."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from calib.errors import CalibError
from calib.modelling.parameter import Parameter, Space, Window
from calib.store import Trial
from calib.study import result

STUDY = SimpleNamespace(
    name="s",
    model=SimpleNamespace(parameters={"gap": Parameter("gap", "m", 1e-3, "clearance")}),
    space=Space({"gap": Window(1e-4, 2e-3)}),
)
TRIALS = [
    Trial(0, [0.1], {"gap": 3e-4}, 0.5, {"a": 0.5}, kind="period 1", phase="screen"),
    Trial(1, [0.2], {"gap": 5e-4}, math.inf, {"a": math.inf}, status="diverged", reason="too fast"),
    Trial(2, [0.3], {"gap": 7e-4}, 0.25, {"a": 0.25}, kind="period 1"),
]
ARCHITECTURE = {
    "name", "status", "values", "units", "intervals", "undetermined", "at_edge", "unreachable", "score", "motion",
    "trials", "failed", "seconds",
}  # fmt: skip


SURE = {
    "status": "ok", "interval": {"gap": [6e-4, 8e-4]}, "standard_error": {"gap": 5e-5}, "undetermined": [],
    "at_edge": {"gap": "low"},
}  # fmt: skip


def summarised(**more):
    return result.summarised(STUDY, TRIALS, best=TRIALS[2], **more)


def test_every_promised_key_is_there():
    assert set(summarised()) >= ARCHITECTURE


def test_values_have_units_and_intervals():
    said = summarised(confidence=SURE)
    assert said["values"] == {"gap": 7e-4}
    assert said["units"] == {"gap": "m"}
    assert said["intervals"] == {"gap": [6e-4, 8e-4]}
    assert said["at_edge"] == ["gap"]


def test_trials_and_failures_are_counted():
    said = summarised()
    assert (said["trials"], said["failed"], said["best_trial"]) == (3, 1, 2)
    assert said["failures"] == [{"status": "diverged", "trials": 1, "reason": "too fast"}]


def test_a_failed_study_has_no_score():
    said = result.summarised(STUDY, TRIALS[1:2])
    assert said["status"] == "failed"
    assert said["score"] == {"total": None, "terms": {}}


def test_only_what_is_not_reached_is_listed():
    reach = [
        SimpleNamespace(
            label="amplitude",
            record="r",
            body="q3",
            unit="m",
            measured=2e-3,
            nearest=1e-3,
            off=1e-3,
            percent=50.0,
            reached=reached,
        )  # fmt: skip
        for reached in (True, False)
    ]
    assert [entry["measured"] for entry in summarised(reach=reach)["unreachable"]] == [2e-3]


def test_what_is_not_finite_becomes_null():
    said = summarised(agreement={"cost": math.inf, "of": (np.float64(1.0), np.array([1, 2]), np.nan)})
    assert said["agreement"] == {"cost": None, "of": [1.0, [1, 2], None]}
    json.dumps(said, allow_nan=False)


def test_the_agreement_of_the_starts_is_told():
    said = summarised(agreement={"starts": 5, "agree_in_point": 3, "agree_in_cost": 4})
    assert (said["agreement"]["starts"], said["agreement"]["agree"]) == (5, 3)


def test_a_result_is_read_back_as_it_was_written(tmp_path):
    said = summarised(confidence=SURE)
    assert result.write(said, tmp_path) == tmp_path / "result.json"
    assert result.read(tmp_path) == said
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_no_result_is_none_and_an_unreadable_one_is_refused(tmp_path):
    assert result.read(tmp_path) is None
    (tmp_path / "result.json").write_text("{")
    with pytest.raises(CalibError, match="not JSON"):
        result.read(tmp_path)


def test_a_hold_out_record_that_fails_says_why():
    score = SimpleNamespace(status="diverged", reason="too fast", cost=math.inf, terms={}, kind=None)
    held = result.held_out(score, math.nan)
    assert (held["misfit"], held["score"], held["status"], held["reason"]) == (None, None, "diverged", "too fast")
