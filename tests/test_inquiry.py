"""`calib diagnose` and `calib rehearse` on a small study, files and all."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from calib import inquiry
from calib.cli import main
from calib.diagnosis.gain import Transfer
from calib.effects.cubic_stiffness import EFFECT as CUBIC
from calib.excitation import Excitation
from calib.model import Model, Request
from calib.parameter import Parameter
from calib.record import make, write
from calib.simulators.oscillator import Oscillator
from calib.study_toml import load

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
fixed = { mass = 1.0 }

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
def test_the_extended_study_runs_at_once_and_fits_better(folder, answer):
    extended = folder / "study.extended.toml"
    file = load(extended)
    assert [effect.name for effect in file.study.model.effects] == ["cubic_stiffness"]
    window = file.study.space.windows["k3"]
    assert window.low < 5e5 < window.high
    assert CliRunner().invoke(main, ["run", str(extended), "-q"]).exit_code == 0
    before, after = (json.loads((folder / out / "result.json").read_text()) for out in ("out", "out.extended"))
    assert after["holdout"]["later"]["distance"] < 0.5 * before["holdout"]["later"]["distance"]


def test_what_was_not_calibrated_is_not_diagnosed(tmp_path, folder):
    for name in ("swept.nc", "later.nc", "study.toml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    answer = CliRunner().invoke(main, ["diagnose", str(tmp_path)])
    assert answer.exit_code == 1
    assert "calib run" in answer.output


def test_an_unknown_candidate_is_refused_with_its_line(tmp_path, folder):
    for name in ("swept.nc", "later.nc"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "study.toml").write_text(STUDY.replace('"channel_lag"', '"chanel_lag"'))
    answer = CliRunner().invoke(main, ["diagnose", str(tmp_path)])
    assert answer.exit_code == 1
    assert "channel_lag" in answer.output
    assert "line" in answer.output


@pytest.mark.slow
def test_a_rehearsal_goes_on_where_it_was_stopped(folder):
    asked = {"seeds": 1, "strengths": [40.0], "jobs": 1}
    played = inquiry.rehearsed(folder, **asked)
    assert {one.case.effect for one in played} == {"nothing", "cubic_stiffness", "channel_lag", "coulomb_friction"}
    assert next(one for one in played if one.case.effect == "cubic_stiffness").covered
    ledger = folder / "out" / inquiry.REHEARSAL
    lines = ledger.read_text().splitlines()
    ledger.write_text("\n".join(lines[:-1]) + "\n" + lines[-1][:20])  # killed while it wrote
    told = []
    again = inquiry.rehearsed(folder, **asked, on_case=lambda done, of: told.append((done, of)))
    assert told == [(len(played), len(played))]
    assert [one.case.key for one in again] == [one.case.key for one in played]


def test_the_window_of_the_extended_study_holds_the_sizes_of_records_that_disagree():
    cause = SimpleNamespace(
        candidate=SimpleNamespace(parameters=[Parameter("k", "N/m", 0.0, "stiffness", null=0.0, low=0.0)]),
        size=np.array([1.0]),
        error=np.array([0.01]),
    )
    alone = [Transfer("clear", "k", 1.3, 0.01, False), Transfer("vague", "k", 9.0, 5.0, False)]
    [(name, low, high)] = inquiry._windows(cause, [*alone, Transfer("held out", "k", 2.0, 0.01, True)])
    assert (name, low, high) == ("k", pytest.approx(0.96), 1.3)
