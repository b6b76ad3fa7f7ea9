"""The time that a call may take, as code in it sees it."""

import math
import time

import pytest

from calib.execution.deadline import remaining, within
from calib.execution.pools.local import LocalPool


def test_time_that_remains_is_known_inside_a_call_only():
    now = time.monotonic()
    assert remaining(now) == math.inf
    with within(5.0):
        assert remaining(now) == pytest.approx(5.0, abs=1.0)
        with within(None):
            assert remaining(now) == math.inf
    assert remaining(now) == math.inf


def test_a_part_of_a_first_call_has_the_time_of_a_later_one():
    now = time.monotonic()
    with within(125.0, 5.0):
        assert remaining(now) == pytest.approx(5.0, abs=1.0)
        assert remaining(now - 100.0) < 0.0
    with within(2.0, 5.0):
        assert remaining(now) == pytest.approx(2.0, abs=1.0)


def test_a_pool_tells_its_calls_their_time():
    with LocalPool(remaining, 1, timeout=50.0) as pool:
        [(_, left)] = pool.map([time.monotonic()])
    assert 10.0 < left <= 50.0
