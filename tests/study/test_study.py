"""The loop: screen, ask, evaluate, log, tell; and what it does when things fail."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from study_fakes import SPACE, Frugal, Wanderer, lines, run, study

from calib.errors import CalibError
from calib.execution.pool import Failure
from calib.execution.pools.local import LocalPool
from calib.modelling.parameter import Space, Window
from calib.store import Store, Trial, read
from calib.store.trial import MAX_REASON_CHARACTERS
from calib.study import BUDGET_SPENT, INTERRUPTED, evaluate, reach
from calib.study.evaluation import as_trial


def test_the_budget_counts_the_screen_and_is_spent_exactly(tmp_path):
    found = run(study(30, screen=8, batch=4), tmp_path)
    assert found.stopped == BUDGET_SPENT
    assert [t.number for t in found.trials] == list(range(30))
    assert [t.phase for t in found.trials] == ["screen"] * 8 + ["search"] * 22


def test_the_best_is_the_lowest_cost(tmp_path):
    found = run(study(), tmp_path)
    assert found.best.cost == min(t.cost for t in found.trials)
    assert found.best.values == SPACE.values(np.array(found.best.u))


class Still(Wanderer):
    """Asks for one point again and again."""

    def ask(self):
        return np.full((3, self.dim), 0.25)


def test_of_equals_the_earliest_is_best(tmp_path):
    assert run(study(9, screen=0, optimiser=Still), tmp_path).best.number == 0


@pytest.mark.parametrize(("budget", "size"), [(600, 64), (256, 64), (100, 16), (4, 1), (3, 0)])
def test_the_default_screen_is_a_power_of_two_within_a_quarter_of_the_budget(budget, size):
    assert study(budget, screen=None).header.screen == size


@pytest.mark.parametrize("size", [1, 5, 8])
def test_the_points_of_the_screen_differ_and_depend_on_the_seed(tmp_path, size):
    one = [t.u for t in run(study(size, screen=size), tmp_path / "1").trials]
    other = [t.u for t in run(study(size, screen=size, seed=6), tmp_path / "2").trials]
    assert len({tuple(u) for u in one}) == size
    assert one != other


def test_the_screen_spreads_over_the_cube(tmp_path):
    points = np.array([t.u for t in run(study(8, screen=8), tmp_path).trials])
    assert (np.sort(np.floor(8.0 * points), axis=0) == np.arange(8.0)[:, None]).all(), "one point in each eighth"


@pytest.mark.parametrize("screen", [0, 8])
def test_the_first_trial_is_made_at_the_starting_point_and_the_screen_follows(tmp_path, screen):
    started = replace(study(20, screen=screen), space=replace(SPACE, start={"x": 1.3}))
    trials = run(started, tmp_path / "1").trials
    assert trials[0].values == pytest.approx({"x": 1.3, "y": SPACE.windows["y"].value(0.5)})
    assert [t.phase for t in trials] == ["screen"] * (screen + 1) + ["search"] * (19 - screen)
    plain = run(study(20, screen=screen), tmp_path / "2").trials
    assert [t.u for t in trials[1 : screen + 1]] == [t.u for t in plain[:screen]]


def test_a_starting_value_needs_a_window_that_holds_it():
    with pytest.raises(CalibError, match="outside the window"):
        replace(SPACE, start={"x": 1e6})
    with pytest.raises(CalibError, match="no window"):
        replace(SPACE, start={"z": 0.0})


class Recorder(Wanderer):
    """Notes in a class attribute what it was told."""

    heard = []

    def tell(self, x, outcomes):
        type(self).heard.append((np.array(x), outcomes))
        super().tell(x, outcomes)


def test_the_optimiser_is_told_the_screen_first_and_each_batch_in_asking_order(tmp_path):
    Recorder.heard = []
    found = run(study(20, screen=8, batch=4, optimiser=Recorder), tmp_path)
    assert [len(x) for x, _ in Recorder.heard] == [8, 4, 4, 4]
    told = np.concatenate([x for x, _ in Recorder.heard])
    assert told.tolist() == [t.u for t in found.trials]
    assert [o.cost for _, outcomes in Recorder.heard for o in outcomes] == [t.cost for t in found.trials]


def test_the_optimisers_reason_to_stop_is_the_studys(tmp_path):
    class Content(Wanderer):
        def stop(self):
            return "good enough" if self.told >= 12 else None

    found = run(study(40, optimiser=Content), tmp_path)
    assert found.stopped == "good enough"
    assert len(found.trials) == 12
    assert found.agreement == {"told": 12}


def test_the_optimiser_is_closed_whatever_happens(tmp_path):
    made = []

    def make(**contract):
        made.append(Wanderer(**contract))
        return made[-1]

    def burst(trial, best, count):
        if count == 10:
            raise RuntimeError("the lamp fell over")

    run(study(10, optimiser=make), tmp_path / "1")
    with pytest.raises(RuntimeError, match="lamp"):
        run(study(40, optimiser=make), tmp_path / "2", on_trial=burst)
    assert made
    assert all(optimiser.closed for optimiser in made)


@pytest.mark.parametrize(("trouble", "status"), [("diverge", "diverged"), ("raise", "raised")])
def test_a_failed_simulation_is_data(tmp_path, trouble, status):
    found = run(study(trouble=trouble), tmp_path)
    failed = [t for t in found.trials if t.status != "ok"]
    assert failed
    assert {t.status for t in failed} == {status}
    assert all(t.cost == math.inf and t.residuals is None and t.reason for t in failed)
    assert found.best.status == "ok"
    assert lines(read(tmp_path)[1]) == lines(found.trials)


def test_the_reason_of_a_failed_trial_is_one_line_of_limited_length():
    def reason_of(text):
        return as_trial(0, [0.5], {"x": 1.0}, Failure("raised", text, 0.1), "search", 0).reason

    assert reason_of("not solvable:\n  the matrix\r\n\n  is singular\n") == "not solvable: the matrix is singular"
    assert reason_of(MAX_REASON_CHARACTERS * "x") == MAX_REASON_CHARACTERS * "x"
    cut = reason_of("begin " + 1000 * "x\n")
    assert len(cut) == MAX_REASON_CHARACTERS
    assert cut.startswith("begin x")
    assert cut.endswith(" ...")
    assert reason_of("no \udce9, é or \ud83d\n") == r"no \udce9, é or \ud83d"


@pytest.mark.parametrize(("trouble", "status", "limit"), [("crash", "crashed", None), ("hang", "timeout", 1.0)])
def test_a_simulator_may_hang_or_kill_its_process(tmp_path, trouble, status, limit):
    a_study = study(12, trouble=trouble, jobs=2)
    with LocalPool(partial(evaluate, a_study.without_search()), 2, timeout=limit, startup=10.0) as pool:
        found = a_study.run(Store(tmp_path, view=None), pool)
    assert {t.status for t in found.trials} == {"ok", status}


def test_a_model_that_refuses_the_first_point_stops_the_study(tmp_path):
    with pytest.raises(CalibError, match="cannot take this excitation"):
        run(study(trouble="refuse"), tmp_path)
    assert not read(tmp_path)[1], "the log stays empty"


def test_an_unknown_parameter_stops_the_study_with_the_models_words(tmp_path):
    with pytest.raises(CalibError, match="unknown parameter 'z'"):
        run(study(space=Space({"z": Window(0.0, 1.0)})), tmp_path)


def test_a_parameter_may_belong_to_one_record(tmp_path):
    space = Space({"x": Window(0.1, 2.0), "x@second": Window(0.6, 0.8)}, {"y": 0.3})
    found = run(study(records=("first", "second"), space=space), tmp_path)
    best = found.best
    reached = {f["record"]: f["simulated"] for f in best.features}
    assert reached["first"] == pytest.approx(best.values["x"], rel=0.01)
    assert reached["second"] == pytest.approx(best.values["x@second"], rel=0.01)


def test_a_parameter_of_an_unknown_record_is_refused():
    with pytest.raises(CalibError, match="did you mean 'decay'"):
        study(space=Space({"x@decoy": Window(0.1, 2.0)}))


@pytest.mark.parametrize("wrong", [{"budget": 0}, {"budget": 2.5}, {"batch": 0}, {"jobs": 0}, {"screen": -1}])
def test_counts_are_whole_numbers(wrong):
    with pytest.raises(CalibError, match="whole number"):
        study(**wrong)


def test_something_must_be_searched():
    with pytest.raises(CalibError, match="nothing to search"):
        study(space=Space({}))


class Astray(Wanderer):
    """Asks for a point outside the cube."""

    def ask(self):
        return np.full((1, self.dim), 1.5)


def test_an_optimiser_that_leaves_the_cube_is_a_bug(tmp_path):
    with pytest.raises(ValueError, match="in \\[0, 1\\]"):
        run(study(optimiser=Astray), tmp_path)


def test_ctrl_c_ends_the_study_in_order(tmp_path):
    def interrupt(trial, best, count):
        if count == 15:
            raise KeyboardInterrupt

    found = run(study(40), tmp_path, on_trial=interrupt)
    assert found.stopped == INTERRUPTED
    assert len(found.trials) == 15
    assert lines(run(study(40), tmp_path).trials) == lines(run(study(40), tmp_path / "whole").trials)


def test_each_trial_is_announced_with_the_best_so_far(tmp_path):
    seen = []
    found = run(study(20), tmp_path, on_trial=lambda trial, best, count: seen.append((trial.cost, best.cost, count)))
    assert [count for _, _, count in seen] == list(range(1, 21))
    assert [best for _, best, _ in seen] == np.minimum.accumulate([cost for cost, _, _ in seen]).tolist()
    assert seen[-1][1] == found.best.cost


def test_a_measured_value_within_the_simulated_range_is_reached(tmp_path):
    (one,) = run(study(), tmp_path).reach
    assert one.reached
    assert one.off == 0.0
    assert one.low <= one.measured <= one.high


def test_a_measured_value_outside_is_not_reached_and_it_is_said_by_how_much(tmp_path):
    (one,) = run(study(measured=4.0, screen=32), tmp_path).reach
    assert not one.reached
    assert (one.label, one.record, one.body, one.unit) == ("amplitude", "decay", "mass", "m")
    assert one.nearest == one.high <= 2.0
    assert one.off == pytest.approx(4.0 - one.high)
    assert one.percent == pytest.approx(25.0 * one.off)


def test_reach_counts_the_tolerance(tmp_path):
    found = run(study(), tmp_path)
    (one,) = found.reach
    features = [{**f, "measured": one.high + 0.009} for t in found.trials for f in t.features]
    assert reach([Trial(0, [], {}, 0.0, features=features)])[0].reached


def test_a_feature_that_no_trial_shows_is_not_reached():
    feature = {"label": "impact phase", "record": "r", "body": "b", "unit": "1", "tolerance": 0.01, "measured": 0.4}
    trials = [Trial(n, [], {}, 1.0, features=[{**feature, "simulated": None}]) for n in range(2)]
    (one,) = reach(trials)
    assert not one.reached
    assert (one.nearest, one.off, one.percent) == (None, None, None)
    trials.append(Trial(2, [], {}, 1.0, features=[{**feature, "simulated": 0.41}]))
    assert reach(trials)[0].reached


def test_reach_is_the_same_from_the_log_alone(tmp_path):
    assert run(study(), tmp_path).reach == reach(read(tmp_path)[1])


def test_a_study_where_all_fails_has_no_best(tmp_path):
    found = run(study(12, trouble="diverge", space=Space({"x": Window(1.6, 2.0)})), tmp_path)
    assert found.best is None
    assert not found.reach
    assert found.stopped == BUDGET_SPENT


def test_the_number_of_jobs_changes_nothing(tmp_path):
    alone = run(study(24), tmp_path / "0")
    for jobs in (1, 2):
        found = study(24, jobs=jobs).run(Store(tmp_path / str(jobs), view=None))
        assert lines(found.trials) == lines(alone.trials)
        assert found.best.number == alone.best.number


def test_a_larger_budget_goes_on_from_where_the_study_ended(tmp_path):
    first = run(study(20), tmp_path)
    more = run(study(31), tmp_path)
    assert lines(more.trials[:20]) == lines(first.trials)
    assert len(more.trials) == 31
    assert {t.segment for t in more.trials} == {0}, "this optimiser never asked how much was left"


def test_a_larger_budget_revives_an_optimiser_that_ended_with_the_old_one(tmp_path):
    assert run(study(20, optimiser=Frugal), tmp_path).stopped == "my budget is spent"
    more = run(study(32, optimiser=Frugal), tmp_path)
    assert len(more.trials) == 32
    assert [t.segment for t in more.trials] == [0] * 20 + [1] * 12
    again = run(study(32, optimiser=Frugal), tmp_path)
    assert lines(again.trials) == lines(more.trials)


def test_a_smaller_budget_ends_at_once(tmp_path):
    run(study(20), tmp_path)
    assert len(run(study(10), tmp_path).trials) == 20
