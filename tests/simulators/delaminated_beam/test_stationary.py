"""A motion that settles, with made-up engines."""

import numpy as np
import pytest

from calib.records import MIN_SECTION_PERIODS
from calib.simulators.delaminated_beam.stationary import (
    MAX_RETURN_PERIODS,
    STATE_RETURN_TOLERANCE,
    Contact,
    FailedMotion,
    Period,
    StationaryMotion,
    return_period,
    stationary,
)


class Clockwork:
    """An engine whose state goes round a list after a transient of so many periods; the state is told in its samples.

    `fails` says in which period it fails, if in any.
    """

    def __init__(self, round_of, transient=0, fails=None):
        self.round_of, self.transient, self.fails = round_of, transient, fails
        self.done = 0
        self.begun = None

    def at(self, period):
        x = self.round_of[period % len(self.round_of)]
        return x + (100.0 + 3.3 * period if period < self.transient else 0.0)

    def period(self, samples):
        rows = np.full((samples, 4), self.at(self.done))
        rows[1:] += 0.5
        if self.done == self.fails:
            return Period("diverged", f"period {self.done}", rows, rows[:, 0])
        self.done += 1
        return Period("ok", "", rows, 10.0 * rows[:, 0])

    def state(self):
        return np.array([self.at(self.done), 1.0])

    def begin_record(self):
        self.begun = self.done

    def contact_recorded(self, periods):
        assert self.done - self.begun == periods
        none = np.zeros((0, 2))
        return Contact(none, none, np.zeros(1), 0.25, 1.0, 0.0)


class Wanderer(Clockwork):
    """An engine that never returns."""

    def at(self, period):
        return 0.1 * period**1.5


@pytest.mark.parametrize("length", [1, 2, 3, 7, MAX_RETURN_PERIODS])
@pytest.mark.parametrize("transient", [0, 5])
def test_a_motion_settles_when_its_state_returns(length, transient):
    engine = Clockwork(list(range(length)), transient)
    motion = stationary(engine, 3, 4, None, 100)
    assert isinstance(motion, StationaryMotion)
    assert motion.returns == length
    assert motion.settled == transient + length
    assert motion.samples.shape == (12, 4)
    np.testing.assert_array_equal(motion.samples[::4, 0], [engine.at(motion.settled + k) for k in range(3)])
    np.testing.assert_array_equal(motion.force, 10.0 * motion.samples[:, 0])


def test_a_motion_of_a_longer_period_does_not_return():
    motion = stationary(Clockwork(list(range(MAX_RETURN_PERIODS + 1))), 2, 4, None, 40)
    assert motion.returns is None
    assert motion.settled == 40


@pytest.mark.parametrize("limit", [1, 9, 50])
def test_a_motion_that_does_not_return_is_recorded_after_the_limit(limit):
    motion = stationary(Wanderer([0]), 2, 4, None, limit)
    assert isinstance(motion, StationaryMotion)
    assert motion.settled == limit
    assert motion.returns is None


@pytest.mark.parametrize("settle", [0, 1, 12])
def test_a_number_of_periods_to_drop_is_kept_to(settle):
    engine = Clockwork([0, 1], transient=4)
    motion = stationary(engine, 2, 4, settle, 3)
    assert motion.settled == settle
    assert motion.samples[0, 0] == engine.at(settle)


@pytest.mark.parametrize("length", [1, 2, 3, 5, MAX_RETURN_PERIODS])
@pytest.mark.parametrize("periods", [1, 2, 70])
def test_sections_that_are_not_simulated_are_those_that_would_be(length, periods):
    engine = Clockwork([3.0 * k for k in range(length)], transient=3)
    motion = stationary(engine, periods, 4, None, 100)
    assert len(motion.sections) == max(MIN_SECTION_PERIODS, periods)
    simulated = engine.done
    assert simulated < motion.settled + periods + 2 * MAX_RETURN_PERIODS
    whole = np.array([engine.at(k) for k in range(simulated + MIN_SECTION_PERIODS + MAX_RETURN_PERIODS)])
    assert any(
        np.array_equal(whole[k : k + MIN_SECTION_PERIODS], motion.sections[-MIN_SECTION_PERIODS:, 0])
        for k in range(simulated + MAX_RETURN_PERIODS)
    )


def test_sections_of_a_motion_that_does_not_return_are_simulated():
    engine = Wanderer([0])
    motion = stationary(engine, 2, 4, 5, 100)
    np.testing.assert_array_equal(motion.sections[:, 0], [engine.at(k) for k in range(MIN_SECTION_PERIODS)])
    assert engine.done == MIN_SECTION_PERIODS


@pytest.mark.parametrize(("fails", "dropped"), [(0, 0), (3, 3), (6, 6), (7, 6), (30, 6)])
def test_a_motion_that_fails_at_any_stage_says_why(fails, dropped):
    engine = Wanderer([0], fails=fails)  # settles 6, records 2, goes on for its sections
    motion = stationary(engine, 2, 4, None, 6)
    assert motion == FailedMotion("diverged", f"period {fails}", dropped)


def test_the_shortest_return_counts():
    states = [np.array([float(x)]) for x in (0, 1, 0, 1, 0)]
    assert return_period(states) == 2
    assert return_period([*states, np.array([0.0])]) == 1
    assert return_period([np.array([0.0]), np.array([0.9 * STATE_RETURN_TOLERANCE])]) == 1
    assert return_period([np.array([0.0]), np.array([1.1 * STATE_RETURN_TOLERANCE])]) is None
    assert return_period(states[:1]) is None
