"""How much of a known number is done."""

import io

import pytest
from hand_clock import HandClock
from rich.console import Console

from calib.execution.progress import Count


@pytest.fixture
def clock(monkeypatch):
    clock = HandClock()
    monkeypatch.setattr("calib.execution.progress.time.monotonic", clock)
    return clock


def counted(clock, dones, total=100, **options):
    """Lines of a count that is told one of `dones` every ten seconds."""
    console = Console(file=io.StringIO(), width=200)
    with Count("points", console=console, **options) as count:
        for done in dones:
            count(done, total)
            clock.now += 10.0
    return console.file.getvalue().splitlines()


def test_a_count_says_how_much_is_done_and_how_long_the_rest_takes(clock):
    assert counted(clock, [0, 10, 20, 100]) == [
        "10/100 points  about 1:30 left",
        "20/100 points  about 1:20 left",
        "100/100 points",
    ]


def test_what_was_done_earlier_does_not_count_for_the_time_left(clock):
    assert counted(clock, [50, 60])[-1] == "60/100 points  about 0:40 left"


def test_a_slow_begin_does_not_count_for_the_time_left(clock):
    console = Console(file=io.StringIO(), width=200)
    with Count("points", console=console) as count:
        clock.now += 100.0  # processes start
        for pause, done in ((0.0, 0), (500.0, 1), (10.0, 11), (10.0, 21)):
            clock.now += pause
            count(done, 101)
    assert console.file.getvalue().splitlines()[-1] == "21/101 points  about 1:20 left"


def test_a_count_is_not_told_more_often_than_one_reads(clock):
    console = Console(file=io.StringIO(), width=200)
    with Count("points", console=console) as count:
        for done in range(100):
            count(done, 100)
            clock.now += 1.0
    assert 10 <= len(console.file.getvalue().splitlines()) <= 20


def test_a_quiet_count_says_nothing(clock):
    assert counted(clock, [0, 10, 100], quiet=True) == []


def test_on_a_terminal_a_count_is_a_bar_that_goes_away(clock):
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    with Count("points", console=console) as count:
        count(30, 100)
        count(100, 100)
    shown = console.file.getvalue()
    assert "100/100 points" in shown
    assert "\x1b[2K" in shown[shown.rindex("100/100 points") :]  # the line is erased after it was last shown
