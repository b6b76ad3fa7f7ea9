"""Simulations counted, foreseen and bounded."""

import numpy as np
import pytest

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.effort import Budget, Effort
from calib.errors import CalibError
from calib.execution.pool import InProcess


def simulate(simulations):
    return SimulatedRows(np.zeros((0, 0)), np.zeros(0), simulations=simulations)


def test_simulations_are_counted_record_by_record():
    heard = []
    effort = Effort(InProcess(simulate), on_progress=lambda *state: heard.append(state))
    effort.foresee(4)
    assert [index for index, _ in effort.map([1, 3])] == [0, 1]
    effort.foresee(10)
    assert heard == [(0, 4), (1, 4), (4, 4), (4, 14)]


def test_more_than_was_foreseen_is_foreseen_now():
    effort = Effort(InProcess(simulate))
    effort.foresee(2)
    list(effort.map([5]))
    assert (effort.done, effort.foreseen) == (5, 5)


def test_a_budget_of_simulations_is_spent_by_them():
    effort = Effort(InProcess(simulate), Budget.of("4"))
    list(effort.map([3]))
    assert effort.suffices()
    list(effort.map([1]))
    assert not effort.spent  # nothing was left out yet
    assert not effort.suffices()
    assert effort.spent


def test_a_budget_of_time_is_spent_by_the_clock():
    now = [100.0]
    effort = Effort(InProcess(simulate), Budget.of("2 min"), clock=lambda: now[0])
    assert effort.suffices()
    now[0] += 121.0
    assert not effort.suffices()


def test_what_a_budget_leaves_is_in_simulations_at_the_pace_so_far():
    now = [100.0]
    effort = Effort(InProcess(simulate), Budget.of("2 min"), clock=lambda: now[0])
    list(effort.map([30]))
    now[0] += 60.0
    assert effort.left == pytest.approx(30.0)
    now[0] += 90.0
    assert effort.left == 0.0
    counted = Effort(InProcess(simulate), Budget.of("40"))
    list(counted.map([30]))
    assert counted.left == 10
    assert Effort(InProcess(simulate)).left == np.inf


def test_the_pace_is_that_of_the_latter_half_for_kernels_are_compiled_at_first():
    now = [0.0]
    effort = Effort(InProcess(simulate), Budget.of("100 s"), clock=lambda: now[0])
    for seconds in (40.0, 1.0, 1.0, 1.0, 1.0):
        now[0] += seconds
        list(effort.map([2]))
    assert effort.left == pytest.approx(2.0 * 56.0)


def test_a_step_that_the_budget_does_not_suffice_for_is_broken_off_before_the_batch_that_exceeds_it():
    effort = Effort(InProcess(simulate), Budget.of("10"))

    def step():
        for _ in range(4):
            list(effort.map([1, 1, 1]))
        return "whole"

    assert effort.attempt(step) is None
    assert (effort.done, effort.spent) == (9, True)
    assert effort.attempt(lambda: "another") is None  # none begins then
    list(effort.map([1, 1, 1]))  # what concludes a search runs in any case
    assert effort.done == 12


def test_a_search_leaves_what_is_reserved():
    effort = Effort(InProcess(simulate), Budget.of("10"))
    effort.reserve = 6
    assert effort.attempt(lambda: [list(effort.map([1, 1])) for _ in range(3)]) is None
    assert (effort.done, effort.left) == (4, 0.0)


def test_steps_are_foreseen_by_those_that_were_measured_and_stages_that_may_follow_with_them():
    effort = Effort(InProcess(simulate))
    effort.priors["fit"], effort.later["pairs"] = 10.0, (2.0, "fit")
    effort.foresee(effort.expected("fit", 3.0))
    assert effort.foreseen == 50
    with effort.measuring("fit"):
        list(effort.map([20]))
    assert effort.expected("fit") == 15.0
    effort.foresee(effort.expected("fit", 2.0))
    assert effort.foreseen == 20 + 30 + 30
    with effort.measuring("fit"):
        list(effort.map([60]))
    assert effort.foreseen == 80 + 30  # this stage took more than was foreseen, and others follow it


@pytest.mark.parametrize("text", ["soon", "-3", "0", "5 mm", "", "0 s"])
def test_a_budget_that_is_none_names_what_was_expected(text):
    with pytest.raises(CalibError, match="budget: expected .*, got "):
        Budget.of(text)


def test_no_budget_is_never_spent():
    assert Budget.of(None) == Budget()
    assert Effort(InProcess(simulate)).suffices(1e9)
