"""Simulations as a diagnosis compares them."""

import numpy as np
import pytest
from workflows.test_discover import STUDY, record

from calib.diagnosis.bench import Run
from calib.diagnosis.preparation import bench_of
from calib.records import write
from calib.study_file import load

STATES = (("mass", "displacement"), ("mass", "velocity"))
VALUES = {"mass": 1.0, "damping": 2.0, "stiffness": 4000.0}


def test_states_that_were_not_measured_are_those_of_the_simulation(tmp_path):
    whole = record(6.0, 0, {})
    for name in ("soft", "hard"):
        write(whole.drop_vars(["velocity", "velocity_sigma"]), tmp_path / f"{name}.nc")
    (tmp_path / "study.toml").write_text(STUDY)
    file = load(tmp_path)
    view = bench_of(file.study, file.others)(Run("soft", VALUES, rows=STATES))
    assert view.usable
    measured = whole.velocity.values[0]
    assert np.abs(view.rows[1] - measured).max() == pytest.approx(0.0, abs=0.06 * np.abs(measured).max())
