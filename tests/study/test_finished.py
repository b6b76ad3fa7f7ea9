"""A study whose search has ended opens again without another search, unless something has changed since."""

import json

import pytest
from study_fakes import Frugal, Wanderer, lines, run, study

from calib.store import Store
from calib.study import BUDGET_SPENT, SearchEnd


class Unasked(Wanderer):
    """Must not be asked."""

    def ask(self):
        pytest.fail("the optimiser was asked")


def end_of(found):
    return SearchEnd(len(found.trials), found.best.number, found.stopped, found.agreement)


@pytest.mark.parametrize(("first", "later"), [(Wanderer, Unasked), (Frugal, Unasked)])
def test_trials_of_a_finished_search_are_not_replayed(tmp_path, first, later):
    found = run(study(20, optimiser=first), tmp_path)
    before = (tmp_path / "trials.jsonl").read_bytes()
    again = run(study(20, optimiser=later), tmp_path, ended=end_of(found))
    assert lines(again.trials) == lines(found.trials)
    assert end_of(again) == end_of(found)
    assert (tmp_path / "trials.jsonl").read_bytes() == before


@pytest.mark.parametrize("budget", [24, 30])
def test_a_budget_that_has_grown_is_spent(tmp_path, budget):
    found = run(study(20), tmp_path)
    assert found.stopped == BUDGET_SPENT
    assert len(run(study(budget), tmp_path, ended=end_of(found)).trials) == budget


def test_a_search_that_was_ended_early_by_a_lower_budget_goes_on(tmp_path):
    run(study(30), tmp_path / "whole")
    found = run(study(12), tmp_path)
    assert len(run(study(30), tmp_path, ended=end_of(found)).trials) == 30


def test_a_trial_that_is_missing_since_is_evaluated_again(tmp_path):
    found, path = run(study(20), tmp_path), tmp_path / "trials.jsonl"
    text = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in text if json.loads(line).get("number") != 13))
    numbers = []
    again = run(study(20), tmp_path, ended=end_of(found), on_trial=lambda trial, *_: numbers.append(trial.number))
    assert numbers == [13]
    assert lines(again.trials) == lines(found.trials)


def test_code_that_has_changed_searches_on(tmp_path):
    found = run(study(20, code={"formula": "old"}), tmp_path)
    with pytest.warns(UserWarning, match="the code of module formula has changed"):
        again = run(study(20, code={"formula": "new"}), tmp_path, ended=end_of(found))
    assert len(again.trials) > 20


def test_a_replay_asks_nothing_of_the_pool(tmp_path):
    found = run(study(20), tmp_path)

    class NoPool:
        def map(self, payloads):
            pytest.fail("the pool was used")

    again = study(20).run(Store(tmp_path, view=None), NoPool())
    assert lines(again.trials) == lines(found.trials)
