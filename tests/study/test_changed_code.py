"""A study that goes on after the code that it uses has changed."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from study_fakes import Formula, Wanderer, lines, run, study

from calib.modelling.model import Model
from calib.records import record
from calib.store.ledger import TRIALS, read
from calib.store.trial import FORMER_CODE

OLD, NEW = {"bench_simulator": "sha256 old"}, {"bench_simulator": "sha256 new"}


class Halved(Formula):
    """The formula with half the displacement."""

    def run(self, values, excitation, laws, request):
        motion = super().run(values, excitation, laws, request)
        return record.make(motion.time.values, self.bodies, {"displacement": motion.displacement.values / 2.0})


class Told(Wanderer):
    """Keeps what it was told."""

    costs: list = []

    def tell(self, x, outcomes):
        Told.costs += [outcome.cost for outcome in outcomes]
        super().tell(x, outcomes)


def halved(budget, **settings):
    return replace(study(budget, code=NEW, **settings), model=Model(Halved()))


def changed(folder, before=20, after=30, **settings):
    """Results of a study with the formula, and with its half."""
    first = run(study(before, code=OLD), folder)
    with pytest.warns(UserWarning, match="the code of module bench_simulator has changed") as told:
        second = run(halved(after, **settings), folder)
    assert [str(warning.message).count("\n") for warning in told] == [0], "one sentence"
    return first, second


def test_trials_by_former_code_do_not_count_and_the_best_is_evaluated_again_first(tmp_path):
    first, second = changed(tmp_path)
    again = second.trials[20]
    assert (again.u, again.segment, again.status) == (first.best.u, 1, "ok")
    assert again.cost != first.best.cost
    assert {trial.status for trial in second.trials[:20]} == {FORMER_CODE}
    assert second.best.number >= 20
    assert second.best.cost == min(trial.cost for trial in second.trials[20:])
    assert len(second.trials) == 30


def test_the_optimiser_is_told_no_score_of_former_code(tmp_path):
    Told.costs = []
    _, second = changed(tmp_path, optimiser=Told)
    assert Told.costs == [trial.cost for trial in second.trials[20 : 20 + len(Told.costs)]]
    assert len(Told.costs) >= 5


def test_a_spent_budget_leaves_room_for_the_best_point(tmp_path):
    first, second = changed(tmp_path, after=20)
    assert [trial.number for trial in second.trials if trial.scored] == [20]
    assert second.best.u == first.best.u


def test_a_search_by_the_present_code_is_replayed_without_a_word(tmp_path):
    expected = changed(tmp_path / "whole")[1]
    changed(tmp_path / "stopped", after=23)
    path = tmp_path / "whole" / TRIALS
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-4]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert lines(run(halved(30), tmp_path / "whole").trials) == lines(expected.trials)
        assert len(run(halved(40), tmp_path / "stopped").trials) == 40


def test_code_that_is_restored_makes_its_trials_count_again(tmp_path):
    first, _ = changed(tmp_path)
    with pytest.warns(UserWarning, match="has changed"):
        third = run(study(32, code=OLD), tmp_path)
    assert lines(third.trials)[:20] == lines(first.trials)
    assert {trial.status for trial in third.trials[20:30]} == {FORMER_CODE}
    assert {trial.status for trial in third.trials[30:]} == {"ok"}


def test_a_ledger_without_code_records_it_from_then_on_and_its_trials_stay_valid(tmp_path):
    run(study(20), tmp_path)
    assert "code" not in json.loads((tmp_path / TRIALS).read_text().splitlines()[0])
    with pytest.warns(UserWarning, match="bench_simulator was not recorded when this study was begun"):
        found = run(study(24, code=OLD), tmp_path)
    header, trials = read(tmp_path)
    assert (header.segment, header.code) == (1, OLD)
    assert all(trial.scored for trial in trials)
    with pytest.warns(UserWarning, match="has changed"):
        run(halved(30), tmp_path)
    assert {trial.status for trial in read(tmp_path)[1][:24]} == {FORMER_CODE}, "older than the code that was recorded"
    assert np.isfinite(found.best.cost)
