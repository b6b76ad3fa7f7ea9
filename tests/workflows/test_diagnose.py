"""`calib diagnose` and `calib rehearse` on a small study, files and all."""

import json
import math
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomlkit
from click.testing import CliRunner
from undrawn import undrawn

from calib.cli import main
from calib.diagnosis.speculation import _Memory
from calib.diagnosis.transfer import Transfer
from calib.effects.cubic_stiffness import EFFECT as CUBIC
from calib.errors import CalibError
from calib.execution.pools import started
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter, Space, Window
from calib.modelling.simulator import Request
from calib.objective import MISFIT
from calib.records import make, write
from calib.records.excitation import Excitation
from calib.report.pages.picture import drawn
from calib.simulators.oscillator import Oscillator
from calib.study import evaluate
from calib.study_file import load
from calib.workflows.diagnose import SIMULATIONS, diagnose_study
from calib.workflows.extension import _widened, _windows
from calib.workflows.kept_simulations import kept_simulations
from calib.workflows.rehearse import REHEARSAL, rehearse_study
from calib.workflows.stored import base_study

ENOUGH_BYTES = 300_000  # of simulations that are kept, before a diagnosis is killed
ONE_CANDIDATE = {"candidates": ["cubic_stiffness"], "jobs": 1}
TIMES = np.arange(400) / 400.0  # s
STUDY = """
[study]
name = "spring"
seed = 1
budget = 24

[[record]]
name = "swept"
path = "swept.nc"

[[record]]
name = "later"
path = "later.nc"
use = "holdout"

[model]
simulator = "oscillator"
fixed = { mass = 1.0, "initial_displacement@later" = 0.0 }

[windows]
damping = { low = 0.5, high = 8.0 }
stiffness = { low = 3000.0, high = 5000.0 }

[[term]]
feature = "time_history"

[diagnosis]
candidates = ["cubic_stiffness", "channel_lag", { name = "coulomb_friction", bodies = ["mass"] }]
"""


def record(amplitude, seed):
    """A swept force on a hardening spring, with noise."""
    rng = np.random.default_rng(seed)
    force = amplitude * np.sin(2.0 * np.pi * (4.0 * TIMES + 8.0 * TIMES**2))
    drive = Excitation("mass", "force", time=TIMES, value=force)
    values = {"mass": 1.0, "damping": 2.0, "stiffness": 4000.0, "k3": 5e5}
    motion = Model(Oscillator(), [CUBIC]).run(values, drive, Request(times=TIMES))
    channels = {}
    for channel in ("displacement", "velocity"):
        rows = motion[channel].values
        channels[channel] = rows + 0.01 * rows.std() * rng.standard_normal(rows.shape)
    made = make(TIMES, ["mass"], channels, place="mass", quantity="force")
    return made.assign(excitation=("time", force, {"units": "N"}))


@pytest.fixture(scope="module")
@undrawn()
def folder(tmp_path_factory):
    """A calibrated study."""
    place = tmp_path_factory.mktemp("spring")
    for name, amplitude, seed in (("swept", 8.0, 0), ("later", 12.0, 1)):
        write(record(amplitude, seed), place / f"{name}.nc")
    (place / "study.toml").write_text(STUDY)
    assert CliRunner().invoke(main, ["run", str(place), "-q"]).exit_code == 0
    return place


@pytest.fixture(scope="module")
def answer(folder):
    return CliRunner().invoke(main, ["diagnose", str(folder), "--apply"], catch_exceptions=False)


def test_the_cause_is_printed_with_its_gain(answer):
    assert answer.exit_code == 0
    assert "named: cubic_stiffness" in answer.output
    assert "gain on records held out (later)" in answer.output


def test_the_document_and_the_page_are_written(folder, answer):
    said = json.loads((folder / "out" / "diagnosis.json").read_text())
    assert (said["verdict"], said["causes"]) == ("named", ["cubic_stiffness"])
    assert said["gain"]["proven"]
    assert "cubic_stiffness" in (folder / "out" / "report.html").read_text()


@pytest.mark.slow
def test_on_workers_elsewhere_it_is_the_same(folder, answer, tmp_path):
    there = shutil.copytree(folder, tmp_path / "there")
    pool = "executor:concurrent.futures:ThreadPoolExecutor,max_workers=2"
    asked = CliRunner().invoke(main, ["diagnose", str(there), "--pool", pool], catch_exceptions=False)
    assert asked.exit_code == 0
    started.end_all()
    here, elsewhere = (json.loads((place / "out" / "diagnosis.json").read_text()) for place in (folder, there))
    assert elsewhere.pop("seconds") > 0.0
    assert elsewhere == {key: value for key, value in here.items() if key != "seconds"}


@pytest.mark.slow
def test_a_diagnosis_that_was_killed_goes_on_from_its_simulations(folder, answer, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    kept, command = copy / "out" / SIMULATIONS, [sys.executable, "-m", "calib", "diagnose", str(copy)]
    killed = subprocess.Popen([*command, "-q"])
    while not (kept.exists() and kept.stat().st_size > ENOUGH_BYTES):
        assert killed.poll() is None, "the diagnosis ended before it was killed"
        time.sleep(0.01)
    killed.kill()
    killed.wait()
    again = subprocess.run(command, check=True, capture_output=True, text=True)
    assert re.search(r"going on with \d{2,} simulations of a run that did not end", again.stderr)
    assert not kept.exists()
    of_each = [json.loads((place / "out" / "diagnosis.json").read_text()) for place in (folder, copy)]
    for said in of_each:
        del said["seconds"]
    assert of_each[0] == of_each[1]


def test_what_was_simulated_before_the_budget_was_spent_is_not_simulated_again(folder, tmp_path, monkeypatch):
    simulated, said, add = [], [], _Memory.add
    monkeypatch.setattr(_Memory, "add", lambda memory, key, result: (simulated.append(key), add(memory, key, result)))
    copy, other = (shutil.copytree(folder, tmp_path / name) for name in ("copy", "other"))
    in_all = diagnose_study(other, **ONE_CANDIDATE)[0].simulations
    one_run = len(simulated)
    assert one_run > 40
    assert diagnose_study(copy, budget="20", **ONE_CANDIDATE)[0].cut_short
    cut = len(simulated) - one_run
    result, _ = diagnose_study(copy, on_stage=said.append, **ONE_CANDIDATE)
    assert (result.causes, result.simulations) == (("cubic_stiffness",), in_all)
    assert said[0] == f"going on with {cut} simulations of a run that did not end"
    assert cut >= 15
    assert len(simulated) == 2 * one_run
    assert not (copy / "out" / SIMULATIONS).exists()


@pytest.mark.slow
def test_another_process_finds_what_was_simulated_and_not_for_other_data(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    (copy / "study.toml").write_text(re.sub("candidates = .*", 'candidates = ["cubic_stiffness"]', STUDY))
    kept, command = copy / "out" / SIMULATIONS, [sys.executable, "-m", "calib", "diagnose", str(copy), "--jobs", "1"]
    sizes = []
    for _ in range(2):
        subprocess.run([*command, "--budget", "20", "-q"], check=True)
        sizes.append(kept.stat().st_size)
    assert sizes[0] == sizes[1] > 10 * 400 * 8
    for data, known in ((False, True), (True, False)):
        if data:
            write(record(8.0, 5), copy / "swept.nc")
        with kept_simulations(load(copy), SIMULATIONS, lambda text: None) as simulations:
            assert (10 < simulations.known <= 20) == known


def test_the_extended_study_starts_where_the_diagnosis_ended(folder, answer):
    said = json.loads((folder / "out" / "diagnosis.json").read_text())
    space = load(folder / "study.extended.toml").study.space
    assert space.start == {name: pair["after"] for name, pair in said["parameters"].items()}
    assert set(space.start) == {"damping", "stiffness", "k3"}
    assert space.windows["damping"] == Window(0.5, 8.0)  # as it was


def test_its_windows_hold_the_joint_size_and_that_of_each_record(folder, answer):
    said = json.loads((folder / "out" / "diagnosis.json").read_text())
    window = load(folder / "study.extended.toml").study.space.windows["k3"]
    [cause] = [s for s in said["suspects"] if s["effect"] == "cubic_stiffness"]
    low, high = cause["interval"]["k3"]
    size, error = cause["size"]["k3"], (high - low) / (2.0 * 1.96)
    assert window.low <= size - 3.9 * error < size + 3.9 * error <= window.high  # of the first round, not the last
    assert {t["record"] for t in said["gain"]["transfers"]} == {"swept", "later"}
    assert all(window.low < t["size"] < window.high for t in said["gain"]["transfers"])
    assert window.high - window.low < 0.5 * size


def test_the_size_of_a_record_alone_is_as_uncertain_as_the_joint_one(folder, answer):
    """Of one record the joint fit is the refit of that record."""
    gain = json.loads((folder / "out" / "diagnosis.json").read_text())["gain"]
    sizes = {t["record"]: t for t in gain["transfers"]}
    assert set(sizes) == {"swept", "later"}
    assert sizes["swept"]["error"] > 0.5 * 13e3
    assert all(abs(t["size"] - 5e5) < 3.0 * t["error"] for t in sizes.values())
    [agreement] = gain["agreements"]
    assert agreement["agree"]


@pytest.mark.slow
def test_the_extended_study_gives_what_the_diagnosis_gave(folder, answer, monkeypatch):
    monkeypatch.setattr("calib.report.pages.page.drawn", drawn)  # unlike the other tests of this file
    extended = folder / "study.extended.toml"
    assert CliRunner().invoke(main, ["run", str(extended), "-q"]).exit_code == 0
    said = json.loads((folder / "out" / "diagnosis.json").read_text())
    found = json.loads((folder / "out.extended" / "result.json").read_text())
    for name, error in found["confidence"]["standard_error"].items():
        assert abs(found["values"][name] - said["parameters"][name]["after"]) < 2.0 * error
    assert found["holdout"]["later"]["misfit"] == pytest.approx(said["gain"]["after"], rel=0.03)
    assert found["at_edge"] == []
    page = (folder / "out.extended" / "report.html").read_text()
    assert "Without the extension (study spring): distance " in page
    assert ">without the extension<" in page


def test_an_extended_study_knows_the_results_of_the_one_that_it_extends(folder, answer):
    base = base_study(load(folder / "study.extended.toml"))
    assert base.result.name == "spring"
    assert set(base.records) == {"swept"}
    assert base_study(load(folder / "study.toml")) is None


def test_both_commands_say_one_misfit_of_the_record_held_out(folder, answer):
    calibrated = json.loads((folder / "out" / "result.json").read_text())["holdout"]["later"]["misfit"]
    gain = json.loads((folder / "out" / "diagnosis.json").read_text())["gain"]
    assert calibrated == pytest.approx(gain["before"], rel=0.03)  # but for the refit
    assert gain["metric"] == MISFIT
    assert MISFIT in answer.output
    page = (folder / "out" / "report.html").read_text()
    assert page.count(MISFIT) >= 3


@pytest.mark.slow
def test_a_third_partys_effect_stands_in_the_extended_study_as_it_was_loaded(tmp_path, folder):
    shutil.copytree(folder, tmp_path / "own")
    path = tmp_path / "own" / "study.toml"
    path.write_text(STUDY.replace('"cubic_stiffness"', '"third_party.hardening:HARDENING"'))
    _, extended = diagnose_study(path, apply=True)
    before, file = load(path), load(extended)
    [effect] = file.study.model.effects
    assert (effect.name, effect.bodies) == ("stiffer_when_bent", ("mass",))
    assert file.effect_references() == before.effect_references()
    assert file.others["later"].use == "holdout"
    assert file.study.space.fixed["initial_displacement@later"] == 0.0
    at = file.study.space.values(file.study.space.starting_point)
    assert evaluate(file.study, at).score.cost < 0.011  # of 1 % noise


def test_what_was_not_calibrated_is_not_diagnosed(tmp_path, folder):
    for name in ("swept.nc", "later.nc", "study.toml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    answer = CliRunner().invoke(main, ["diagnose", str(tmp_path)])
    assert answer.exit_code == 1
    assert "calib run" in answer.output


def test_values_that_were_found_for_other_records_are_not_diagnosed(tmp_path, folder):
    shutil.copytree(folder, tmp_path / "changed")
    shutil.copy(folder / "later.nc", tmp_path / "changed" / "swept.nc")
    begun = []
    with pytest.raises(CalibError, match=r"was made by another study:\n  records\.swept") as refusal:
        diagnose_study(tmp_path / "changed", on_stage=begun.append)
    assert not begun
    assert f"`calib run {tmp_path / 'changed' / 'study.toml'} --fresh`" in str(refusal.value)
    (tmp_path / "changed" / "out" / REHEARSAL).write_text("played")
    with pytest.raises(CalibError, match="another study"):
        rehearse_study(tmp_path / "changed", fresh=True)
    assert (tmp_path / "changed" / "out" / REHEARSAL).read_text() == "played"


def test_an_unknown_candidate_is_refused_with_its_line(tmp_path, folder):
    for name in ("swept.nc", "later.nc"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "study.toml").write_text(STUDY.replace('"channel_lag"', '"chanel_lag"'))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "result.json").touch()
    answer = CliRunner().invoke(main, ["diagnose", str(tmp_path)])
    assert answer.exit_code == 1
    assert "channel_lag" in answer.output
    assert "line" in answer.output


@pytest.mark.slow
def test_a_rehearsal_goes_on_where_it_was_stopped(folder):
    asked = {"seeds": 1, "strengths": [40.0], "jobs": 1}
    played = rehearse_study(folder, **asked)
    assert {one.case.effect for one in played} == {"nothing", "cubic_stiffness", "channel_lag", "coulomb_friction"}
    assert next(one for one in played if one.case.effect == "cubic_stiffness").covered
    ledger = folder / "out" / REHEARSAL
    lines = ledger.read_text().splitlines()
    ledger.write_text("\n".join(lines[:-1]) + "\n" + lines[-1][:20])  # killed while it wrote
    told = []
    again = rehearse_study(folder, **asked, on_case=lambda done, of: told.append((done, of)))
    assert told == [(len(played), len(played))]
    assert [one.case.key for one in again] == [one.case.key for one in played]
    text = (folder / "study.toml").read_text()
    (folder / "fewer.toml").write_text(text.replace(', "channel_lag"', ""))
    told.clear()
    rehearse_study(folder / "fewer.toml", out=folder / "out", **asked, on_case=lambda done, of: told.append((done, of)))
    assert told[0][0] == 1  # of other candidates all is played anew


# --- windows


class Joint:
    """What a window needs of a joint fit: the size k and its standard error."""

    def __init__(self, error, size=1.0):
        self.of_k, self.size = error or math.inf, size

    def error(self, names):
        return np.full(len(names), self.of_k)

    def half_width(self, names):
        return 1.96 * self.error(names)

    def value(self, name):
        return self.size


def window(error, *alone, low=0.0, high=np.inf, size=1.0):
    stiffness = Parameter("k", "N/m", 0.0, "stiffness", null=0.0, low=low, high=high)
    cause = SimpleNamespace(parameters=[stiffness], scale={"k": 1e-3})
    return _windows(cause, Joint(error, size), alone)["k"]


@pytest.mark.parametrize("error", [1e-9, 0.01, 0.05, 0.2, 3.0, 0.0])
def test_a_window_holds_four_joint_standard_errors_within_what_makes_sense(error):
    found = window(error, high=4.5)
    half = max(4.0 * error, 0.1)
    assert found.low == pytest.approx(max(0.0, 1.0 - half), abs=0.01 * half) or error == 0.0
    assert 0.0 <= found.low <= max(0.0, 1.0 - half)
    assert min(4.5, 1.0 + half) <= found.high <= 4.5


def test_a_window_at_the_bound_of_its_parameter_is_no_point():
    assert window(0.0, size=0.0) == Window(0.0, 1e-4)
    assert window(0.1, high=1.0) == Window(0.6, 1.0)


def test_a_window_holds_the_sizes_of_records_that_know_the_effect():
    alone = [Transfer("clear", "k", 1.3, 0.01, False), Transfer("vague", "k", 9.0, 5.0, False)]
    assert window(0.03, *alone, Transfer("held out", "k", 2.0, 0.01, True)) == Window(0.88, 1.3)


@pytest.mark.parametrize(
    ("size", "error", "scale", "allowed", "expected"),
    [
        (2.0, 0.1, "linear", (0.0, np.inf), (1.0, 3.0)),
        (3.0, 0.0, "linear", (0.0, np.inf), (1.0, 4.0)),  # at its edge
        (2.95, 0.02, "linear", (0.0, 3.2), (1.0, 3.2)),
        (2.95, 0.01, "linear", (0.0, np.inf), (1.0, 3.0)),  # five standard errors inside
        (1.01, 0.1, "linear", (0.9, np.inf), (0.9, 3.0)),
        (2.0, 9.0, "linear", (0.0, np.inf), (1.0, 3.0)),  # not known, and in the middle
        (1.0, 0.1, "log", (0.0, np.inf), (3.0**-0.5, 3.0)),
    ],
)
def test_a_window_at_whose_edge_the_diagnosis_ended_is_widened(size, error, scale, allowed, expected):
    document = tomlkit.parse("[windows]\nk = { low = 1.0, high = 3.0 } # guessed\n")
    space, known = Space({"k": Window(1.0, 3.0, scale)}), Parameter("k", "N/m", 1.0, "stiffness")
    parameter = replace(known, low=allowed[0], high=allowed[1])
    _widened(document["windows"], space, {"k": parameter}, Joint(error, size))
    found = document["windows"]["k"]
    assert (found["low"], found["high"]) == pytest.approx(expected)
    assert ("guessed; " in tomlkit.dumps(document)) == (expected != (1.0, 3.0))
