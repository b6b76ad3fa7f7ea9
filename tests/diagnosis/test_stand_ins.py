"""A law that two causes imitate together, one of which alone is negligible beside it."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from calib.cli import main as calib

MASS, STIFFNESS, DAMPING = 1.2, 42637.0, 1.3572  # kg, N/m, N s/m
CUBIC, DRAG, FRICTION, SLIP = -3.8e7, 2.0, 0.05, 1e-3  # 1/(m^2 s^2), 1/m, m/s^2, m/s
AMPLITUDES = {"large": 5e-3, "middle": 3.5e-3, "small": 2.5e-3}  # m
RATE, SECONDS, NOISE = 800.0, 2.1, 8e-6  # Hz, s, m
RECORD = """
[[record]]
name = "{name}"
path = "{name}.csv"
use = "calibrate"
nuisance = ["initial_state"]
[record.table]
time = {{ column = "time", unit = "s" }}
channels = [{{ column = "x", body = "mass", channel = "displacement", unit = "m", sigma = "8 um" }}]
[record.excitation]
place = "mass"
quantity = "free decay"
"""
STUDY = """
[study]
name = "decays"
seed = 1
budget = 50
{records}
[model]
simulator = "oscillator"
fixed = {{ mass = "1.2 kg" }}

[windows]
stiffness = {{ low = "42 kN/m", high = "43.2 kN/m" }}
damping = {{ low = 0.3, high = 6, scale = "log" }}

[[term]]
feature = "time_history"

[diagnosis]
candidates = ["cubic_stiffness", "quadratic_drag", "coulomb_friction", "power_law_damping"]
"""


def written(folder: Path) -> None:
    """Write decays from three amplitudes, and the study that seeks what made them."""
    times, rng = np.arange(int(RATE * SECONDS)) / RATE, np.random.default_rng(1)

    def motion(_, state):
        x, v = state
        own = CUBIC * x**3 + DRAG * v * abs(v) + FRICTION * np.tanh(v / SLIP)
        return [v, -(STIFFNESS * x + DAMPING * v) / MASS - own]

    for name, amplitude in AMPLITUDES.items():
        exact = solve_ivp(motion, (0.0, SECONDS), [amplitude, 0.0], t_eval=times, rtol=1e-9, atol=1e-12).y[0]
        table = np.column_stack([times, exact + NOISE * rng.standard_normal(times.size)])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="time,x", comments="")
    records = "".join(RECORD.format(name=name) for name in AMPLITUDES)
    (folder / "study.toml").write_text(STUDY.format(records=records))


@pytest.mark.slow
def test_a_power_of_the_velocity_is_not_left_in_the_place_of_drag_and_friction(tmp_path):
    """Beside it dry friction is negligible, but from amplitude to amplitude its size differs: both are found."""
    written(tmp_path)
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(tmp_path), "--quiet"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert said["verdict"] == "named"
    assert set(said["causes"]) == {"cubic_stiffness", "quadratic_drag", "coulomb_friction"}
    joints = said["joint_sizes"].values()
    sizes = {name: size for joint in joints for name, size in joint["size"].items()}
    intervals = {name: interval for joint in joints for name, interval in joint["interval"].items()}
    for name, truth in {"k3": CUBIC, "c2": DRAG, "friction": FRICTION}.items():
        low, high = intervals[name]
        assert abs(sizes[name] - truth) < 0.75 * (high - low)  # 3 standard errors
