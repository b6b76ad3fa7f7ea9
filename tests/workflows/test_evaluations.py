"""All stages of a calibration evaluate in one pool."""

import os

import pytest
from echo_study import TRUTH, write_study

from calib.study_file import load
from calib.workflows.evaluations import CALIBRATED, CONFIRM, SEARCH, Case, Evaluations

AGAIN = '[[record]]\nname = "again"\npath = "bench.nc"\nnuisance = ["trigger"]\nuse = "holdout"\n\n[model]\n'


def test_a_case_is_evaluated_by_its_model_on_its_record(tmp_path):
    file = load(write_study(tmp_path, ("tiny_simulators:Echo", "tiny_simulators:Sketch"), ("[model]\n", AGAIN)))
    with Evaluations(file, tmp_path) as evaluations:
        for confirming, stage, model in ((False, SEARCH, "sketch"), (True, CONFIRM, "echo")):
            [(_, calibrated)] = evaluations.calibrated(stage, confirming).map([TRUTH])
            answers = evaluations.at(TRUTH, [Case(confirming, "again"), Case(confirming)])
            assert answers[CALIBRATED].score.cost == calibrated.score.cost
            assert {name: set(answer.records) for name, answer in answers.items()} == {
                "again": {"again"}, CALIBRATED: {"bench"},
            }  # fmt: skip
            assert answers["again"].records["again"].attrs["model"] == model


@pytest.mark.parametrize(("jobs", "each", "said"), [(2, 1, None), (3, 1, "3 jobs, and"), (2, 2, "2 cores each are 4")])
def test_more_cores_than_there_are_is_said(jobs, each, said, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    file, notes = load(write_study(tmp_path), jobs=jobs), []
    monkeypatch.setattr(type(file.study.model.simulator), "cores", each, raising=False)
    with Evaluations(file, tmp_path, notes.append):
        pass
    assert [said in note for note in notes] == ([] if said is None else [True])
