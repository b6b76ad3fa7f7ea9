"""Records that contradict what is said of their excitation are doubted before a search."""

import numpy as np
from hidden.stepped import STUDY

from calib.records.response import make_response
from calib.study_file import load
from calib.workflows.doubtful_records import doubtful_records


def test_a_response_that_leads_its_force_is_doubted_with_the_name_of_its_record(tmp_path):
    frequency = np.linspace(2.7, 4.0, 24)
    omega = 2.0 * np.pi * frequency
    receptance = 1.0 / (400.0 - omega**2 + 1j * omega)
    for name, own in (("levels", receptance.conj()), ("between", receptance)):
        response = make_response(frequency, ["mass"], own[None], 0.2, "N", place="mass", quantity="force")
        response.to_netcdf(tmp_path / f"{name}.nc")
    (tmp_path / "study.toml").write_text(STUDY.format(seed=1))
    [doubt] = doubtful_records(load(tmp_path / "study.toml"))
    assert doubt.startswith("record 'levels': the displacement of mass leads the force on it")
