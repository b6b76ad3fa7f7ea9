"""A mass on a cubic spring, let go: stiffness, damping and cubic term by frequency and damping over amplitude alone."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from decays import integrated, noisy

from calib.execution.pool import InProcess
from calib.store import Store
from calib.study import evaluate
from calib.study_file import load
from calib.workflows.calibrate import calibrate

STIFFNESS, DAMPING, CUBIC = 90.0, 0.2, 900.0  # N/m, N s/m, 1/(m^2 s^2), of 1 kg
START = 0.15  # m
STUDY = """
[study]
name = "hardening"
seed = 1
budget = 40

[[record]]
name = "decay"
path = "decay.csv"
use = "calibrate"
{nuisance}

[record.table]
time = {{ column = "time", unit = "s" }}
channels = [{{ column = "position", body = "mass", channel = "displacement", unit = "m" }}]

[record.excitation]
place = "mass"
quantity = "free decay"

[model]
simulator = "oscillator"
effects = ["cubic_stiffness"]

[model.fixed]
mass = "1 kg"
{fixed}

[windows]
stiffness = {{ low = "60 N/m", high = "130 N/m" }}
damping = {{ low = 0.02, high = 1.0, scale = "log" }}
k3 = {{ low = -500.0, high = 3000.0 }}

[[term]]
feature = "backbone"
weight = 100.0

[[term]]
feature = "decay"

[optimiser]
name = "multistart"
"""


def written(folder: Path, nuisance: str, fixed: str) -> Path:
    """Write the record, with 2 % noise, and its study."""
    time = np.arange(0.0, 30.0, 0.02)
    exact = integrated(time, lambda x, v: -STIFFNESS * x - CUBIC * x**3 - DAMPING * v, START)
    table = np.column_stack([time, noisy(exact, 0.02 * START, 0)])
    np.savetxt(folder / "decay.csv", table, delimiter=",", header="time,position", comments="")
    (folder / "study.toml").write_text(STUDY.format(nuisance=nuisance, fixed=fixed))
    return folder / "study.toml"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("nuisance", "fixed"),
    [('nuisance = ["initial_state"]', ""), ("", 'initial_displacement = "170 mm"')],
    ids=["initial state solved", "released from elsewhere"],
)
def test_backbone_and_decay_alone_recover_a_cubic_spring(tmp_path, nuisance, fixed):
    study = load(written(tmp_path, nuisance, fixed)).study
    found = study.run(Store(tmp_path / "out"), InProcess(partial(evaluate, study.without_search()))).best.values
    assert found["stiffness"] == pytest.approx(STIFFNESS, rel=2e-3)
    assert found["damping"] == pytest.approx(DAMPING, rel=0.03)
    assert found["k3"] == pytest.approx(CUBIC, rel=0.04)


@pytest.mark.slow
def test_intervals_and_report_come_with_a_calibration_on_both(tmp_path):
    result = calibrate(written(tmp_path, 'nuisance = ["initial_state"]', ""), quiet=True)
    for name, truth in (("stiffness", STIFFNESS), ("damping", DAMPING), ("k3", CUBIC)):
        low, high = result.intervals[name]
        assert low <= truth <= high
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Frequency and damping ratio over the amplitude of the fundamental" in page
