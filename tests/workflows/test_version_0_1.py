"""Study files, ledgers, results, diagnoses and sweeps that version 0.1 wrote are read as it read them."""

import html
import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from printed import cells
from rich.console import Console
from undrawn import undrawn

from calib import records
from calib.cli import main
from calib.cli.diagnose import show
from calib.cli.sweep import described, pictures
from calib.diagnosis import artifacts
from calib.store import Header, read
from calib.store.chunks import read_joined
from calib.study import result
from calib.study_file import load

TESTS = Path(__file__).parents[1]
SAMPLES = TESTS / "samples" / "v0_1"
TRIALS = 12  # in the ledger of the sample
TOTAL = 0.0038072110967707113  # distance of its best trial, number 11
FOUND = {"restitution": 0.07677084783832872, "amplitude": 1.007424043072155}


def calib(*arguments):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == 0, ended.output
    return ended.stdout


def text_of(page):
    """Return what a browser shows of a page, between single spaces."""
    shown = re.sub(r"<(style|script|svg).*?</\1>", "", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", shown)).split())


@pytest.fixture
def sample(tmp_path):
    """Study file of the sample, in a folder of its own with what 0.1 left in `out`."""
    for path in (SAMPLES / "sample").glob("*.*"):
        shutil.copy(path, tmp_path)
    shutil.copytree(SAMPLES / "sample" / "results", tmp_path / "out")
    return tmp_path / "study.toml"


# --- the study file


@pytest.mark.parametrize("name", ["sample", "minimal"])
def test_a_study_file_of_0_1_defines_the_study_that_it_defined(tmp_path, name):
    folder = tmp_path / "studies" / name
    shutil.copytree(SAMPLES / name, folder)
    (tmp_path / "experiments_ref").symlink_to(TESTS.parent / "experiments_ref")
    with open(folder / "results" / "trials.jsonl", encoding="utf-8") as ledger:
        header = json.loads(ledger.readline())
    study = load(folder / "study.toml").study
    assert (header["versions"]["calib"], header["format"]) == ("0.1.0", 1)
    assert study.header.definition == header["definition"]
    assert len(header["definition"]["records"]) == {"sample": 2, "minimal": 3}[name]


# --- the ledger


@pytest.mark.parametrize("name", ["sample", "minimal"])
def test_a_header_is_written_as_0_1_wrote_it(name):
    with open(SAMPLES / name / "results" / "trials.jsonl", encoding="utf-8") as ledger:
        line = ledger.readline()
    header = Header.from_dict(json.loads(line))
    assert json.dumps(header.as_dict(), separators=(",", ":")) + "\n" == line
    assert header.further == {}


def test_the_ledger_is_read_with_its_values_features_and_residuals(sample):
    header, trials = read(sample.parent / "out")
    assert [t.number for t in trials] == list(range(TRIALS))
    assert [t.phase for t in trials] == 8 * ["screen"] + 4 * ["search"]
    kinds = [t.kind for t in trials]
    assert (kinds[2], kinds[6], kinds[7], kinds[8:]) == ("irregular", "period-4", "period-2", 4 * ["period-1"])
    assert {t.status for t in trials} == {"ok"}
    best = min(trials, key=lambda t: t.cost)
    assert (best.number, best.cost, best.values) == (11, TOTAL, FOUND)
    assert header.definition["windows"]["restitution"] == {"low": 0.0, "high": 0.6, "scale": "linear", "unit": "1"}
    assert all(t.residuals.shape == (128,) for t in trials)  # 64 samples a period, displacement and velocity
    assert best.cost == pytest.approx(float(np.linalg.norm(best.residuals)), rel=1e-12)
    [amplitude] = [f for f in best.features if f["label"] == "displacement amplitude"]
    assert (amplitude["record"], amplitude["body"], amplitude["unit"]) == ("clapping", "q3", "m")


@undrawn()
@pytest.mark.filterwarnings("ignore:this study was begun with other libraries")
def test_a_study_goes_on_from_the_ledger(sample):
    ledger = sample.parent / "out" / "trials.jsonl"
    before = ledger.read_bytes()
    said = json.loads(calib("run", sample, "--budget", TRIALS + 2, "--json"))
    assert ledger.read_bytes().startswith(before)
    header, trials = read(ledger.parent)
    assert (len(trials), said["trials"], header.budget) == (TRIALS + 2, TRIALS + 2, TRIALS + 2)
    assert said["score"]["total"] <= TOTAL


# --- the result


def test_status_says_of_the_result_what_0_1_said(sample):
    said = json.loads(calib("status", sample, "--json"))
    assert (said["state"], said["trials"], said["budget"], said["failed"]) == ("finished", TRIALS, TRIALS, {})
    assert said["best"] == {"number": 11, "total": TOTAL, "kind": "period-1", "values": FOUND}
    assert "sample: finished, 12 of 12 trials" in calib("status", sample)


def test_the_result_of_a_longer_study_is_read():
    found = result.read(SAMPLES / "minimal" / "results")
    assert (found.trials, found.failed, found.failures[0].status) == (120, 1, "timeout")
    assert found.values["damping"] == 0.005192209048347901
    assert found.holdout.keys() == {"louder", "slower"}
    assert found.undetermined[0].members == ("restitution", "damping")


def test_the_report_is_written_from_what_0_1_left(sample):
    calib("report", sample)
    page = text_of((sample.parent / "out" / "report.html").read_text())
    assert "0.0768 0.0014 1 0.0753 to 0.07824 0 to 0.6" in page  # restitution
    assert "1.00742 0.00099 1 1.00642 to 1.00843 0.9 to 1.1" in page  # amplitude
    assert "louder 0.591 % (period-1)" in page
    assert "quadratic_drag (-c2 v |v|), c2 = 2.91 ± 0.47 1/m" in page  # the diagnosis is a chapter of it


# --- the diagnosis


def test_the_diagnosis_is_read_and_printed():
    found = artifacts.read(SAMPLES / "sample" / "results")
    assert (found.verdict, found.causes, found.values) == ("named", ("quadratic_drag",), FOUND)
    printed = io.StringIO()
    show(found, SAMPLES, None, Console(file=printed, width=120, color_system=None))
    first, *lines = printed.getvalue().splitlines()
    assert first == f"named: {found.summary}"
    assert [row[:4] for row in cells("\n".join(lines))] == [
        ["quadratic_drag", "11.3", "97 %", "c2 = 2.91 ± 0.47 1/m"],
        ["linear_drag", "9.4", "73 %", "c1 = 1.92 ± 0.34 1/s"],
        ["gap_offset", "-0.3", "0.1 %*", "dg = −0.3 ± 2.4 µm"],
    ]


def test_the_diagnosis_is_written_as_0_1_wrote_it():
    folder = SAMPLES / "sample" / "results"
    assert json.dumps(artifacts.read(folder).as_dict(), indent=2) == (folder / artifacts.NAME).read_text()


def test_the_motions_of_the_diagnosis_are_read():
    [(name, motion)] = artifacts.read_motions(SAMPLES / "sample" / "results").items()
    assert name == "clapping"
    assert dict(motion.sizes) == {"row": 2, "time": 256, "lag": 1}
    measured = records.read(SAMPLES / "sample" / "clapping.nc")
    np.testing.assert_array_equal(motion.measured[0], measured.displacement.sel(body="q3"))
    left = {rows: float(np.square(motion.measured - motion[rows]).sum()) for rows in ("calibrated", "extended")}
    assert left["extended"] < left["calibrated"]


# --- the sweep


def test_the_sweep_is_read_told_and_drawn():
    sweep = read_joined(SAMPLES / "sample" / "results" / "sweep.nc")
    assert list(described(sweep)) == ["found:", "  restitution 0.05 .. 0.15: period-1, 1 impact(s) a return"]
    assert [name for name, _ in pictures(sweep, ["q3"])] == ["", "_impacts"]


SWEPT = ("--over", "restitution=0.05,0.15", "--settle", 20, "--cycles", 96)


@pytest.mark.filterwarnings("ignore:.*was made with other library versions")
def test_the_same_sweep_is_not_run_again(sample):
    path = sample.parent / "out" / "sweep.nc"
    before = path.read_bytes()
    assert "restitution 0.05 .. 0.15: period-1" in calib("sweep", sample, *SWEPT, "-o", path)
    assert path.read_bytes() == before


def test_a_sweep_by_another_drive_is_refused(sample):
    path = sample.parent / "out" / "sweep.nc"
    sample.write_text(sample.read_text().replace('drive = "spring"', 'drive = "rigid"'))
    refused = CliRunner().invoke(main, ["sweep", str(sample), *map(str, SWEPT), "-o", str(path)])
    assert refused.exit_code == 1
    assert "it differs in options.drive" in refused.output
