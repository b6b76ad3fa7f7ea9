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
    assert not effort.spent
    list(effort.map([1]))
    assert effort.spent


def test_a_budget_of_time_is_spent_by_the_clock():
    now = [100.0]
    effort = Effort(InProcess(simulate), Budget.of("2 min"), clock=lambda: now[0])
    assert not effort.spent
    now[0] += 121.0
    assert effort.spent


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


@pytest.mark.parametrize("text", ["soon", "-3", "0", "5 mm", "", "0 s"])
def test_a_budget_that_is_none_names_what_was_expected(text):
    with pytest.raises(CalibError, match="budget: expected .*, got "):
        Budget.of(text)


def test_no_budget_is_never_spent():
    assert Budget.of(None) == Budget()
    assert not Effort(InProcess(simulate)).spent
