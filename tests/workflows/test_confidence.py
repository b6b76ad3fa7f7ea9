"""`calib confidence` on a small study, files and all."""

import json
import shutil
import signal
import subprocess
import sys
import time

import pytest
from child_environment import environment
from click.testing import CliRunner
from echo_study import TRUTH, write_study
from undrawn import undrawn

from calib.cli import main
from calib.confidence.document import ConfidenceResult
from calib.errors import CalibError
from calib.workflows.confidence import confidence_study, read_confidence
from calib.workflows.profiled import Profiled
from calib.workflows.study import Calibration


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    return ended


@pytest.fixture(scope="module")
@undrawn()
def calibrated(tmp_path_factory):
    """Folder of a calibrated study."""
    path = write_study(tmp_path_factory.mktemp("echo"))
    calib("run", path, "-q")
    return path.parent


@pytest.fixture(scope="module")
def profiled(calibrated, tmp_path_factory):
    """The same after `calib confidence`, and what that printed."""
    folder = tmp_path_factory.mktemp("profiled") / "echo"
    shutil.copytree(calibrated, folder)
    return folder, calib("confidence", folder, "--pairs", "gain,harmonic").output


def numbers(result):
    """What does not depend on when a result was made."""
    return {**result.as_dict(), "seconds": 0.0}


def test_intervals_hold_the_truth_and_agree_with_the_local_ones(profiled):
    folder, output = profiled
    result = read_confidence(folder / "out")
    for profile in result.profiles:
        assert profile.low.value < TRUTH[profile.name] < profile.high.value
        width = profile.high.value - profile.low.value
        assert (profile.low.value, profile.high.value) == pytest.approx(profile.local, abs=0.01 * width)
    assert "95.4% intervals of echo" in output
    assert "gain: as the local interval" in output
    assert "0.198" in output  # mm
    assert "confidence.json, confidence.png" in output


def test_files_are_left(profiled):
    folder, _ = profiled
    assert (folder / "out" / "confidence.png").read_bytes().startswith(b"\x89PNG")
    document = json.loads((folder / "out" / "confidence.json").read_text())
    result = ConfidenceResult.from_dict(document)
    assert result.as_dict() == document
    [pair] = result.pairs
    assert pair.names == ("gain", "harmonic")
    assert (len(pair.first), len(pair.second), len(pair.ratio), len(pair.ratio[0])) == (9, 9, 9, 9)
    assert pair.ratio[4][4] == 0.0


def test_python_says_what_the_command_says(profiled):
    folder, _ = profiled
    found = Calibration(folder / "study.toml").confidence(pairs="all", quiet=True)
    assert isinstance(found, Profiled)
    assert numbers(found.summary) == numbers(read_confidence(folder / "out"))
    assert found.intervals["gain"][0] < TRUTH["gain"] < found.intervals["gain"][1]
    assert repr(found).startswith("95.4% intervals of 'echo'")
    assert "data:image/png;base64," in found._repr_html_()


def test_json_is_the_document(profiled):
    folder, _ = profiled
    answer = calib("confidence", folder, "--pairs", "all", "--json")
    assert numbers(ConfidenceResult.from_dict(json.loads(answer.stdout))) == numbers(read_confidence(folder / "out"))


@pytest.mark.slow
def test_a_killed_run_ends_in_the_same_numbers(calibrated, profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(calibrated, folder)
    notes = folder / "out" / "confidence.jsonl"
    arguments = ["confidence", str(folder), "--pairs", "gain,harmonic", "-q"]
    for lines in (3, 30):
        process = subprocess.Popen(
            [sys.executable, "-c", "from calib.cli import main; main()", *arguments],
            env=environment(), stderr=subprocess.DEVNULL,
        )  # fmt: skip
        while not notes.exists() or notes.read_bytes().count(b"\n") < lines:
            assert process.poll() is None, "the run ended before it was killed"
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        process.wait()
    kept = notes.read_bytes().count(b"\n")
    calib(*arguments)
    assert kept >= 30
    assert numbers(read_confidence(folder / "out")) == numbers(read_confidence(profiled[0] / "out"))


def test_fresh_forgets_the_points(profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(profiled[0], folder)
    notes = folder / "out" / "confidence.jsonl"
    before = notes.read_bytes()
    told = []
    confidence_study(folder, fresh=True, on_progress=lambda done, foreseen: told.append((done, foreseen)))
    assert told[0][0] == 0
    assert told[-1][0] == told[-1][1]
    assert len(notes.read_bytes()) < len(before)  # no pair


def test_points_belong_to_the_calibrated_values(profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(profiled[0], folder)
    path = folder / "out" / "result.json"
    document = json.loads(path.read_text())
    document["values"]["gain"] *= 1.0001
    path.write_text(json.dumps(document))
    told = []
    confidence_study(folder, on_progress=lambda done, foreseen: told.append(done))
    assert told[0] == 0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("gain", "--pairs: expected two parameters, such as A,B, or all, got 'gain'"),
        ("gain,harmonics", "no parameter 'harmonics' is searched (did you mean 'harmonic'?)"),
        ("gain,gain", "expected two different parameters, got 'gain' twice"),
    ],
)
def test_wrong_pairs_are_refused(calibrated, given, message):
    assert message in calib("confidence", calibrated, "--pairs", given, code=1).output


def test_a_study_that_was_not_calibrated_is_refused(tmp_path):
    write_study(tmp_path)
    assert "calibrate first, with `calib run" in calib("confidence", tmp_path, code=1).output


def test_a_damaged_file_of_profiles_is_named(tmp_path):
    assert read_confidence(tmp_path) is None
    (tmp_path / "confidence.json").write_text('{"name": "echo"}')
    with pytest.raises(CalibError, match="holds no profiles .*ConfidenceResult has no level"):
        read_confidence(tmp_path)
