"""The leaders of a search are simulated again with higher fidelity before one of them is called the best."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from child_environment import environment
from echo_study import write_study
from tiny_simulators import Echo, Sketch

from calib import records
from calib.cli.status import folder_of, study_status
from calib.effects import channel_lag
from calib.errors import CalibError
from calib.execution.pool import TIMEOUT, Failure, InProcess
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.report.formatting import number
from calib.report.pages.verdict import verdict
from calib.store import Trial
from calib.study import MAX_LEADERS, confirm, leaders
from calib.study.progress import Progress
from calib.study_file import load
from calib.testing import SimulatorSuite
from calib.workflows.calibrate import calibrate, rebuild

SKETCH = ("tiny_simulators:Echo", "tiny_simulators:Sketch")
AGAIN = '[[record]]\nname = "again"\npath = "bench.nc"\nnuisance = ["trigger"]\nuse = "holdout"\n\n[model]\n'


def trial(number, cost, *u):
    return Trial(number, list(u), {"gain": u[0]}, cost, kind="period-1")


def without_times(found):
    return replace(found, seconds=0, confirmation=replace(found.confirmation, seconds=0))


def best(folder):
    """best.nc without its provenance, which names the ledger."""
    record = records.read(folder / "best.nc")
    del record.attrs["provenance"]
    return record


@pytest.fixture
def drawn(monkeypatch):
    """What pages are made of, one entry a page; they are not drawn."""
    asked = []
    monkeypatch.setattr("calib.report.pages.page.render", lambda *given: asked.append(given) or "")
    return asked


@pytest.fixture(scope="module")
def confirmed(tmp_path_factory):
    path = write_study(tmp_path_factory.mktemp("confirmed"), SKETCH, ("[model]\n", AGAIN))
    return path, calibrate(path, quiet=True)


# --- the confirming simulator


class Longer(Echo):
    """An echo with a parameter more."""

    parameters = (*Echo.parameters, Parameter("mesh", "1", 3.0, "elements over the length"))


class Misled(Sketch):
    """A sketch that an echo of other parameters confirms."""

    def __init__(self):
        super().__init__()
        self.confirming = Longer()


def test_the_confirming_model_has_the_same_effects():
    model = Model(Sketch(), [channel_lag.EFFECT])
    assert (model.confirming.name, model.confirming.effects) == ("echo + channel_lag", model.effects)
    assert model.confirming.confirming is None


def test_a_confirming_simulator_of_other_parameters_is_refused_when_the_study_is_read(tmp_path):
    path = write_study(tmp_path, ("tiny_simulators:Echo", f"{__name__}:Misled"))
    said = "'sketch' cannot be confirmed by 'echo': they differ in the parameters mesh; both need the same"
    with pytest.raises(CalibError, match=rf"study.toml:\d+: model.simulator: simulator {said}"):
        load(path)


def test_the_suite_sees_whether_the_confirming_simulator_is_of_the_same_kind():
    suite = SimulatorSuite()
    suite.excitation = Excitation("base", "base motion", frequency=10.0, amplitude=1e-3)
    suite.make = Sketch
    suite.test_the_confirming_simulator_has_the_same_parameters_bodies_and_sites()
    suite.test_the_confirming_simulator_pickles()
    suite.test_the_confirming_simulator_takes_the_excitation()
    suite.make = Misled
    with pytest.raises(AssertionError):
        suite.test_the_confirming_simulator_has_the_same_parameters_bodies_and_sites()
    suite.make = Echo
    with pytest.raises(pytest.skip.Exception):
        suite.test_the_confirming_simulator_pickles()


# --- the leaders


def test_leaders_are_the_best_that_ended_ok_and_stand_apart():
    trials = [
        trial(0, 0.5, 0.1, 0.1),
        trial(1, np.inf, 0.2, 0.2),
        trial(2, 0.2, 0.3, 0.3),
        trial(3, 0.1, 0.3, 0.3009),
        trial(4, 0.3, 0.3, 0.302),
        trial(5, 0.1, 0.3, 0.3),
        *(trial(6 + k, 1.0 + k, 0.1 * k, 0.9) for k in range(5)),
    ]
    assert [leader.number for leader in leaders(trials)] == [3, 4, 0, 6]
    assert len(leaders(trials)) == MAX_LEADERS
    assert leaders(trials[1:2]) == []


def confirmation(answers):
    """Trials 7, 8, ... of distances 0.10, 0.11, ... in the search, confirmed at `answers` or failing with them."""
    searched = [trial(7 + k, 0.10 + 0.01 * k, 0.1 * k) for k in range(len(answers))]
    found = iter(answers)

    class Judged:
        seconds, features, simulations = 0.0, (), 1

        def __init__(self, cost):
            self.score = type("Score", (), {
                "cost": cost, "terms": {"a": cost}, "status": "ok", "reason": "", "kind": "period-1",
                "residuals": None,
            })  # fmt: skip

    def evaluate(values):
        answer = next(found)
        return answer if isinstance(answer, Failure) else Judged(answer)

    with InProcess(evaluate) as pool:
        return confirm(pool, searched)


LATE = Failure(TIMEOUT, "no result within 60 s of wall-clock time", 60.0)


@pytest.mark.parametrize(
    ("answers", "chosen", "remarks"),
    [
        ([0.10, 0.111], 7, []),
        ([0.10, 0.10], 7, []),
        ([0.12, 0.11], 8, ["another order: trials 8, 7, not trials 7, 8"]),
        ([0.30], 7, ["trial 7, is at a distance of 0.3 in the confirming simulator and of 0.1 in that of the search"]),
        ([LATE, 0.11], 8, ["not every leader of the search could be confirmed: trial 7 (timeout: no result"]),
        ([LATE, LATE], 7, ["failed at each of its leaders: trials 7, 8 (timeout: no result within 60 s of wall-clock "
                           "time), which a longer [study] timeout may mend"]),
    ],
)  # fmt: skip
def test_the_best_confirmed_is_chosen_and_what_to_mind_is_said(answers, chosen, remarks):
    found = confirmation(answers)
    assert found.best.number == found.chosen.searched.number == chosen
    assert found.changed == (chosen != 7)
    assert len(found.remarks) == len(remarks)
    assert all(part in remark for part, remark in zip(remarks, found.remarks, strict=True))


def test_where_none_is_confirmed_the_best_of_the_search_keeps_its_score():
    found = confirmation([LATE, LATE])
    assert not found.succeeded
    assert (found.best.cost, found.best.status) == (0.10, "ok")


# --- a study


@pytest.mark.slow
def test_the_result_is_what_the_confirming_simulator_says(confirmed):
    path, found = confirmed
    said = found.confirmation
    order = {leader.trial: leader for leader in said.leaders}
    searched = [leader.searched for leader in said.leaders]
    assert searched == sorted(searched)
    assert said.changed
    assert said.chosen == found.best_trial == min(order, key=lambda number: order[number].confirmed)
    assert found.score.total == order[said.chosen].confirmed
    assert found.holdout["again"].score == pytest.approx(found.score.total, rel=1e-12)
    assert [part in " ".join(found.remarks) for part in ("another order", "is at a distance of")] == [True, True]
    assert "simulator of the search, by finite differences about the confirmed point" in found.confidence.reason

    study = load(path).study
    record = Echo().run(found.values, study.objective.references["bench"].excitation, (), Request())
    assert study.objective({"bench": record}).cost == found.score.total


def test_the_best_record_is_the_confirmed_one(confirmed):
    path, found = confirmed
    record = records.read(path.parent / "out" / "best.nc")
    provenance = json.loads(record.attrs["provenance"])
    assert (record.attrs["model"], record.attrs["record"]) == ("echo", "bench")
    assert (record.attrs["trial"], provenance["trial"]) == (found.best_trial, found.best_trial)
    assert (provenance["score"]["total"], provenance["confirmed"]) == (found.score.total, True)
    assert provenance["values"] == found.values


@pytest.mark.slow
def test_a_study_stopped_while_it_confirms_and_run_again_finds_the_same(confirmed, tmp_path, monkeypatch, drawn):
    path, uninterrupted = confirmed

    def stop(self, done, total):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Progress, "leader", stop)
        with pytest.raises(KeyboardInterrupt):
            calibrate(path, tmp_path, quiet=True)
    assert best(tmp_path).attrs["model"] == "sketch"
    found = calibrate(path, tmp_path, quiet=True)
    assert without_times(found) == without_times(uninterrupted)
    assert best(tmp_path).identical(best(path.parent / "out"))


@pytest.mark.slow
def test_a_study_killed_while_it_confirms_and_run_again_finds_the_same(confirmed, tmp_path):
    gate = tmp_path / "gate"
    gate.touch()
    options = f'options = {{ fault = "waits", above = 0.0, gate = "{gate}" }}'
    path = write_study(tmp_path, SKETCH, ("[model]\n", AGAIN), ("[windows]", f"{options}\n[windows]"))
    command = [sys.executable, "-m", "calib", "run", str(path)]
    with subprocess.Popen(command, env=environment(), stderr=subprocess.PIPE, text=True) as run:
        assert any(line.startswith("confirm:") for line in run.stderr)
        assert study_status(path, None).state == "running"
        run.kill()
    gate.unlink()
    assert study_status(path, None).state == "unfinished"
    assert without_times(calibrate(path, quiet=True)) == without_times(confirmed[1])
    assert best(tmp_path / "out").identical(best(confirmed[0].parent / "out"))


def test_the_page_shows_the_leaders(confirmed):
    page = (confirmed[0].parent / "out" / "report.html").read_text()
    table = page[page.index("Leading trials, confirmed") : page.index("<h2>The search")]
    plain = re.sub("</?strong>", "", table)
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", plain, re.S)]
    found = confirmed[1].confirmation
    assert len(found.leaders) > 1
    shown = [[number(one) for one in (leader.trial, leader.searched, leader.confirmed)] for leader in found.leaders]
    assert [row[:3] for row in rows if row] == shown
    assert f"<strong>{number(found.chosen)}</strong>" in table
    assert "the best point of the search is another one" in page


def test_a_finished_study_keeps_its_confirmation_in_status_and_report(confirmed, drawn):
    path, found = confirmed
    said = study_status(path, None)
    assert (said.state, said.best.number) == ("finished", found.best_trial)
    assert (said.best.total, said.best.values) == (found.score.total, found.values)
    rebuild(path)
    _, _, simulated, said, *_ = drawn[0]
    assert said == found
    assert {name: record.attrs["model"] for name, record in simulated.items()} == {"bench": "echo", "again": "echo"}
    assert json.loads(simulated["bench"].attrs["values"]) == found.values


def test_where_no_leader_is_confirmed_the_best_of_the_search_stays(tmp_path, drawn):
    options = 'options = { fault = "raises", above = 0.0 }'
    path = write_study(tmp_path, SKETCH, ("[windows]", f"{options}\n[windows]"))
    found = calibrate(path, quiet=True)
    leader = found.confirmation.leaders[0]
    assert found.best_trial == found.confirmation.chosen == leader.trial
    assert found.score.total == leader.searched
    assert (leader.confirmed, leader.status) == (None, "raised")
    assert "nothing is confirmed" in found.remarks[0]
    assert records.read(tmp_path / "out" / "best.nc").attrs["model"] == "sketch"
    _, _, simulated, *_ = drawn[0]
    assert simulated["bench"].attrs["model"] == "sketch"
    assert (verdict(found).tone, "not confirmed" in verdict(found).headline) == ("bad", True)


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("study.toml", "out"), ("study.extended.toml", "out.extended"), ("study.loud.toml", "out.loud"),
        ("study.loud.extended.toml", "out.loud.extended"), ("tennis.toml", "out"),
        ("tennis.extended.toml", "out.extended"), ("tennis.extended.extended.toml", "out.extended.extended"),
        ("study.found.toml", "out.found"), ("tennis.extended.found.toml", "out.extended.found"),
    ],
)  # fmt: skip
def test_the_commands_look_for_results_where_a_run_leaves_them(tmp_path, name, folder):
    path = tmp_path / name
    path.write_text("")
    assert folder_of(path, None) == tmp_path / folder
    assert folder_of(path, tmp_path / "elsewhere") == tmp_path / "elsewhere"
