"""The uncertainties of a record that a study has tracked are known to be estimated."""

import numpy as np

from calib.records.response import SIGMA_SOURCE
from calib.study_file import load

STUDY = """
[study]
name = "steps"
seed = 1
budget = 10

[[record]]
name = "steps"
path = "steps.csv"

[record.table]
rate = "500 Hz"
channels = [{ column = 2, body = "mass", channel = "acceleration", unit = "g" }]
tracking = { sine = "stepped", cycles = 10 }

[record.excitation]
place = "mass"
quantity = "force"
column = 1
unit = "N"

[model]
simulator = "oscillator"
fixed = { mass = "1 kg" }

[windows]
stiffness = { low = "12 kN/m", high = "20 kN/m" }
damping = { low = 1, high = 20 }

[[term]]
feature = "frequency_response"
"""


def test_a_tracked_record_says_that_its_uncertainties_are_estimated(tmp_path):
    rng, time = np.random.default_rng(1), np.arange(0.0, 5.0, 0.002)
    force = np.concatenate([np.cos(2.0 * np.pi * f * time) for f in np.arange(10.0, 13.5, 0.5)])
    noise = rng.standard_normal((force.size, 2))
    np.savetxt(tmp_path / "steps.csv", np.column_stack([force, 0.1 * force]) + 1e-3 * noise, delimiter=",")
    (tmp_path / "study.toml").write_text(STUDY)
    record = load(tmp_path / "study.toml").study.objective.references["steps"].record
    assert record.attrs[SIGMA_SOURCE] == "estimated by order tracking"
    omega = 2.0 * np.pi * record.frequency.values
    np.testing.assert_allclose(record.in_phase[0], -0.980665 / omega**2, rtol=1e-2)


def test_harmonics_are_tracked_up_to_the_order_that_is_asked_for(tmp_path):
    rng, time = np.random.default_rng(1), np.arange(0.0, 5.0, 0.002)
    phase = [2.0 * np.pi * f * time for f in np.arange(10.0, 13.5, 0.5)]
    force, motion = np.cos(phase).ravel(), np.sum([np.cos(phase), 0.1 * np.sin(2.0 * np.array(phase))], axis=0).ravel()
    noise = rng.standard_normal((force.size, 2))
    np.savetxt(tmp_path / "steps.csv", np.column_stack([force, 0.1 * motion]) + 1e-4 * noise, delimiter=",")
    (tmp_path / "study.toml").write_text(STUDY.replace("cycles = 10", "cycles = 10, harmonics = 2"))
    record = load(tmp_path / "study.toml").study.objective.references["steps"].record
    omega = 4.0 * np.pi * record.frequency.values
    np.testing.assert_allclose(record.quadrature_2[0], 0.01 * 9.80665 / omega**2, rtol=2e-2)
    assert "response_2_sigma" in record
    assert "in_phase_3" not in record
