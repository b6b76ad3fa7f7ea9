"""The paper's own story: no point of the box fits, the gap's shape is named, the extension predicts."""

from pathlib import Path

import pytest
import tomlkit

from calib.workflows.calibrate import calibrate
from calib.workflows.diagnose import diagnose_study

STUDY = Path(__file__).parents[2] / "studies" / "paper_story" / "study.toml"
BUDGET, EXTENDED_BUDGET = 60, 30  # simulations; the extended search begins at what the diagnosis fitted
SUSPECTS = ["interface_shift", "gap_offset", "drive_harmonic_2"]
TERM = "phase_curve of layer"
pytestmark = pytest.mark.usefixtures("without_pictures")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What calibration, diagnosis and the extended calibration say; shortened: reduced fidelity, fewer suspects."""
    folder = tmp_path_factory.mktemp("story")
    document = tomlkit.parse(STUDY.read_text())
    document["study"]["budget"] = BUDGET
    document["model"]["options"]["fidelity"] = "reduced"
    document["diagnosis"] = {"candidates": SUSPECTS}
    for record in document["record"]:
        record["path"] = str((STUDY.parent / record["path"]).resolve())
    path = folder / "study.toml"
    path.write_text(tomlkit.dumps(document))
    first = calibrate(path, quiet=True)
    found, extended = diagnose_study(path, apply=True)
    return first, found, calibrate(extended, budget=EXTENDED_BUDGET, quiet=True)


@pytest.mark.slow
def test_no_point_of_the_box_reaches_the_record(told):
    first, _, _ = told
    assert first.motion.kind == "period-1"
    assert first.score.terms[TERM] > 0.4
    missed = {missed.feature for missed in first.unreachable}
    assert missed >= {"displacement amplitude", "velocity amplitude", "velocity change at impact"}


@pytest.mark.slow
def test_the_shape_of_the_gap_is_named(told):
    _, found, _ = told
    assert found.verdict == "named"
    assert found.causes == ("interface_shift",)
    [shift] = [s for s in found.suspects if s.effect == "interface_shift"]
    assert 0.7e-3 < shift.size["interface_shift"] < 0.95e-3  # m; the record has 0.8
    assert shift.share > 0.95
    assert all(s.share is None or s.share < 0.75 for s in found.suspects if s is not shift)


@pytest.mark.slow
def test_the_extended_model_fits_and_predicts_the_records_held_out(told):
    first, found, second = told
    assert second.score.terms[TERM] < 0.05
    assert found.gain.kind == "records held out"
    assert found.gain.proven
    for name, limit in (("louder", 0.1), ("slower", 0.05)):
        assert second.holdout[name].terms[TERM] < limit < 0.5 < first.holdout[name].terms[TERM]
