"""A run is given up by the time in which it was not suspended."""

import math

import pytest

from calib.execution.deadline import within
from calib.simulators.command import rung
from calib.simulators.command.rung import Watch


@pytest.fixture
def now(monkeypatch):
    """Return the time that every clock shows, in a list."""
    shown = [1000.0]
    monkeypatch.setattr("time.monotonic", lambda: shown[0])
    return shown


def looked(watch, now, passed):
    """Let time pass, with a look every quarter of a second; return what the last one says."""
    answer = ""
    for _ in range(round(4 * passed)):
        now[0] += 0.25
        answer = answer or watch()
    return answer


@pytest.fixture
def watch(tmp_path, now):
    """Return a function that makes a watch over a silent run."""
    (tmp_path / "log").touch()
    return lambda inactivity=math.inf: Watch(tmp_path / "log", tmp_path, (), inactivity)


def test_a_time_out_does_not_count_the_time_of_a_suspension(watch, now):
    with within(8.0):
        own = watch()
        assert looked(own, now, 5.0) == ""
        now[0] += 3600.0
        assert looked(own, now, 2.0) == ""
        assert looked(own, now, 1.0) == "no result within 8 s of wall-clock time"  # the limit, not when it gave up
        assert own.status == rung.TIMEOUT


def test_inactivity_does_not_count_the_time_of_a_suspension(watch, now):
    own = watch(inactivity=5.0)
    assert looked(own, now, 3.0) == ""
    now[0] += 3600.0
    assert looked(own, now, 2.0) == ""
    assert looked(own, now, 1.0) == "no output for 5 s"
