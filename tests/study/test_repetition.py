"""The best trial evaluated again."""

import pytest

from calib.execution.pool import Failure
from calib.objective import Score
from calib.store import Trial
from calib.study.evaluation import Evaluation
from calib.study.repetition import repetition


def again(cost):
    return Evaluation(Score(cost, {}), {}, [], 0.0)


@pytest.mark.parametrize("answer", [again(0.2), Failure("crashed", "it died", 1.0)])
def test_a_trial_from_the_cache_that_cannot_be_repeated_names_the_cure(answer):
    trial = Trial(3, [0.5], {"gap": 1e-3}, 0.1, simulations=0)
    assert "delete the folder `cache` of the results" in repetition(trial, answer)
    assert "cache" not in repetition(Trial(3, [0.5], {"gap": 1e-3}, 0.1, simulations=1), answer)


def test_round_off_is_no_other_score():
    assert repetition(Trial(3, [0.5], {"gap": 1e-3}, 0.1, simulations=0), again(0.1 * (1.0 + 1e-9))) == ""
