"""`calib window` on a small study whose window is known, files and all."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from child_environment import environment
from click.testing import CliRunner
from echo_study import write_study
from matplotlib.backends.backend_agg import FigureCanvasAgg
from undrawn import undrawn

from calib.cli import main
from calib.confidence.window.document import WINDOW_END, WindowResult, read_window
from calib.execution.netcdf import read_dataset
from calib.records import write
from calib.records.response import make_response
from calib.report.plots.window import window_figure
from calib.study.evaluation import evaluate
from calib.study_file import load
from calib.workflows.study import Calibration
from calib.workflows.windowed import AdmissibleWindow

BUDGET, TOLERANCE = 40, 0.2


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
def windowed(calibrated, tmp_path_factory):
    """The same after `calib window`, and what that printed."""
    folder = tmp_path_factory.mktemp("windowed") / "echo"
    shutil.copytree(calibrated, folder)
    return folder, calib("window", folder, "--budget", BUDGET, "--tolerance", TOLERANCE).output


@pytest.mark.slow
def test_the_share_of_the_box_is_that_of_a_dense_grid(windowed):
    folder, _ = windowed
    study = load(folder).study
    grid = (np.arange(24) + 0.5) / 24
    inside = np.array(
        [
            [
                max(evaluate(study, study.space.values(np.array([x, y]))).score.terms.values()) <= TOLERANCE
                for x in 0.45 + 0.4 * grid
            ]
            for y in 0.4 + 0.4 * grid
        ]
    )
    assert not np.concatenate([inside[0], inside[-1], inside[:, 0], inside[:, -1]]).any()  # the whole window is seen
    result = read_window(folder / "out")
    assert result.share == pytest.approx(0.16 * np.mean(inside), rel=0.1)
    assert result.share_low < result.share < result.share_high
    assert result.misclassified < 0.1 * result.share


def test_each_parameter_has_its_tolerance_and_the_file_round_trips(windowed):
    folder, printed = windowed
    result = read_window(folder / "out")
    assert WindowResult.from_dict(json.loads(json.dumps(result.as_dict()))) == result
    for own in result.parameters:
        assert own.alone_low <= own.together_low <= own.value <= own.together_high <= own.alone_high
        assert own.alone_low_cause == own.alone_high_cause == "misfit of phase_curve"
    assert result.parameters[1].unit == "m"
    assert "of the box is admissible" in printed
    assert WINDOW_END not in result.mechanisms
    dataset = read_dataset(folder / "out" / "window.nc")
    assert dataset.sizes["point"] == BUDGET
    assert dataset.slice_probability.shape == (1, 41, 41)
    assert (folder / "out" / "window.png").stat().st_size > 10_000
    assert "How far the parameters may vary" in (folder / "out" / "report.html").read_text()


@pytest.mark.parametrize("causes", [1, 4])
def test_names_title_and_legend_lie_within_the_picture_and_apart(windowed, causes):
    folder, _ = windowed
    dataset = read_dataset(folder / "out" / "window.nc")
    labels = [f"misfit of phase_curve of q{k}, q{k + 1}" for k in range(causes)]
    dataset = dataset.assign(slice_mechanism_label=("cause", labels))
    figure = window_figure(read_window(folder / "out"), dataset)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    panels = [axes.get_tightbbox(canvas.get_renderer()) for axes in figure.axes]
    [legend], title = figure.legends, figure._suptitle
    boxes = [*panels, legend.get_window_extent(), title.get_window_extent(canvas.get_renderer())]
    assert all(box.x0 >= 0.0 and box.x1 <= figure.bbox.width for box in boxes)
    assert all(box.y0 >= 0.0 and box.y1 <= figure.bbox.height for box in boxes)
    assert max(box.y1 for box in panels) <= boxes[-2].y0 <= boxes[-2].y1 <= boxes[-1].y0


@pytest.mark.slow
@undrawn()
def test_a_larger_budget_goes_on_from_a_smaller_one(windowed, tmp_path):
    folder, _ = windowed
    other = tmp_path / "echo"
    shutil.copytree(folder, other)
    shutil.rmtree(other / "out" / "window")
    calib("window", other, "--budget", 24, "--tolerance", TOLERANCE, "-q")
    calib("window", other, "--budget", BUDGET, "--tolerance", TOLERANCE, "-q")
    np.testing.assert_array_equal(
        read_dataset(other / "out" / "window.nc").u, read_dataset(folder / "out" / "window.nc").u
    )


@pytest.mark.slow
@undrawn()
def test_a_killed_window_ends_in_the_same_points(windowed, tmp_path):
    folder, _ = windowed
    other = tmp_path / "echo"
    shutil.copytree(folder, other)
    shutil.rmtree(other / "out" / "window")
    command = [sys.executable, "-m", "calib", "window", str(other), "--budget", str(BUDGET), "-t", str(TOLERANCE), "-q"]
    with subprocess.Popen(command, env=environment(), start_new_session=True) as process:
        ledger = other / "out" / "window" / "trials.jsonl"
        while not (ledger.is_file() and ledger.read_bytes().count(b"\n") > 20) and process.poll() is None:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGKILL)
    calib("window", other, "--budget", BUDGET, "--tolerance", TOLERANCE, "-q")
    np.testing.assert_array_equal(
        read_dataset(other / "out" / "window.nc").u, read_dataset(folder / "out" / "window.nc").u
    )


@pytest.mark.slow
def test_curves_that_cannot_be_followed_are_said_and_leave_the_window_as_it_is(windowed, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(windowed[0], folder)
    printed = calib("window", folder, "--budget", BUDGET, "--tolerance", TOLERANCE, "--exact").output
    before, result = read_window(windowed[0] / "out"), read_window(folder / "out")
    assert result.share == before.share
    assert before.exact == ()
    assert [(own.first, own.second, own.kinds) for own in result.exact] == [("gain", "harmonic", ())]
    assert "over gain and harmonic: no curve" in printed
    assert "period map" in result.exact[0].reason


@pytest.mark.slow
def test_python_has_it_too(windowed):
    folder, _ = windowed
    found = Calibration(folder / "study.toml").window(budget=BUDGET, tolerance={"": TOLERANCE}, quiet=True)
    assert isinstance(found, AdmissibleWindow)
    assert found.summary.share == read_window(folder / "out").share
    assert "of the box is admissible" in repr(found)
    assert "data:image/png" in found._repr_html_()


@pytest.mark.slow
@undrawn()
def test_failed_runs_are_data(calibrated, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(calibrated, folder)
    study = folder / "study.toml"
    study.write_text(
        study.read_text().replace("[windows]", '[model.options]\nfault = "raises"\nabove = 1.3\n\n[windows]')
    )
    shutil.rmtree(folder / "out")
    calib("run", folder, "-q")
    calib("window", folder, "--budget", BUDGET, "--tolerance", TOLERANCE, "-q")
    result = read_window(folder / "out")
    assert result.failures
    assert "another kind of motion" in result.mechanisms
    assert result.parameters[0].alone_high == pytest.approx(1.3, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--tolerance", "phase_curv=0.1"), "did you mean 'phase_curve'"),
        (("--tolerance", "small"), "expected a distance"),
        (("--tolerance", "-1"), "above 0"),
        (("--budget", "10"), "expected at least 17 points"),
    ],
)
def test_mistakes_are_told(calibrated, arguments, told):
    assert told in calib("window", calibrated, *arguments, code=1).stderr


def test_an_uncalibrated_study_is_told_so(tmp_path):
    assert "calibrate first" in calib("window", write_study(tmp_path), code=1).stderr


@pytest.mark.slow
def test_of_frequency_responses_the_window_is_that_of_the_distance(tmp_path):
    """A linear oscillator: its stiffness may vary as much as shifts the resonance out of the tolerance."""
    frequency, omega = np.linspace(2.8, 3.6, 21), 2.0 * np.pi * np.linspace(2.8, 3.6, 21)
    record = make_response(
        frequency, ["mass"], 0.2 / (400.0 - omega**2 + 1j * omega)[None], 0.2, "N", place="mass", quantity="force"
    )
    write(record, tmp_path / "response.nc")
    (tmp_path / "study.toml").write_text(
        '[study]\nname = "swept"\nseed = 1\nbudget = 30\n'
        '[[record]]\nname = "response"\npath = "response.nc"\n'
        '[model]\nsimulator = "oscillator"\nfixed = { mass = "1 kg" }\n'
        '[windows]\nstiffness = { low = "380 N/m", high = "420 N/m" }\ndamping = { low = 0.7, high = 1.4 }\n'
        '[[term]]\nfeature = "frequency_response"\n[optimiser]\nname = "multistart"\n'
    )
    calib("run", tmp_path, "-q")
    said = calib("window", tmp_path, "--budget", BUDGET, "--tolerance", 0.03, "--exact").output
    assert "admissible: a distance of frequency_response up to 0.03\n" in said
    assert "over stiffness and damping: no curve (record 'response' is a frequency response" in said
    window = read_window(tmp_path / "out")
    assert window.mechanisms == {"misfit of frequency_response": pytest.approx(1.0, abs=0.05)}
    study = load(tmp_path).study
    for own in window.parameters:
        for end in (own.alone_low, own.alone_high):
            score = evaluate(study, {**window.calibrated, own.name: end}).score
            assert score.cost == pytest.approx(0.03, rel=0.15)
