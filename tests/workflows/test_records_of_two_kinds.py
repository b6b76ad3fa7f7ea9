"""Frequency responses and free decays in one study: one kind is calibrated on, the other is held out."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from calib.cli import main
from calib.errors import CalibError
from calib.study_file import load
from calib.workflows.calibrate import calibrate

MASS, STIFFNESS, DAMPING = 0.8, 15_523.0, 4.0

STUDY = """
[study]
name = "both"
seed = 1
budget = 30

[[record]]
name = "levels"
path = "levels.csv"
use = "{levels}"

[[record]]
name = "decay"
path = "decay.csv"
use = "{decay}"
nuisance = ["initial_state"]

[record.table]
time = {{ column = 1, unit = "s" }}
channels = [{{ column = 2, body = "mass", channel = "displacement", unit = "mm", sigma = "0.01 mm" }}]

[record.excitation]
place = "mass"
quantity = "free decay"

[model]
simulator = "oscillator"
fixed = {{ mass = "0.8 kg" }}

[windows]
stiffness = {{ low = "12 kN/m", high = "20 kN/m" }}
damping = {{ low = 1, high = 20, scale = "log" }}
{terms}
[optimiser]
name = "multistart"
"""
OF_LEVELS = '\n[[term]]\nfeature = "frequency_response"\n'
OF_DECAY = '\n[[term]]\nfeature = "time_history"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("both"), np.random.default_rng(3)
    frequency = np.linspace(20.0, 24.5, 19)
    w = 2.0 * np.pi * frequency
    amplitude = 0.5 / (STIFFNESS - MASS * w**2 + 1j * DAMPING * w)
    amplitude = amplitude + 5e-6 * (rng.standard_normal(19) + 1j * rng.standard_normal(19))
    lines = [
        f"{f:.5f}, 0.5, {1e3 * a.real:.6f}, {1e3 * a.imag:.6f}, 5" for f, a in zip(frequency, amplitude, strict=True)
    ]
    header = "frequency [Hz], level [N], mass in-phase [mm], mass quadrature [mm], mass sigma [um]"
    (folder / "levels.csv").write_text("\n".join(["# place: mass", "# quantity: force", header, *lines]))
    time, rate = np.arange(0.0, 1.5, 1.0 / 503.3), DAMPING / 2.0 / MASS
    decay = 1.2 * np.exp(-rate * time) * np.cos(np.sqrt(STIFFNESS / MASS - rate**2) * time)
    decay = decay + 0.01 * rng.standard_normal(time.size)
    np.savetxt(folder / "decay.csv", np.column_stack([time, decay]), "%.9g", delimiter=",")
    return folder


def written(folder, name, levels, decay, terms):
    path = folder / f"{name}.toml"
    path.write_text(STUDY.format(levels=levels, decay=decay, terms=terms))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("out", ["decay", "levels"])
def test_a_record_of_another_kind_is_predicted_by_the_term_that_names_it(folder, out):
    uses = {"levels": "calibrate", "decay": "calibrate", out: "holdout"}
    terms = {"levels": OF_LEVELS, "decay": OF_DECAY}
    terms[out] += f'records = ["{out}"]\n'
    path = written(folder, f"without_{out}", uses["levels"], uses["decay"], "".join(terms.values()))
    result = calibrate(path, out=folder / f"out_{out}")
    assert result.values["stiffness"] == pytest.approx(STIFFNESS, rel=2e-3)
    [held] = json.loads((folder / f"out_{out}" / "result.json").read_text())["holdout"].values()
    assert held["misfit"] < 0.05
    answer = CliRunner().invoke(main, ["diagnose", str(path), "--out", str(folder / f"out_{out}"), "--quiet"])
    assert answer.exit_code == 0, answer.output
    said = json.loads((folder / f"out_{out}" / "diagnosis.json").read_text())
    assert said["verdict"] == "none"


def test_a_term_of_both_uses_is_one_of_each(folder):
    path = written(folder, "parted", "holdout", "calibrate", f'{OF_DECAY}{OF_LEVELS}records = ["levels"]\n')
    objective = load(path).study.objective
    assert [term.label for term in objective.terms] == ["time_history"]
    assert [term.records for term in objective.elsewhere] == [("levels",)]


def test_without_a_term_of_its_own_a_record_of_another_kind_is_refused_with_the_remedy(folder):
    path = written(folder, "without_term", "calibrate", "holdout", OF_LEVELS)
    with pytest.raises(
        CalibError, match=r"needs in_phase.*or give decay a term of its own, with records = \['decay'\]"
    ):
        calibrate(path, out=folder / "out_refused")


def test_a_term_of_a_record_held_out_that_it_cannot_compare_is_refused(folder):
    path = written(folder, "wrong", "calibrate", "holdout", f'{OF_LEVELS}{OF_LEVELS}records = ["decay"]\n')
    with pytest.raises(CalibError, match=r"wrong.toml:\d+: term\[2\]: .*needs in_phase"):
        load(path)
