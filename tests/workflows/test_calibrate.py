"""The main job from Python."""

import json
import re
from pathlib import Path

import pytest
from echo_study import FREQUENCY, TRUTH, bench, write_study
from tiny_simulators import Echo
from undrawn import undrawn

from calib import records
from calib.errors import CalibError
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.store.record_files import best_records
from calib.workflows.calibrate import calibrate, rebuild

MINIMAL = Path(__file__).parents[2] / "studies" / "minimal" / "study.toml"


def test_the_main_job_from_python_leaves_the_files_and_returns_what_they_say(tmp_path, capfd):
    path = write_study(tmp_path)
    found = calibrate(str(path), quiet=True)
    assert found.as_dict() == json.loads((tmp_path / "out" / "result.json").read_text())
    assert found.confirmation is None
    assert "Leading trials, confirmed" not in (tmp_path / "out" / "report.html").read_text()
    assert {"report.html", "best.nc", "trials.jsonl"} <= {file.name for file in (tmp_path / "out").iterdir()}
    assert capfd.readouterr() == ("", "")


@undrawn()
def test_progress_is_on_stderr_and_no_stage_is_named_that_has_nothing_to_do(tmp_path, capfd):
    calibrate(write_study(tmp_path), tmp_path / "elsewhere", budget=12)
    said = capfd.readouterr().err
    assert "confidence: " in said
    assert "hold-out: " not in said, "no record is held out"
    assert (tmp_path / "elsewhere" / "result.json").exists()


def test_a_stated_frequency_that_the_samples_do_not_show_is_said_once_before_the_search(tmp_path, capfd):
    path = write_study(tmp_path)
    driven = Excitation("base", "base motion", frequency=1.1 * FREQUENCY, amplitude=1e-3)
    record = Echo().run(TRUTH, driven, (), Request(periods=20, samples=100))
    record = record.drop_vars(["section_displacement", "section_velocity"])
    record = record.assign_attrs(place="base", quantity="base motion", amplitude=1e-3)
    excitation = '[record.excitation]\nplace = "base"\nquantity = "base motion"\namplitude = "1 mm"\n'
    excitation += 'frequency = "{:.6g} Hz"\n\n[model]'
    right, wrong = 1.1 * FREQUENCY, FREQUENCY
    for stated, corrected, doubts in ((wrong, None, 1), (right, None, 0), (wrong, right, 0), (right, wrong, 1)):
        if corrected is not None:
            path = write_study(tmp_path, ("[model]", excitation.format(corrected)))
        records.write(record.assign_attrs(frequency=stated), tmp_path / "bench.nc")
        calibrate(path, tmp_path / f"{stated:g} {corrected}", budget=9)
        lines = [line for line in capfd.readouterr().err.splitlines() if "repeats itself" in line]
        assert len(lines) == doubts
        for line in lines:
            said = re.match(r"mind: record 'bench' repeats itself at ([\d.]+) Hz, not at the 10 Hz of", line)
            assert float(said[1]) == pytest.approx(1.1 * FREQUENCY, abs=0.02)


def test_records_may_have_names_that_no_address_could_have(tmp_path):
    second = '[[record]]\nname = "my bench, 2 #1?"\npath = "bench.nc"\nnuisance = ["trigger"]\n'
    path = write_study(tmp_path, ('name = "bench"', 'name = "my bench"'), ("[model]", f"{second}\n[model]"))
    calibrate(path, quiet=True)
    assert set(best_records(tmp_path / "out")) == {"my bench", "my bench, 2 #1?"}
    page = rebuild(path).read_text()
    assert "my bench, 2 #1?" in page
    assert "mathdefault" not in page


@undrawn()
def test_the_page_of_a_ledger_that_holds_half_a_surrogate_pair_is_written(tmp_path, monkeypatch):
    with monkeypatch.context() as patched:  # undone before what draws nothing is
        patched.setattr("calib.report.pages.page.render", lambda *shown: "no \ud83d")
        calibrate(write_study(tmp_path), quiet=True)
    assert (tmp_path / "out" / "report.html").read_text(encoding="utf-8") == r"no \ud83d"


def test_the_report_of_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(CalibError, match="no study was run here"):
        rebuild(write_study(tmp_path))


@pytest.mark.parametrize(("late", "mute"), [(0, True), (7, False)])
def test_a_record_that_would_fit_from_another_instant_on_is_named(tmp_path, late, mute):
    path = write_study(tmp_path, ('nuisance = ["trigger"]\n', ""))
    record = bench().roll(time=late, roll_coords=False)
    records.write(record, tmp_path / "bench.nc")
    remarks = calibrate(path, quiet=True).remarks
    if mute:
        assert remarks == ()
    else:
        assert remarks[0].startswith("were bench to start at another instant")
        report = (tmp_path / "out" / "report.html").read_text()
        assert "Were bench to start at another instant" in report


@pytest.mark.slow  # a study of its own, with impacts
def test_a_search_that_its_budget_cut_short_has_no_intervals_and_says_why(tmp_path):
    """Linearised about its end, restitution was 0.249 +- 0.083; its profile reaches from 0.053 to 0.134."""
    text = MINIMAL.read_text().replace("../../", f"{MINIMAL.parents[2]}/").replace("multistart", "surrogate")
    path = tmp_path / "study.toml"
    path.write_text(text)
    calibrate(path, budget=40, quiet=True)
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert (found["intervals"], found["confidence"]["status"]) == ({}, "not available")
    assert found["confidence"]["reason"].startswith("the search did not end at a minimum: ")
    assert not any("in common" in remark for remark in found["remarks"])
    page = " ".join((tmp_path / "out" / "report.html").read_text().split())
    assert "No standard errors: the search did not end at a minimum" in page
