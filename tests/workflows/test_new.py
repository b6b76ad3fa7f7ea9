"""The skeletons work as they are written."""

import subprocess
import sys

import pytest
from child_environment import environment
from click.testing import CliRunner
from undrawn import undrawn

from calib.cli import main
from calib.errors import CalibError
from calib.workflows.calibrate import calibrate
from calib.workflows.dry_run import dry_run_study
from calib.workflows.new import DAMPING, MASS, STIFFNESS, new


def test_skeletons_pass_the_suites_of_their_kinds(tmp_path):
    for kind, name, reference in (("simulator", "swing", "swing:Swing"), ("effect", "own_law", "own_law:EFFECT")):
        ended = CliRunner().invoke(main, ["new", kind, name, "--folder", str(tmp_path)])
        assert ended.exit_code == 0, ended.output
        assert reference in ended.stdout
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-v", "-n", "0", "test_swing.py", "test_own_law.py"],
        cwd=tmp_path, env=environment(), capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert {line.partition("::")[0] for line in done.stdout.splitlines() if " PASSED " in line} == {
        "test_swing.py", "test_own_law.py",
    }  # fmt: skip


@undrawn()
def test_a_new_study_finds_what_its_record_was_made_from(tmp_path):
    new("study", "bench", tmp_path)
    found = calibrate(tmp_path / "bench", quiet=True)
    assert found.values["stiffness"] == pytest.approx(STIFFNESS, rel=0.01)
    assert found.values["damping"] == pytest.approx(DAMPING, rel=0.05)
    for name, truth in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        low, high = found.intervals[name]
        assert low < truth < high


def test_a_new_study_of_a_program_runs_as_it_is_written(tmp_path):
    ended = CliRunner().invoke(main, ["new", "study", "rig", "--program", "--folder", str(tmp_path)])
    assert ended.exit_code == 0, ended.output
    dry = dry_run_study(tmp_path / "rig")
    assert dry.succeeded
    stated = {"mass": MASS, "stiffness": STIFFNESS, "damping": DAMPING}
    assert dry.values == stated, "the values that the record was made from"
    motion, size = dry.run.record, dry.run.record.sizes["time"]
    for channel in ("displacement", "velocity"):
        measured = dry.measured[channel].values[0, :size]
        error = float((motion[channel].values[0] - measured).std() / measured.std())
        assert error < 0.02, "its noise"


def test_a_program_belongs_to_a_study(tmp_path):
    with pytest.raises(CalibError, match="a simulator is written in Python"):
        new("simulator", "swing", tmp_path, program=True)


@undrawn()
def test_a_new_simulator_runs_in_a_study_beside_it(tmp_path):
    new("study", "bench", tmp_path)
    new("simulator", "swing", tmp_path / "bench")
    path = tmp_path / "bench" / "study.toml"
    path.write_text(path.read_text().replace('"oscillator"', '"swing:Swing"'))
    assert calibrate(path, quiet=True, jobs=1).values["stiffness"] == pytest.approx(STIFFNESS, rel=0.01)


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "test_swing.py").write_text("mine")
    with pytest.raises(CalibError, match=r"test_swing\.py is there already"):
        new("simulator", "swing", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["test_swing.py"]


@pytest.mark.parametrize("name", ["Swing", "two words", "3d", "a-b", "../up"])
def test_a_name_that_is_no_module_is_refused(name, tmp_path):
    with pytest.raises(CalibError, match="lower case letters"):
        new("effect", name, tmp_path)


@pytest.mark.parametrize("name", ["class", "signal", "numpy"])
def test_a_name_that_python_has_already_is_refused(name, tmp_path):
    with pytest.raises(CalibError, match="Python"):
        new("simulator", name, tmp_path)
