"""What a running study says of itself."""

import io

import pytest
from hand_clock import HandClock
from rich.console import Console

from calib.store import Trial
from calib.study.progress import Progress


def test_without_a_terminal_a_line_comes_every_few_seconds(capsys):
    clock = HandClock()
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


def test_draws_of_the_noise_are_counted_every_few_seconds(capsys):
    clock = HandClock()
    with Progress(100, console=Console(stderr=True, width=200), clock=clock) as progress:
        progress.stage("confidence")
        for done in range(100):
            clock.now += 0.2
            progress.draw(done, 100)
        progress.stage("hold-out")
    lines = capsys.readouterr().err.splitlines()
    counted = [int(line.split("/100 draws")[0].split()[-1]) for line in lines if "/100 draws of the noise" in line]
    assert 3 <= len(counted) <= 5
    assert counted == sorted(counted)
    assert "draws" not in lines[-1]


def test_the_time_left_names_the_draws_that_follow_the_search_and_then_theirs(capsys):
    clock = HandClock()
    with Progress(100, console=Console(stderr=True, width=200), clock=clock, draws=50) as progress:
        for number in range(20):
            clock.now += 1.0
            trial = Trial(number, [0.5], {}, 1.0, kind="period-1", phase="search")
            progress.trial(trial, trial, number + 1)
        progress.stage("confidence")
        for done in range(20):
            progress.draw(done, 50)
            clock.now += 2.0
    lines = capsys.readouterr().err.splitlines()
    assert any(line.endswith("at most 1:20 left, then 50 draws of the noise") for line in lines)
    [told] = [line for line in lines if " 15/50 draws" in line]
    assert told.endswith("15/50 draws of the noise  1:10 left of them")


@pytest.mark.parametrize(("stage", "said"), [("search", 0), ("confidence", 1)])
def test_who_stops_the_draws_of_the_noise_is_told_that_they_are_not_kept(capsys, stage, said):
    def stopped():
        with Progress(9, console=Console(stderr=True), draws=50) as progress:
            progress.stage(stage)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert capsys.readouterr().err.count("the draws of the noise are not kept") == said


def test_compiling_is_said_at_once_and_no_longer_than_it_lasts(capsys):
    with Progress(100, console=Console(stderr=True, width=200), clock=HandClock()) as progress:
        progress.stage("screen")
        progress.compiling(True)
        progress.compiling(False)
    lines = capsys.readouterr().err.splitlines()
    assert ["compiling" in line for line in lines] == [False, True, False]


@pytest.mark.parametrize(
    ("amplitudes", "said"),
    [
        ([1.5e-3, 1.8e-3], "no point of the screen reaches displacement amplitude of bob in swing: measured 1 mm, "
                           "nearest 1.5 mm (50 % off)"),
        ([0.8e-3, 1.8e-3], "the screen reaches every measured feature"),
        ([0.8e-3], "the screen is too small to say which measured features it reaches"),
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
