"""The sensitivity of a study: kinds of motion, failures, resumption, the command."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial

import pytest
from child_environment import environment
from click.testing import CliRunner
from echo_study import bench, write_study
from tiny_simulators import Echo

import calib
from calib import records
from calib.cli import main
from calib.errors import CalibError
from calib.execution.pool import InProcess
from calib.store import Store
from calib.study import evaluate
from calib.study_file import load
from calib.sweep.sensitivity import SensitivityDesign, analyse, evaluated
from calib.sweep.sensitivity.document import FEATURE, KIND, STATUS, SensitivityResult, read

DOUBLED = ('"tiny_simulators:Echo"', '"tiny_simulators:Doubled"')  # of the measured kind in half of the box
FAILING = ("[windows]", "[model.options]\nfails_above = 0.0005\n\n[windows]")  # in a quarter of the box


def calib_command(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    return ended


def sensitivity(path, out="out", method="morris", groups=6, **more):
    """The sensitivity of a study file, evaluated in this process."""
    study = load(path).study
    design = SensitivityDesign(method, study.space.dim, groups, study.seed)
    store = Store(path.parent / out, view=None, keep="best")
    return analyse(study, design, evaluated(study, design, store, InProcess(partial(evaluate, study)), **more))


def output(result, of, label=""):
    return next(one for one in result.outputs if one.of == of and label in one.label)


def influence(result, of, parameter, label=""):
    return next(one for one in output(result, of, label).influences if one.parameter == parameter)


def test_the_kind_of_motion_has_its_share_and_what_decides_it(tmp_path):
    result = sensitivity(write_study(tmp_path, DOUBLED), method="sobol", groups=64)
    shares = {one.motion: one for one in result.shares}
    assert shares["period-1"].measured
    assert not shares["period-2"].measured
    assert shares["period-1"].share.low < 0.5 < shares["period-1"].share.high
    assert sum(one.points for one in result.shares) == result.points == result.simulations == 256
    gain, harmonic = (influence(result, KIND, name) for name in ("gain", "harmonic"))
    assert gain.first.low < 1.0 < gain.first.high
    assert harmonic.total.value == pytest.approx(0.0)
    assert result.measured_kind == {"bench": "period-1"}
    inside = output(result, FEATURE, "displacement amplitude")
    assert inside.estimator == "given data"
    assert inside.points == shares["period-1"].points


def test_failed_runs_are_a_share_of_the_box_and_not_a_number(tmp_path):
    result = sensitivity(write_study(tmp_path, DOUBLED, FAILING), method="sobol", groups=64)
    failed = next(one for one in result.shares if one.failed)
    assert failed.motion == "diverged"
    assert failed.share.low < 0.25 < failed.share.high
    assert result.failures[0].reason == "too much of the second harmonic"
    assert output(result, STATUS).ranked()[0].parameter == "harmonic"
    assert influence(result, STATUS, "gain").total.value == pytest.approx(0.0)
    right = next(one for one in result.shares if one.measured)
    assert all(one.points <= right.points for one in result.outputs if one.of == FEATURE)


def test_a_log_window_is_sampled_in_the_logarithm(tmp_path):
    result = sensitivity(write_study(tmp_path))
    effect = influence(result, FEATURE, "gain", "velocity amplitude")
    assert result.windows["gain"].scale == "log"
    ledger = (tmp_path / "out" / "trials.jsonl").read_text().splitlines()
    gains = {json.loads(line)["values"]["gain"] for line in ledger if "values" in line}
    assert sorted(gains) == pytest.approx([0.5, 0.5 * 4.0 ** (1 / 3), 0.5 * 4.0 ** (2 / 3), 2.0])
    assert effect.mu.value > 0.0
    assert effect.mu.value == pytest.approx(effect.mu_star.value)


def test_an_interrupted_sensitivity_goes_on_to_the_same_numbers(tmp_path):
    path = write_study(tmp_path, DOUBLED)
    expected = sensitivity(path, "whole", groups=5)

    def stop(done, total):
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sensitivity(path, groups=5, on_point=stop)
    ledger = tmp_path / "out" / "trials.jsonl"
    ledger.write_bytes(ledger.read_bytes()[:-20])  # killed while it wrote the last line
    opened, counts = [], []
    result = sensitivity(path, groups=5, on_opened=opened.append, on_point=lambda *count: counts.append(count))
    assert opened == [6]
    assert counts == [(n, 15) for n in range(7, 16)]
    assert result == expected


@pytest.mark.slow
def test_a_killed_sensitivity_goes_on_to_the_same_numbers(tmp_path):
    path = write_study(tmp_path, DOUBLED)
    ledger = tmp_path / "out" / "sensitivity" / "morris" / "trials.jsonl"
    command = [sys.executable, "-m", "calib", "sensitivity", str(path), "--trajectories", "60", "-q"]
    process = subprocess.Popen(command, env=environment(), start_new_session=True)
    limit = time.monotonic() + 120.0
    while not ledger.exists() or ledger.read_bytes().count(b"\n") < 10:
        assert process.poll() is None, "it ended before it was killed"
        assert time.monotonic() < limit, "not within two minutes"
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert ledger.read_bytes().count(b"\n") < 181
    subprocess.run(command, env=environment(), check=True)
    assert read(tmp_path / "out") == sensitivity(path, "whole", groups=60)


def test_more_trajectories_go_on_from_fewer(tmp_path):
    path, opened = write_study(tmp_path), []
    sensitivity(path, groups=4)
    more = sensitivity(path, groups=6, on_opened=opened.append)
    assert opened == [12]
    assert more == sensitivity(path, "afresh", groups=6)


def test_another_study_in_the_folder_is_refused(tmp_path):
    path = write_study(tmp_path)
    sensitivity(path, groups=4)
    path.write_text(path.read_text().replace("high = 2.0", "high = 3.0"))
    with pytest.raises(CalibError, match=r"windows.gain.high: 2.0 -> 3.0"):
        sensitivity(path, groups=4)
    assert sensitivity(path, groups=4, fresh=True).windows["gain"].high == 3.0


def test_another_optimiser_is_no_other_sensitivity(tmp_path):
    path, opened = write_study(tmp_path), []
    sensitivity(path, groups=4)
    path.write_text(path.read_text().replace('"multistart"', '"cma"'))
    sensitivity(path, groups=4, on_opened=opened.append)
    assert opened == [12]


def test_the_command_says_what_moves_the_motion(tmp_path):
    path = write_study(tmp_path, DOUBLED, FAILING)
    ended = calib_command("sensitivity", path, "--trajectories", 12)
    assert "12 trajectories over 2 parameters: 36 points, 0 done before; 36 simulations to come" in ended.stderr
    assert "period-1, as measured: " in ended.stdout
    assert "failed: diverged: " in ended.stdout
    assert "the simulation ends well" in " ".join(ended.stdout.split())
    assert (tmp_path / "out" / "sensitivity.png").read_bytes().startswith(b"\x89PNG")
    again = json.loads(calib_command("sensitivity", path, "--trajectories", 12, "--json").stdout)
    assert SensitivityResult.from_dict(again) == read(tmp_path / "out")
    assert (
        "36 points, 36 done before; 0 simulations to come"
        in calib_command("sensitivity", path, "--trajectories", 12).stderr
    )


def test_nothing_simulated_is_exit_code_4(tmp_path):
    never = ("[windows]", "[model.options]\nfails_above = -1.0\n\n[windows]")
    ended = calib_command("sensitivity", write_study(tmp_path, DOUBLED, never), "--trajectories", 4, code=4)
    assert "failed: diverged: 100 %" in ended.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--samples", 64), "takes a number of trajectories, not of samples"),
        (("--method", "sobol", "--trajectories", 8), "takes a number of samples, not of trajectories"),
        (("--method", "sobol", "--samples", 100), "the nearest are 64 and 128"),
        (("--trajectories", 1), "at least 4 trajectories, got 1"),
    ],
)
def test_wrong_numbers_are_refused(tmp_path, options, said):
    assert said in calib_command("sensitivity", write_study(tmp_path), *options, code=1).stderr


def test_what_is_no_result_is_refused(tmp_path):
    assert read(tmp_path) is None
    (tmp_path / "sensitivity.json").write_text("{}")
    with pytest.raises(CalibError, match="holds no result of a sensitivity"):
        read(tmp_path)


def test_from_python_it_shows_itself():
    record = calib.Record(bench(), "bench", nuisance=["trigger"])
    study = calib.Study(Echo, [record], {"gain": (0.5, 2.0, "log"), "harmonic": ("-1 mm", "1 mm")}, jobs=1, name="echo")
    found = study.sensitivity(trajectories=4, quiet=True)
    assert "sensitivity of 'echo' (morris, 12 points)" in repr(found)
    assert "period-1, as measured: 100 %" in repr(found)
    assert found.plot()._repr_png_().startswith(b"\x89PNG")
    assert "data:image/png;base64," in found._repr_html_()
    assert repr(study.sensitivity(trajectories=4, seed=7, quiet=True)) != repr(found)


SECOND = """[[record]]
name = "louder"
path = "louder.nc"
nuisance = ["trigger"]

[model]
"""


def test_each_record_has_features_of_its_own(tmp_path):
    """The gain, 0.5 to 2, acts on the motion of each base; beside the larger one the harmonic matters less."""
    path = write_study(tmp_path, ("[model]\n", SECOND))
    records.write(bench(amplitude=2e-3, seed=7), tmp_path / "louder.nc")
    result = sensitivity(path)
    assert result.measured_kind == {"bench": "period-1", "louder": "period-1"}
    assert result.simulations == 2 * result.points
    moved = {}
    for own in result.outputs:
        if own.of == FEATURE and own.label == "displacement amplitude":
            assert own.points == result.points
            moved[own.record] = {one.parameter: one.mu_star.value for one in own.influences}
    assert set(moved) == {"bench", "louder"}
    assert moved["louder"]["gain"] == pytest.approx(1.5 * 2e-3, rel=0.15)  # m, of a base that moves by 2 mm
    assert moved["bench"]["gain"] < 0.6 * moved["louder"]["gain"]
    assert moved["louder"]["harmonic"] < moved["bench"]["harmonic"]
