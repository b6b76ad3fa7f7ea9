"""What higher harmonics add to the confidence in a calibration: a spring that differs for the two directions."""

from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from calib.confidence import around_best
from calib.effects.quadratic_stiffness import EFFECT as QUADRATIC_STIFFNESS
from calib.execution.pool import InProcess
from calib.features.frequency_response import ResponseDistance
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.objective import Objective, Reference, Term
from calib.optimisers.multistart import Multistart
from calib.records.excitation import Excitation
from calib.records.response import make_response
from calib.simulators.oscillator import Oscillator
from calib.store import Store
from calib.study import CalibrationStudy, evaluate

TRUTH = {"stiffness": 400.0, "damping": 10.0, "k2": 1e3}  # N/m, N s/m, 1/(m s^2)
LEVEL, PHASE = 4.0, 2.1  # N, rad
FREQUENCIES = np.linspace(2.6, 3.8, 13)  # Hz
NOISE = 2e-5  # of either part of any harmonic  [m]
SETTLING_PERIODS, SAMPLES = 16, 64  # count
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0)


def integrated(frequency):
    """Harmonics 1 and 2 of the steady motion under LEVEL cos(2 pi F t + PHASE)  [m]."""
    omega = 2.0 * np.pi * frequency

    def rate(t, y):
        spring = TRUTH["stiffness"] * y[0] + TRUTH["k2"] * y[0] ** 2
        return [y[1], LEVEL * np.cos(omega * t + PHASE) - TRUTH["damping"] * y[1] - spring]

    t = (SETTLING_PERIODS + np.arange(SAMPLES) / SAMPLES) / frequency
    x = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], "DOP853", t, rtol=1e-8, atol=1e-11).y[0]
    return [2.0 * np.mean(x * np.exp(-1j * k * (omega * t + PHASE))) for k in (1, 2)]


@pytest.fixture(scope="module")
def measured():
    rng, harmonics = np.random.default_rng(3), np.array([integrated(own) for own in FREQUENCIES]).T[:, None]
    noisy = harmonics + NOISE * (rng.standard_normal(harmonics.shape) + 1j * rng.standard_normal(harmonics.shape))
    return make_response(
        FREQUENCIES, ["mass"], noisy[0], LEVEL, "N", 0, 1.0, sigma=np.full(noisy[0].shape, NOISE),
        frequency_sigma=np.full(FREQUENCIES.size, 1e-5), higher={2: noisy[1]}, place="mass", quantity="force",
    )  # fmt: skip


def standard_errors(record, folder):
    """Value and standard error of each parameter, as a calibration has them."""
    windows = {"stiffness": Window(380.0, 420.0), "damping": Window(8.0, 12.0), "k2": Window(0.0, 3e3)}
    study = CalibrationStudy(
        name="harmonics",
        model=Model(Oscillator(), [QUADRATIC_STIFFNESS]),
        space=Space(windows, {"mass": 1.0}),
        objective=Objective({"stepped": Reference("stepped", record, excitation=FORCE)}, [Term(ResponseDistance())]),
        optimiser=Multistart,
        budget=40,
        seed=1,
    )
    pool = InProcess(partial(evaluate, study.without_search()))
    found = study.run(Store(folder, view=None, keep="best"), pool)
    confidence = around_best(study, pool, found.best)
    return {
        name: (found.best.values[name], 0.25 * float(np.ptp(confidence.interval[name])))
        for name in windows
        if name in confidence.interval
    }


@pytest.mark.slow
def test_a_second_harmonic_determines_a_quadratic_spring_that_the_first_hardly_shows(measured, tmp_path):
    whole = standard_errors(measured, tmp_path / "whole")
    first = standard_errors(measured.drop_vars(["in_phase_2", "quadrature_2"]), tmp_path / "first")
    for name, truth in TRUTH.items():
        value, error = whole[name]
        assert abs(value - truth) < 4.0 * error, name
    assert whole["k2"][1] < 0.06 * TRUTH["k2"]
    assert "k2" not in first or first["k2"][1] > 4.0 * whole["k2"][1]
