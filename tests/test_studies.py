"""The studies that come with calib find what their READMEs say."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from calib.cli import main
from calib.record import read

STUDIES = Path(__file__).parents[1] / "studies"


def ran(name, out):
    answer = CliRunner().invoke(main, ["run", str(STUDIES / name), "--out", str(out), "--quiet"])
    assert answer.exit_code == 0, answer.output
    return json.loads((out / "result.json").read_text())


@pytest.mark.slow
def test_the_minimal_model_predicts_the_records_held_out(tmp_path):
    result = ran("minimal", tmp_path)
    calibrated = result["score"]["terms"]["phase_curve of q2, q3"]
    assert calibrated < 0.02
    assert result["motion"]["kind"] == "period-1"
    assert result["unreachable"] == []
    for name in ("louder", "slower"):
        assert result["holdout"][name]["kind"] == "period-1"
        assert result["holdout"][name]["distance"] <= 1.5 * calibrated


@pytest.mark.slow
def test_the_layer_jumps_where_the_record_changes_fast_but_continuously(tmp_path):
    ran("minimal", tmp_path)
    steepest = {}
    for name, record in (("recorded", STUDIES.parent / "experiments_ref/clapping_minimal/clapping.nc"),
                         ("simulated", tmp_path / "best.nc")):  # fmt: skip
        velocity = read(record).velocity.values[-1 if name == "recorded" else 2]
        rise = np.abs(np.diff(velocity))
        steepest[name] = rise.max() / (velocity.max() - velocity.min())
    assert steepest["simulated"] > 0.2 > steepest["recorded"]


@pytest.mark.slow
def test_no_point_of_the_window_reaches_the_beam_s_layer(tmp_path):
    result = ran("minimal_beam", tmp_path)
    off = {entry["feature"]: entry["off"] / entry["measured"] for entry in result["unreachable"]}
    assert off["displacement amplitude"] > 1.0
    assert off["velocity amplitude"] > 0.8
    assert set(result["at_edge"]) >= {"damping", "layer_stiffness"}
