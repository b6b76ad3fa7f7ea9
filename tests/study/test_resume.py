"""A study that was killed and taken up again is the study that was not killed, bit for bit."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
from child_environment import environment
from kills import KILLS
from study_fakes import Wanderer, lines, run, study

from calib import plugins
from calib.errors import CalibError
from calib.store import Store, read
from calib.store import ledger as ledger_room

BUDGET = max(50, 10 * KILLS)
SCRIPT = """
import sys
from study_fakes import study
from calib.store import Store
if __name__ == "__main__":
    folder, jobs = sys.argv[1], int(sys.argv[2])
    study({budget}, jobs=jobs, seconds=0.004, trouble="diverge").run(Store(folder, view=None))
"""


def whole(folder):
    """Result of the study of SCRIPT without any kill."""
    return run(study(BUDGET, trouble="diverge"), folder)


def start(tmp_path, jobs):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(budget=BUDGET))
    return subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "out"), str(jobs)],
        env=environment(), stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def logged(folder):
    path = folder / "trials.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def kill_within(process, folder, more, delay):
    """SIGKILL the parent once `more` lines have been added, after a delay [s]; False if it ended before."""
    wanted, deadline = logged(folder) + more, time.time() + 60
    while logged(folder) < wanted and process.poll() is None and time.time() < deadline:
        time.sleep(0.001)
    time.sleep(delay)
    killed = process.poll() is None
    if killed:
        os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    return killed


def killed_and_resumed(tmp_path, jobs, kills):
    """Kill the study so often at random moments, run it to its end, and return how many kills hit."""
    chance, hits = random.Random(jobs), 0
    for _ in range(kills):
        more = chance.randint(0, max(1, BUDGET // kills))
        hits += kill_within(start(tmp_path, jobs), tmp_path / "out", more, chance.uniform(0.0, 0.02))
    last = start(tmp_path, jobs)
    _, err = last.communicate(timeout=120)
    assert last.returncode == 0, err
    return hits


def assert_same(tmp_path):
    header, trials = read(tmp_path / "out")
    expected = whole(tmp_path / "whole")
    assert header.segment == 0
    assert lines(trials) == lines(expected.trials)
    with Store(tmp_path / "out") as store:
        store.open(study(BUDGET, trouble="diverge").header)
        assert store.best.number == expected.best.number


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_killed_study_ends_as_the_uninterrupted_one(tmp_path, jobs):
    assert killed_and_resumed(tmp_path, jobs, KILLS) >= 2 * KILLS // 3
    assert_same(tmp_path)


@pytest.mark.slow
def test_an_interrupted_study_goes_on_with_another_number_of_jobs(tmp_path):
    assert kill_within(start(tmp_path, 2), tmp_path / "out", 5, 0.0)
    last = start(tmp_path, 1)
    _, err = last.communicate(timeout=60)
    assert last.returncode == 0, err
    assert_same(tmp_path)


def test_a_finished_study_is_not_run_again(tmp_path):
    first = run(study(20), tmp_path)
    before = (tmp_path / "trials.jsonl").read_bytes()
    again = run(study(20), tmp_path, on_trial=lambda *_: pytest.fail("a trial was evaluated again"))
    assert lines(again.trials) == lines(first.trials)
    assert (tmp_path / "trials.jsonl").read_bytes() == before
    assert again.agreement == first.agreement


@pytest.mark.parametrize("name", plugins.names("calib.optimisers"))
def test_every_optimiser_can_be_replayed(tmp_path, name):
    a_study = study(40, optimiser=plugins.load("calib.optimisers", name))
    for count in (3, 13, 22, 31):
        stop_at(a_study, tmp_path / "broken", count)
    found, expected = run(a_study, tmp_path / "broken"), run(a_study, tmp_path / "whole")
    assert lines(found.trials) == lines(expected.trials)
    assert found.stopped == expected.stopped


def cut(source, target, name, size):
    """Copy a ledger with one of its files cut to a size."""
    target.mkdir(exist_ok=True)
    for file in ("trials.jsonl", "residuals.f64"):
        shutil.copy(source / file, target / file)
    os.truncate(target / name, size)


def test_a_ledger_torn_at_any_byte_of_its_end_opens_to_a_beginning_of_it(tmp_path):
    a_study = study(12)
    trials = run(a_study, tmp_path / "whole").trials
    raw = (tmp_path / "whole" / "trials.jsonl").read_bytes()
    starts = [0, *(i + 1 for i, byte in enumerate(raw) if byte == 10)]
    for size in [*range(starts[-4], starts[-2], 11), *range(starts[-2], len(raw))]:
        cut(tmp_path / "whole", tmp_path / "cut", "trials.jsonl", size)
        with Store(tmp_path / "cut", view=None) as store:
            left = store.open(a_study.header)
        count = sum(begin <= size for begin in starts[1:]) - 1  # whole lines, less the header
        assert lines(left) == lines(trials[:count])
        assert (tmp_path / "cut" / "trials.jsonl").read_bytes() == raw[: starts[count + 1]]
        longest = max((trial.residuals.size for trial in left), default=0)
        assert (tmp_path / "cut" / "residuals.f64").stat().st_size == 8 * longest * count


def test_a_ledger_torn_within_its_header_is_a_new_one(tmp_path):
    a_study = study(12)
    trials = run(a_study, tmp_path / "whole").trials
    raw = (tmp_path / "whole" / "trials.jsonl").read_bytes()
    for size in (0, 1, raw.index(b"\n") // 2, raw.index(b"\n")):
        cut(tmp_path / "whole", tmp_path / "cut", "trials.jsonl", size)
        assert lines(run(a_study, tmp_path / "cut").trials) == lines(trials)


def test_a_study_goes_on_from_wherever_its_files_were_torn(tmp_path):
    a_study = study(16)
    trials = run(a_study, tmp_path / "whole").trials
    size = (tmp_path / "whole" / "trials.jsonl").stat().st_size
    for lost in range(0, 1500, 83):
        cut(tmp_path / "whole", tmp_path / "cut", "trials.jsonl", size - lost)
        assert lines(run(a_study, tmp_path / "cut").trials) == lines(trials)


def test_trials_whose_residuals_are_lost_are_evaluated_again(tmp_path):
    a_study = study(12)
    trials = run(a_study, tmp_path / "whole").trials
    size = (tmp_path / "whole" / "residuals.f64").stat().st_size
    for lost in (1, 8, 41 * 8, 41 * 8 + 3, size):
        cut(tmp_path / "whole", tmp_path / "cut", "residuals.f64", size - lost)
        with pytest.warns(UserWarning, match="residuals are lost"):
            found = run(a_study, tmp_path / "cut")
        assert lines(found.trials) == lines(trials)


def test_residuals_without_a_line_are_written_over(tmp_path):
    a_study = study(12)
    trials = run(a_study, tmp_path / "whole").trials
    cut(tmp_path / "whole", tmp_path / "cut", "trials.jsonl", 0)
    assert lines(run(a_study, tmp_path / "cut").trials) == lines(trials)
    sizes = [(tmp_path / name / "residuals.f64").stat().st_size for name in ("whole", "cut")]
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize("missing", [(9,), (3,), (8, 10), (1, 5, 6), (13,)])
def test_batches_that_ended_out_of_order_are_completed(tmp_path, missing):
    """With several jobs a kill may leave any holes in the last batch; here, in any batch."""
    a_study = study(20)
    trials = run(a_study, tmp_path).trials
    path = tmp_path / "trials.jsonl"
    kept = [
        line for line in path.read_text().splitlines(keepends=True)
        if json.loads(line).get("number") not in missing
    ]  # fmt: skip
    path.write_text("".join(kept))
    seen = []
    found = run(a_study, tmp_path, on_trial=lambda trial, *_: seen.append(trial.number))
    assert tuple(seen) == missing
    assert lines(found.trials) == lines(trials)


class Other(Wanderer):
    """Another search under the same name."""

    def ask(self):
        return 0.5 * super().ask()


def test_a_replay_that_differs_is_told_and_nothing_is_written(tmp_path):
    run(study(20), tmp_path)
    before = (tmp_path / "trials.jsonl").read_bytes()
    with pytest.raises(CalibError, match="the log cannot be replayed: trial 8"):
        run(study(30, optimiser=Other), tmp_path)
    after = (tmp_path / "trials.jsonl").read_bytes()
    assert [json.loads(x) for x in after.splitlines() if "number" in json.loads(x)] == [
        json.loads(x) for x in before.splitlines() if "number" in json.loads(x)
    ]


@pytest.fixture
def other_machine(monkeypatch):
    """Switch to another processor from now on."""

    def switch(name="abacus"):
        elsewhere = replace(ledger_room.environment(), processor=name)
        monkeypatch.setattr(ledger_room, "environment", lambda: elsewhere)

    return switch


def test_another_processor_begins_a_segment_that_knows_the_trials_so_far(tmp_path, other_machine):
    stop_at(study(30), tmp_path, 18)
    before = read(tmp_path)[1]
    other_machine()
    with pytest.warns(UserWarning, match='processor: .* -> "abacus"'):
        found = run(study(30, optimiser=Other), tmp_path)  # no replay: even another search may go on
    assert len(found.trials) == 30
    assert lines(found.trials)[:18] == lines(before)
    assert [t.segment for t in found.trials] == [0] * 18 + [1] * 12
    assert found.agreement == {"told": 30}


def stop_at(a_study, folder, count):
    """Run until `count` trials are logged."""

    def interrupt(trial, best, n):
        if n == count:
            raise KeyboardInterrupt

    return run(a_study, folder, on_trial=interrupt)


def test_a_segment_is_itself_replayed(tmp_path, other_machine):
    for folder in ("broken", "whole"):
        stop_at(study(40), tmp_path / folder, 18)
    other_machine()
    with pytest.warns(UserWarning, match="new segment"):
        expected = run(study(40), tmp_path / "whole")
    with pytest.warns(UserWarning, match="new segment"):
        stop_at(study(40), tmp_path / "broken", 29)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = run(study(40), tmp_path / "broken")
    assert lines(found.trials) == lines(expected.trials)


def test_a_screen_cut_short_is_completed_on_the_other_processor(tmp_path, other_machine):
    stop_at(study(20), tmp_path, 5)
    other_machine()
    with pytest.warns(UserWarning, match="new segment"):
        found = run(study(20), tmp_path)
    assert [t.number for t in found.trials] == list(range(20))
    assert lines(found.trials) == lines(run(study(20), tmp_path / "whole").trials), "the same points, being few"


def test_numbers_are_not_used_twice_after_holes(tmp_path, other_machine):
    a_study = study(20)
    run(a_study, tmp_path)
    path = tmp_path / "trials.jsonl"
    text = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in text[:16] if json.loads(line).get("number") not in (9, 11)))
    other_machine()
    with pytest.warns(UserWarning, match="new segment"):
        found = run(a_study, tmp_path)
    numbers = [t.number for t in found.trials]
    assert len(numbers) == len(set(numbers)) == 20
    assert max(numbers) == 21


def test_floats_survive_the_log_bit_for_bit(tmp_path):
    trials = run(study(20), tmp_path).trials
    again = read(tmp_path)[1]
    assert len(trials) == 20
    for one, other in zip(trials, again, strict=True):
        assert np.array(one.u).tobytes() == np.array(other.u).tobytes()
        assert one.residuals.tobytes() == other.residuals.tobytes()
        assert one.cost.hex() == other.cost.hex()
