"""What a running diagnosis says of itself."""

from hand_clock import HandClock
from rich.console import Console

from calib.cli.diagnose import DiagnosisProgress


def test_a_diagnosis_says_what_it_simulates_and_how_much_is_foreseen(capsys):
    clock = HandClock()
    with DiagnosisProgress(False, Console(stderr=True, width=200), clock) as progress:
        progress.stage("suspects 1")
        for done in range(1, 101):
            clock.now += 0.2
            progress.simulated(done, 150)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "   0.0 s  suspects 1"
    assert 3 <= len(lines) <= 5
    assert lines[-1].endswith(" of about 150 simulations")


def test_what_comes_before_the_first_stage_has_a_name(capsys):
    clock = HandClock()
    with DiagnosisProgress(False, Console(stderr=True, width=200), clock) as progress:
        progress.simulated(1, 2)
    assert capsys.readouterr().err == "   0.0 s  starting: 1 of about 2 simulations\n"


def test_a_quiet_diagnosis_says_nothing(capsys):
    with DiagnosisProgress(True, Console(stderr=True), HandClock()) as progress:
        progress.stage("suspects 1")
        progress.simulated(1, 2)
    assert capsys.readouterr().err == ""
