"""A simulator of a third party: it passes the suite, is installed, is found, and is calibrated."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import write
from calib.records.excitation import Excitation
from calib.testing import SimulatorSuite

HERE = Path(__file__).parent / "pendulum"


def pendulum():
    spec = importlib.util.spec_from_file_location("calib_pendulum", HERE / "calib_pendulum.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["calib_pendulum"] = module
    spec.loader.exec_module(module)
    return module.Pendulum


Pendulum = pendulum()
SHAKEN = Excitation("pivot", "base motion", frequency=0.4, amplitude=0.01)


class TestPendulum(SimulatorSuite):
    excitation = SHAKEN

    def make(self):
        return Pendulum()


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("third_party")
    shutil.copytree(HERE, folder / "source")
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation"]
    command += ["--disable-pip-version-check", "--target", str(folder / "site"), str(folder / "source")]
    subprocess.run(command, check=True, capture_output=True)
    return {**os.environ, "PYTHONPATH": str(folder / "site")}


STUDY = """
[study]
name = "pendulum"
seed = 1
budget = 60
jobs = 1

[[record]]
name = "swing"
path = "swing.nc"

[model]
simulator = "pendulum"

[windows]
length = { low = "0.5 m", high = "2 m" }
damping = { low = 0.01, high = 0.3, scale = "log" }

[[term]]
feature = "phase_curve"
"""


@pytest.mark.slow
def test_an_installed_simulator_is_listed_and_calibrated(installed, tmp_path):
    record = Model(Pendulum()).run({"length": 1.3, "damping": 0.08}, SHAKEN, Request(periods=4, samples=100))
    rng = np.random.default_rng(1)
    for channel in ("displacement", "velocity"):
        record[channel].values += 0.01 * float(record[channel].std()) * rng.standard_normal(record[channel].shape)
    write(record.drop_vars(["section_displacement", "section_velocity"]), tmp_path / "swing.nc")
    (tmp_path / "study.toml").write_text(STUDY)
    calib = [sys.executable, "-m", "calib"]
    listed = subprocess.run([*calib, "list"], env=installed, check=True, capture_output=True, text=True)
    assert "pendulum" in listed.stdout
    ran = subprocess.run(
        [*calib, "run", str(tmp_path / "study.toml"), "--json"], env=installed, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    result = json.loads(ran.stdout)
    assert result["values"]["length"] == pytest.approx(1.3, rel=0.01)
    assert result["motion"]["kind"] == "period-1"
