"""Records that contradict what is said of their excitation are doubted before a search."""

import numpy as np
import pytest
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


@pytest.mark.parametrize(("sigma", "doubted"), [(1e-5, False), (5e-2, True)])
def test_an_uncertainty_above_the_amplitude_is_doubted(tmp_path, sigma, doubted):
    frequency = np.linspace(2.7, 4.0, 24)
    omega = 2.0 * np.pi * frequency
    receptance = 0.2 / (400.0 - omega**2 + 1j * omega)
    for name in ("levels", "between"):
        make_response(
            frequency, ["mass"], receptance[None], 0.2, "N", sigma=np.full((1, 24), sigma), place="mass",
            quantity="force",
        ).to_netcdf(tmp_path / f"{name}.nc")  # fmt: skip
    (tmp_path / "study.toml").write_text(STUDY.format(seed=1))
    doubts = list(doubtful_records(load(tmp_path / "study.toml")))
    assert len(doubts) == 2 * doubted
    assert all("stated standard uncertainty of 50 mm, above its largest amplitude of " in one for one in doubts)
