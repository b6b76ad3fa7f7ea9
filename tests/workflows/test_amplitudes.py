"""Where a response is implausibly large or small, the unit of its level is named too."""

import numpy as np
from hidden.stepped import STUDY

from calib.records.response import make_response
from calib.study_file import load
from calib.workflows.amplitudes import implausible_amplitudes


def test_a_response_that_is_implausibly_small_has_the_unit_of_its_level_named(tmp_path):
    frequency = np.linspace(2.7, 4.0, 24)
    omega = 2.0 * np.pi * frequency
    receptance = 0.2 / (400.0 - omega**2 + 1j * omega)
    for name in ("levels", "between"):
        response = make_response(frequency, ["mass"], receptance[None], 200.0, "N", place="mass", quantity="force")
        response.to_netcdf(tmp_path / f"{name}.nc")
    (tmp_path / "study.toml").write_text(STUDY.format(seed=1))
    objective = load(tmp_path / "study.toml").study.objective
    simulated = make_response(frequency, ["mass"], 1e3 * receptance[None], 200.0, "N")
    [remark] = implausible_amplitudes(objective, {"levels": simulated})
    assert "of mass is 0.001 times as large as the simulated one" in remark
    assert remark.endswith("check its unit and that of the level, 200 N, which excites the model")
    alike = make_response(frequency, ["mass"], receptance[None], 200.0, "N")
    assert implausible_amplitudes(objective, {"levels": alike}) == []


def test_a_higher_harmonic_that_the_model_lacks_is_no_matter_of_units(tmp_path):
    frequency, small = np.linspace(2.7, 4.0, 24), 1e-6 * np.linspace(1.0, 2.0, 24)[None]
    for name in ("levels", "between"):
        response = make_response(frequency, ["mass"], 1e3 * small, 2.0, "N", higher={2: small}, place="mass",
                                 quantity="force")  # fmt: skip
        response.to_netcdf(tmp_path / f"{name}.nc")
    (tmp_path / "study.toml").write_text(STUDY.format(seed=1))
    objective = load(tmp_path / "study.toml").study.objective
    linear = make_response(frequency, ["mass"], 1e3 * small, 2.0, "N", higher={2: 1e-15 * small})
    assert implausible_amplitudes(objective, {"levels": linear}) == []
