"""An FMU calibrated from a study file against a record that another integrator made."""

import json
import shutil

import numpy as np
import pytest
from impact_fmu.peer import DRIVE, VALUES, peer
from written_page import page_content

from calib import records
from calib.errors import CalibError
from calib.execution.files import checksum
from calib.study_file import load
from calib.workflows.calibrate import calibrate, rebuild

TRUTH = VALUES | {"stiffness": 4300.0, "gap": 3.6e-4}
PERIODS, SAMPLES, SETTLED = 4, 80, 12  # of the record; periods before it
NOISE = {"displacement": 2e-6, "velocity": 1e-4}  # m, m/s

STUDY = """\
[study]
name = "fmu"
seed = 1
budget = 40
screen = 12
timeout = "30 s"
periods = 4
samples = 80
settle = 12

[[record]]
name = "bench"
path = "bench.nc"

[model]
simulator = "fmu"
fixed = { damping = 20.0 }

[model.options]
path = "model/oscillator.fmu"
parameters = { stiffness = { variable = "spring.stiffness" }, gap = {}, damping = {} }
outputs = { mass = { displacement = "x", velocity = "v" } }
input = { quantity = "base motion", place = "base", displacement = "base", velocity = "base_rate" }
section = 4

[windows]
stiffness = { low = "3.5 kN/m", high = "5 kN/m" }
gap = { low = "0.2 mm", high = "0.6 mm" }

[[term]]
feature = "phase_curve"

[optimiser]
name = "multistart"
"""


@pytest.fixture
def study(tmp_path, fmu_file):
    """Write the record, the study and its FMU into a folder; return the study's path."""

    def write(*kind):
        time = np.arange(PERIODS * SAMPLES) / (DRIVE.frequency * SAMPLES)
        states = peer(time + SETTLED / DRIVE.frequency, values=TRUTH)
        rng = np.random.default_rng(0)
        channels = {}
        for (name, sigma), values in zip(NOISE.items(), states, strict=True):
            channels[name] = (values + sigma * rng.standard_normal(values.size))[None]
            channels[f"{name}_sigma"] = np.array([sigma])
        attrs = {"frequency": DRIVE.frequency, "amplitude": DRIVE.amplitude, "phase": DRIVE.phase}
        record = records.make(time, ["mass"], channels, **attrs, place="base", quantity="base motion")
        records.write(record, tmp_path / "bench.nc")
        (tmp_path / "model").mkdir()
        shutil.copy(fmu_file(*kind), tmp_path / "model" / "oscillator.fmu")
        (tmp_path / "study.toml").write_text(STUDY)
        return tmp_path / "study.toml"

    return write


def test_the_true_values_are_found(study, tmp_path):
    path = study("2.0", "CoSimulation")
    found = calibrate(path, quiet=True)
    for name, relative in (("stiffness", 0.01), ("gap", 0.01)):
        assert found.values[name] == pytest.approx(TRUTH[name], rel=relative)
    header = json.loads((path.parent / "out" / "trials.jsonl").read_text().splitlines()[0])
    assert header["code"] == {"file model/oscillator.fmu": f"sha256 {checksum(tmp_path / 'model' / 'oscillator.fmu')}"}
    before = page_content(path.parent / "out" / "report.html")
    shutil.rmtree(tmp_path / "model")
    assert page_content(rebuild(path)) == before, "without the FMU"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [("2.0", "ModelExchange"), ("3.0", "CoSimulation"), ("3.0", "ModelExchange")])
def test_the_true_values_are_found_by_every_kind_of_fmu(study, kind):
    found = calibrate(study(*kind), quiet=True)
    for name, relative in (("stiffness", 0.01), ("gap", 0.01)):
        assert found.values[name] == pytest.approx(TRUTH[name], rel=relative)


def test_a_study_that_goes_on_with_another_fmu_begins_a_new_segment(study):
    path = study("2.0", "CoSimulation")
    before = load(path).study.code
    with (path.parent / "model" / "oscillator.fmu").open("ab") as file:
        file.write(b"\0")  # the archive is the same, its file another
    assert load(path).study.code != before


def test_mistakes_in_the_options_name_their_place_in_the_study_file(study):
    path = study("2.0", "CoSimulation")
    path.write_text(STUDY.replace('"spring.stiffness"', '"spring.stifness"'))
    line = 1 + STUDY.splitlines().index("[model.options]")
    with pytest.raises(CalibError, match=rf"study.toml:{line}: model.options: .*no parameter 'spring.stifness'"):
        load(path)
    path.write_text(STUDY.replace('place = "base"', 'place = "floor"'))
    with pytest.raises(CalibError, match="driven by base motion at 'base'; simulator 'fmu' takes"):
        load(path)
