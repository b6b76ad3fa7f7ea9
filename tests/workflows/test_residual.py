"""What a calibration leaves is said to be noise, or not, where the noise is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib import records
from calib.cli import tables
from calib.execution.pool import Failure
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term
from calib.plugins import load
from calib.records.excitation import Excitation
from calib.report.pages.verdict import verdict
from calib.study import CalibrationResult
from calib.study.evaluation import evaluate
from calib.study.result import ScoreSummary
from calib.workflows import residual
from calib.workflows.residual import residuals_beside_noise

DRIVE = Excitation("mass", "force", frequency=9.0, amplitude=20.0)
MODEL = Model(load("calib.simulators", "oscillator")())
VALUES = {**MODEL.nominal, "damping": 5.0}
NOISE = 0.01  # standard deviation over root mean square


def compared(damping=5.0, noise=NOISE, periods=6, stated=True):
    """Compare a record with this damping and the model with 5 N s/m."""
    request = Request(periods=periods, samples=100)
    record = MODEL.run({**VALUES, "damping": damping}, DRIVE, request)
    rng = np.random.default_rng(1)
    for channel in ("displacement", "velocity"):
        rows = record[channel].values
        sigma = noise * np.sqrt((rows**2).mean(axis=1))
        record[channel].values[:] = rows + sigma[:, None] * rng.standard_normal(rows.shape)
        if stated:
            record[f"{channel}_sigma"] = ("body", sigma, {"units": record[channel].attrs["units"]})
    reference = Reference("tone", record, "calibrate", excitation=DRIVE, request=request)
    objective = Objective({"tone": reference}, [Term(load("calib.features", "phase_curve")())])
    return residuals_beside_noise(objective, evaluate(SimpleNamespace(model=MODEL, objective=objective), VALUES))


@pytest.mark.parametrize(("stated", "source"), [(True, "stated in the record"), (False, "cycle to cycle")])
def test_a_residual_of_noise_is_noise(stated, source):
    channels = compared(stated=stated)
    assert [(one.body, one.channel, one.source) for one in channels] == [
        ("mass", "displacement", source),
        ("mass", "velocity", source),
    ]
    assert all(one.is_noise and 0.8 < one.ratio < 1.2 for one in channels)


@pytest.mark.parametrize("stated", [True, False])
def test_a_residual_beyond_the_noise_is_more(stated):
    channels = compared(damping=50.0, stated=stated)
    assert not any(one.is_noise for one in channels)
    assert min(one.ratio for one in channels) > 3.0


def test_nothing_is_said_where_the_noise_is_not_known():
    assert compared(periods=2, stated=False) == ()
    assert compared(noise=0.0, stated=False) == ()
    for nothing in (None, Failure("timeout", "late", 1.0)):
        assert residuals_beside_noise(SimpleNamespace(), nothing) == ()


def test_a_record_of_a_force_alone_repeats_after_its_period():
    time = np.arange(600) / 900.0
    force = np.sin(2.0 * np.pi * DRIVE.frequency * time)[None]
    record = records.make(time, ["mass"], {"force": force}, frequency=DRIVE.frequency)
    assert residual._cycle(record) == 1


def printed(result):
    return " ".join(tables._remarks(result))


def test_console_and_page_say_what_is_left_and_point_to_the_diagnosis():
    noise, more = (CalibrationResult(score=ScoreSummary(0.02), residual=compared(damping=d)) for d in (5.0, 50.0))
    assert verdict(noise).tone == "good"
    assert verdict(more).tone == "mind"
    for result, said in ((noise, "The residual is noise, as far as that is known"), (more, "calib diagnose tests")):
        assert said in printed(result)
        assert any(said in point for point in verdict(result).points)
    assert "noise" not in printed(CalibrationResult(score=ScoreSummary(0.02)))


def test_the_console_says_too_that_the_distance_is_large():
    far = CalibrationResult(score=ScoreSummary(0.2))
    assert "The distance is more than 5 %" in printed(far)
    assert any("The distance is more than 5 %" in point for point in verdict(far).points)
    assert "distance" not in printed(CalibrationResult(score=ScoreSummary(0.02)))


def beside_uneven_noise(left):
    """Return the part of a free decay whose noise is stated as ten times smaller from 0.5 s on, with what is left."""
    time = np.arange(1000) * 1e-3
    motion, sigma = np.exp(-2.0 * time) * np.cos(40.0 * time), np.where(time < 0.5, 0.05, 0.005)
    noise = sigma * np.random.default_rng(3).standard_normal(time.size)
    rows = {"displacement": (motion + noise + left * motion)[None], "displacement_sigma": sigma[None]}
    record = records.make(time, ["mass"], rows, place="mass", quantity="free decay")
    objective = Objective({"decay": Reference("decay", record)}, [Term(load("calib.features", "time_history")())])
    simulated = records.make(time, ["mass"], {"displacement": motion[None]})
    return residual.beside_simulation(objective, "decay", simulated), sigma


def test_noise_that_is_stated_of_each_sample_is_that_of_each_sample():
    (part, view), sigma = beside_uneven_noise(0.0)
    noise = part.noise[0]
    assert noise.sigma * noise.profile == pytest.approx(sigma)
    white = part.whitened(part.measured - view.rows)
    assert np.mean(np.reshape(white, (2, -1)) ** 2, axis=1) == pytest.approx([1.0, 1.0], rel=0.15)


def test_a_misfit_where_the_noise_is_small_is_seen():
    """It would vanish beside the rms of the stated noise: 0.036 where 0.005 is stated."""
    for left, least, most in ((0.0, 0.9, 1.1), (0.03, 1.5, 9.0)):
        (part, view), _ = beside_uneven_noise(left)
        assert least < np.mean(part.whitened(part.measured - view.rows)[-500:] ** 2) < most
