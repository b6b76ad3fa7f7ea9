"""Diagnosis of frequency responses with a second harmonic: a weak quadratic spring that the first does not show."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from hidden.stepped import STUDY
from scipy.integrate import solve_ivp

from calib.cli import main as calib
from calib.records import write
from calib.records.response import make_response

STIFFNESS, DAMPING, K2 = 400.0, 10.0, 600.0  # N/m, N s/m, 1/(m s^2)
LEVELS, HELD_OUT = (2.0, 4.0), (3.0,)  # N
FREQUENCIES = np.linspace(2.6, 3.8, 16)  # Hz
PHASE, NOISE = -1.3, 4e-5  # rad, m: 0.2 % of the largest amplitude
SETTLING_PERIODS, SAMPLES = 16, 64  # count
CANDIDATES = ("quadratic_stiffness", "cubic_stiffness", "quadratic_drag", "coulomb_friction")


def integrated(frequency, level):
    """Harmonics 1 and 2 of the steady motion under level cos(2 pi F t + PHASE)  [m]."""
    omega = 2.0 * np.pi * frequency

    def rate(t, y):
        return [y[1], level * np.cos(omega * t + PHASE) - DAMPING * y[1] - STIFFNESS * y[0] - K2 * y[0] ** 2]

    t = (SETTLING_PERIODS + np.arange(SAMPLES) / SAMPLES) / frequency
    x = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-8, atol=1e-11).y[0]
    return [2.0 * np.mean(x * np.exp(-1j * k * (omega * t + PHASE))) for k in (1, 2)]


def record(levels, seed):
    rng = np.random.default_rng(seed)
    points = [(frequency, level) for level in levels for frequency in FREQUENCIES]
    exact = np.array([integrated(*own) for own in points]).T[:, None]
    first, second = exact + NOISE * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    frequency, level = np.array(points).T
    return make_response(
        frequency, ["mass"], first, level, "N", np.repeat(np.arange(float(len(levels))), FREQUENCIES.size), 1.0,
        sigma=np.full(first.shape, NOISE), frequency_sigma=np.full(frequency.size, 1e-5), higher={2: second},
        place="mass", quantity="force",
    )  # fmt: skip


def diagnosed(folder, *dropped):
    folder.mkdir()
    for name, levels, seed in (("levels", LEVELS, 1), ("between", HELD_OUT, 2)):
        write(record(levels, seed).drop_vars(dropped), folder / f"{name}.nc")
    study = STUDY.format(seed=1) + f"\n[diagnosis]\ncandidates = {json.dumps(CANDIDATES)}\n"
    (folder / "study.toml").write_text(study.replace("high = 8.0", "high = 20.0"))
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(folder), "--quiet", "--jobs", "1"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    return json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.mark.slow
def test_a_quadratic_spring_is_named_by_the_second_harmonic(tmp_path):
    said = diagnosed(tmp_path / "whole")
    assert said["verdict"] == "named"
    assert said["causes"] == ["quadratic_stiffness"]
    unreachable = json.loads((tmp_path / "whole" / "out" / "result.json").read_text())["unreachable"]
    assert [one["feature"] for one in unreachable] == ["rms harmonic 2 (4 N, up)"], "that at 2 N noise hides"
    [spring] = [one for one in said["suspects"] if one["effect"] == "quadratic_stiffness"]
    low, high = spring["interval"]["k2"]
    assert abs(spring["size"]["k2"] - K2) < 0.75 * (high - low)  # 3 standard errors
    assert high - low < 0.3 * K2
    assert said["gain"]["after"] < 0.9 * said["gain"]["before"]
    page = (tmp_path / "whole" / "out" / "report.html").read_text()
    assert "Amplitude and phase of each harmonic" in page
    assert "times as large as the simulated one" not in page


@pytest.mark.slow
def test_by_the_first_harmonic_alone_it_is_not(tmp_path):
    said = diagnosed(tmp_path / "first", "in_phase_2", "quadrature_2")
    assert said["verdict"] != "named" or said["causes"] != ["quadratic_stiffness"]
