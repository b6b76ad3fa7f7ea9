"""What a calibration says of records whose points are in error, and that it is not led astray by them."""

import json

import pytest
from click.testing import CliRunner
from hidden.stepped import drawn, written
from hidden.stepped_laboratory import SteppedLaboratory

from calib.cli import main as calib

SHORT_WAIT = SteppedLaboratory("short wait", (1.0,), 30.0)  # periods: one point lies between the branches
SEED = 16
SPRING = "k3 = { low = 0.0, high = 4e5 }\n\n[[term]]"


@pytest.mark.slow
def test_a_point_that_was_read_in_a_jump_is_named_and_leads_no_fit_astray(tmp_path):
    truth = drawn("cubic_stiffness", SEED)
    written(truth, SEED, tmp_path, SHORT_WAIT)
    study = tmp_path / "study.toml"
    text = study.read_text().replace("[model.fixed]", 'effects = ["cubic_stiffness"]\n[model.fixed]')
    study.write_text(text.replace("[[term]]", SPRING))
    answer = CliRunner().invoke(calib, ["run", str(tmp_path), "--jobs", "1"], catch_exceptions=False)
    assert answer.exit_code == 0, answer.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    for name, true in (("stiffness", truth.values[1]), ("damping", truth.values[2]), ("k3", truth.size)):
        low, high = result["intervals"][name]
        assert abs(result["values"][name] - true) < 0.75 * (high - low), name  # 3 standard errors
        assert high - low < 0.2 * true
    said = " ".join(answer.output.split())
    assert "record 'levels': 1 of 72 points, number 67 at 3.717 Hz" in said
    assert "it was read before the motion had settled after a jump, or in error" in said
    page = (tmp_path / "out" / "report.html").read_text()
    assert "1 of 72 points, number 67 at 3.717 Hz" in page
    [fit] = result["score"]["terms"].values()
    assert fit < 0.03  # of noise of half a per cent, where that point alone would make it 0.1


@pytest.mark.slow
def test_a_diagnosis_names_the_point_and_the_cause(tmp_path):
    truth = drawn("cubic_stiffness", SEED)
    written(truth, SEED, tmp_path, SHORT_WAIT)
    study = tmp_path / "study.toml"
    candidates = ["cubic_stiffness", "softening", "quadratic_drag", "coulomb_friction"]
    study.write_text(f"{study.read_text()}\n[diagnosis]\ncandidates = {json.dumps(candidates)}\n")
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(tmp_path), "--quiet", "--jobs", "1"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert said["causes"] == ["cubic_stiffness"]
    [gross] = said["gross_errors"]
    assert (gross["record"], gross["points"], gross["numbers"]) == ("levels", 72, [67])
    [spring] = [one for one in said["suspects"] if one["effect"] == "cubic_stiffness"]
    low, high = spring["interval"]["k3"]
    assert abs(spring["size"]["k3"] - truth.size) < 0.75 * (high - low)
    assert "1 of 72 points" in (tmp_path / "out" / "report.html").read_text()
