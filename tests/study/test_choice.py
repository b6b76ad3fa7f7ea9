"""Emulators search where no optimiser is named and simulations are few and slow; a resumed study chooses the same."""

from dataclasses import replace
from functools import partial

import pytest
from study_fakes import Frugal, run, study

from calib.execution.pool import InProcess
from calib.store import Store, Trial
from calib.study import evaluate
from calib.study.choice import MAX_COSTLY_BUDGET, MIN_COSTLY_SECONDS, costly_choice


class Emulating(Frugal):
    """Stands for the optimiser of few, slow simulations."""

    def summary(self):
        return {"emulators": self.told}


def timed(a_study, seconds, point):
    """Evaluation of a point as if it had taken `seconds`."""
    return replace(evaluate(a_study, point), seconds=seconds)


def run_timed(a_study, folder, seconds, **options):
    with InProcess(partial(timed, a_study.without_search(), seconds)) as pool:
        return a_study.run(Store(folder, view=None), pool, **options)


def costly_study(budget=24, **settings):
    return study(budget, costly_optimiser=Emulating, **settings)


def trials(seconds, **more):
    return [Trial(n, [0.5], {}, 1.0, seconds=each, phase="screen", **more) for n, each in enumerate(seconds)]


def test_the_median_trial_of_the_screen_decides():
    assert costly_choice(50, trials([1, 12, 30])).seconds == 12
    assert costly_choice(50, trials([1, 9.99, 300])) is None
    assert costly_choice(50, []) is None


def test_a_large_budget_is_never_costly():
    assert costly_choice(MAX_COSTLY_BUDGET, trials([600.0]))
    assert costly_choice(MAX_COSTLY_BUDGET + 1, trials([600.0])) is None


def test_neither_failed_trials_nor_those_of_the_search_count():
    failed, searched = trials([600.0], status="timeout"), [replace(trials([600.0])[0], phase="search")]
    assert costly_choice(50, failed) is None
    assert costly_choice(50, searched + trials([1.0])) is None


def test_what_is_said_names_the_rule_and_the_way_out():
    choice = costly_choice(50, trials([600.0]))
    for part in (
        "surrogate",
        "budget of 50",
        f"at most {MAX_COSTLY_BUDGET}",
        f"{MIN_COSTLY_SECONDS:g} s",
        "[optimiser]",
    ):
        assert part in choice.remark
    assert choice.remark in choice.note
    assert "600 s" in choice.note


@pytest.mark.parametrize(("seconds", "budget", "chosen"), [(20.0, 24, True), (1.0, 24, False), (20.0, 151, False)])
def test_slow_simulations_within_a_small_budget_are_left_to_emulators(tmp_path, seconds, budget, chosen):
    told = []
    result = run_timed(costly_study(budget), tmp_path, seconds, on_choice=told.append)
    assert ("emulators" in result.agreement) is chosen
    assert (result.choice is not None) is chosen
    assert told == ([result.choice] if chosen else [])


def test_a_study_that_names_its_optimiser_keeps_it(tmp_path):
    result = run_timed(study(24), tmp_path, 20.0)
    assert "told" in result.agreement
    assert result.choice is None


class Stopped(BaseException):
    """Ends a run in its midst."""


def test_a_resumed_study_chooses_by_the_times_in_its_ledger(tmp_path):
    def stop(trial, best, count):
        if count == 14:
            raise Stopped

    whole = run_timed(costly_study(), tmp_path / "whole", 20.0)
    with pytest.raises(Stopped):
        run_timed(costly_study(), tmp_path / "cut", 20.0, on_trial=stop)
    resumed = run(costly_study(), tmp_path / "cut")  # trials take no time now
    assert [trial.u for trial in resumed.trials] == [trial.u for trial in whole.trials]
    assert "emulators" in resumed.agreement
    assert resumed.choice == whole.choice


def test_a_larger_budget_begins_with_the_optimiser_that_suits_it(tmp_path):
    first = run_timed(costly_study(24), tmp_path, 20.0)
    more = run_timed(costly_study(160), tmp_path, 20.0)
    assert [trial.u for trial in more.trials[:24]] == [trial.u for trial in first.trials]
    assert first.choice is not None
    assert more.choice is None
    assert "told" in more.agreement
