"""All stages of a calibration evaluate in one pool."""

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
