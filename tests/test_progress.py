"""What a running study or sweep says of itself."""

import io

import pytest
from rich.console import Console

from calib.cli.diagnose import DiagnosisProgress
from calib.progress import Count, Progress
from calib.store import Trial


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_without_a_terminal_a_line_comes_every_few_seconds(capsys):
    clock = Clock()
    with Progress(100, console=Console(stderr=True, width=200), clock=clock) as progress:
        for number in range(20):
            clock.now += 1.0
            trial = Trial(number, [0.5], {}, 1.0 / (number + 1), kind="period-1", phase="search")
            progress.trial(trial, trial, number + 1)
    lines = capsys.readouterr().err.splitlines()
    assert 3 <= len(lines) <= 5
    assert "best 0.05 (period-1)  1 trials/s  0 failed  at most 1:20 left" in lines[-1]


def test_the_leaders_are_counted_while_they_are_confirmed(capsys):
    with Progress(100, console=Console(stderr=True, width=200)) as progress:
        progress.stage("confirm")
        for done in (1, 2):
            progress.leader(done, 2)
        progress.stage("confidence")
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["confirm"] * 3 + ["confidence"]
    assert ["leaders" in line for line in lines] == [False, True, True, False]
    assert lines[2].endswith("2/2 leaders")


@pytest.mark.parametrize(
    ("amplitudes", "said"),
    [
        ([1.5e-3, 1.8e-3], "no point of the screen reaches displacement amplitude of bob in swing: measured 1 mm, "
                           "nearest 1.5 mm (50 % off)"),
        ([0.8e-3, 1.8e-3], "the screen reaches every measured feature"),
    ],
)  # fmt: skip
def test_what_the_screen_does_not_reach_is_said_before_the_search(amplitudes, said):
    console = Console(file=io.StringIO(), width=200)
    progress = Progress(10, console=console)
    feature = {"label": "displacement amplitude", "record": "swing", "body": "bob", "unit": "m", "measured": 1e-3,
               "tolerance": 2e-5}  # fmt: skip
    for number, amplitude in enumerate(amplitudes):
        trial = Trial(number, [0.5], {}, 0.1, features=[{**feature, "simulated": amplitude}], phase="screen")
        progress.stage("screen")
        progress.trial(trial, trial, number + 1)
    assert said not in console.file.getvalue()
    progress.trial(Trial(2, [0.5], {}, 0.1, phase="search"), trial, 3)
    assert console.file.getvalue().count(said) == 1


# --- a count


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("calib.progress.time.monotonic", clock)
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


def test_a_diagnosis_says_what_it_simulates_and_how_much_is_foreseen(capsys):
    clock = Clock()
    with DiagnosisProgress(False, Console(stderr=True, width=200), clock) as progress:
        progress.stage("suspects 1")
        for done in range(1, 101):
            clock.now += 0.2
            progress.simulated(done, 150)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "   0.0 s  suspects 1"
    assert 3 <= len(lines) <= 5
    assert lines[-1].endswith(" of about 150 simulations")


def test_a_quiet_diagnosis_says_nothing(capsys):
    with DiagnosisProgress(True, Console(stderr=True), Clock()) as progress:
        progress.stage("suspects 1")
        progress.simulated(1, 2)
    assert capsys.readouterr().err == ""
