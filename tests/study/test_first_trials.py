"""A study whose first trials all fail with one exception."""

import math
import re
import subprocess
import sys
import warnings
from dataclasses import replace

import pytest
from child_environment import environment
from echo_study import write_study
from study_fakes import Formula, run, study

from calib.errors import FirstTrialsFailed
from calib.execution.pool import RAISED, Failure
from calib.modelling.model import Model
from calib.store import Trial
from calib.store.ledger import read
from calib.store.trial import FORMER_CODE
from calib.study.first_trials import MIN_FIRST_TRIALS, FirstTrials

PLUGIN = '''"""An echo whose author misspelt a parameter."""

from tiny_simulators import Echo


class Bench(Echo):
    """It fails at every point."""

    def run(self, values, excitation, laws, request):
        """Fail."""
        values["{gain}"]
        return super().run(values, excitation, laws, request)
'''


class Broken(Formula):
    """The formula, with a mistake that no point escapes."""

    def run(self, values, excitation, laws, request):
        raise TypeError(f"no formula takes {values['x']}")


def broken(budget=40, simulator=Broken, **settings):
    return replace(study(budget, **settings), model=Model(simulator()))


def failed(numbers, reason="TypeError: expected a float (bench.py, line 7: x())", status=RAISED):
    return {n: Trial(n, [0.5], {"x": 1.0}, math.inf, status=status, reason=reason) for n in numbers}


def test_a_study_that_cannot_give_anything_ends_early_with_the_place_of_the_mistake(tmp_path):
    with pytest.raises(FirstTrialsFailed) as told:
        run(broken(), tmp_path)
    text = str(told.value)
    assert re.search(
        r"each of the first 20 trials failed .*: TypeError: no formula takes [\d.]+ \(.*, line \d+: ", text
    )
    assert __file__ in text
    assert [trial.status for trial in read(tmp_path)[1]] == MIN_FIRST_TRIALS * [RAISED]


def test_the_same_command_goes_on_with_other_points_where_nothing_was_mended(tmp_path):
    for trials in (20, 40):
        with pytest.raises(FirstTrialsFailed):
            run(broken(60), tmp_path)
        assert len(read(tmp_path)[1]) == trials
    assert len(run(broken(60), tmp_path).trials) == 60


def test_a_second_mistake_ends_the_run_again_also_where_former_trials_have_spent_the_budget(tmp_path):
    for number, code in enumerate(("old", "new"), start=1):
        with warnings.catch_warnings(action="ignore"), pytest.raises(FirstTrialsFailed):  # of changed code
            run(broken(screen=24, code={"bench": f"sha256 {code}"}, budget=24), tmp_path)
        assert len(read(tmp_path)[1]) == 20 * number


def test_mended_code_evaluates_the_screen_that_had_failed(tmp_path):
    with pytest.raises(FirstTrialsFailed):
        run(broken(screen=32, code={"bench": "sha256 old"}, budget=70), tmp_path)
    mended = study(70, screen=32, code={"bench": "sha256 new"})
    with pytest.warns(UserWarning, match="the code of module bench has changed"):
        found = run(mended, tmp_path)
    lost = {tuple(trial.u) for trial in found.trials if trial.status == FORMER_CODE}
    assert len(lost) == MIN_FIRST_TRIALS
    assert lost == {tuple(trial.u) for trial in found.trials[32:52]}
    assert {trial.status for trial in found.trials[20:]} == {"ok"}
    assert len(found.trials) == 70
    again = run(replace(mended, budget=80), tmp_path)
    assert [trial.u for trial in again.trials[:70]] == [trial.u for trial in found.trials]


class Accident(Formula):
    """The formula, with a division that no point survives."""

    def run(self, values, excitation, laws, request):
        raise ZeroDivisionError("float division by zero")


class Diverging(Formula):
    """The formula, as a failure that the record states."""

    def run(self, values, excitation, laws, request):
        return Formula(trouble="diverge").run({"x": 2.0, "y": 0.0}, excitation, laws, request)


class Various(Formula):
    """The formula, with two mistakes."""

    def run(self, values, excitation, laws, request):
        raise (TypeError if values["x"] > 0.5 else KeyError)("x")


@pytest.mark.parametrize("simulator", [Accident, Diverging, Various])
def test_failures_that_may_depend_on_the_values_spend_the_budget(tmp_path, simulator):
    found = run(broken(simulator=simulator), tmp_path)
    assert len(found.trials) == 40
    assert found.best is None


def test_a_worker_that_fails_at_once_is_not_taken_for_the_code():
    """Of four workers one fails at once and is given most trials; the others take their time."""
    first = FirstTrials(workers=4)
    first.ask(range(64))
    slow = {1, 2, 3}
    failures = failed(set(range(40)) - slow)
    first.check(failures, 19, Failure(RAISED, failures[19].reason, 0.1))
    with pytest.raises(FirstTrialsFailed):
        first.check(failures | failed(slow), 1, Failure(RAISED, failures[19].reason, 0.1))


def test_each_worker_has_two_trials():
    first = FirstTrials(workers=32)
    first.ask(range(64))
    failures = failed(range(63))
    first.check(failures, 62, Failure(RAISED, failures[0].reason, 0.1))
    with pytest.raises(FirstTrialsFailed, match="the first 64 trials"):
        first.check(failures | failed([63]), 63, Failure(RAISED, failures[0].reason, 0.1))


@pytest.mark.slow
def test_a_mended_plugin_goes_on_with_the_same_command(tmp_path):
    plugin = tmp_path / "bench_plugin.py"
    path = write_study(tmp_path, ("tiny_simulators:Echo", "bench_plugin:Bench"), ("budget = 24", "budget = 60"))
    for gain, code, said in (
        ("gian", 4, f"KeyError: 'gian' ({plugin}, line 11: "),
        ("gain", 0, "the code of module bench_plugin has changed"),
    ):
        plugin.write_text(PLUGIN.format(gain=gain))
        command = [sys.executable, "-m", "calib", "run", str(path)]
        ended = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
        assert ended.returncode == code, ended.stderr
        assert said in ended.stderr
        assert "Traceback" not in ended.stderr
    assert "going on from 20 trials" in ended.stderr
    assert {trial.status for trial in read(tmp_path / "out")[1][20:]} == {"ok"}
