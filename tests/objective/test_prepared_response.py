"""Distance of measured responses from simulated curves."""

import numpy as np
import pytest

from calib.errors import CalibError
from calib.features.frequency_response import ResponseDistance
from calib.objective import Objective, Reference, Term
from calib.records.excitation import Excitation
from calib.records.response import make_response

FORCE = Excitation("mass", "force", frequency=1.0, amplitude=1.0)
SIGMA, FREQUENCY_SIGMA = 0.01, 0.005  # m, Hz


def curve(fold, frequency):
    """Upper branch that ends, steep, at a fold [m]."""
    return np.sqrt(np.maximum(fold - frequency, 0.0)) + 1.0 + 0j


def simulated(fold, factor=1.0):
    upper = np.concatenate([np.linspace(1.0, fold - 0.05, 40), fold - 0.05 * np.linspace(1.0, 0.0, 30)[1:] ** 2])
    lower = np.linspace(fold, 3.0, 30)
    frequency = np.concatenate([upper, lower])
    amplitude = factor * np.concatenate([curve(fold, upper), np.full(lower.size, 0.1)])
    record = make_response(frequency, ["mass"], amplitude[None], 1.0, "N")
    return record.assign(piece=("point", np.repeat([0.0, 1.0], [upper.size, lower.size])))


def objective():
    frequency = np.array([1.2, 1.5, 1.9, 1.99, 2.1, 2.5])
    amplitude = np.where(frequency < 2.0, curve(2.0, frequency), 0.1)
    measured = make_response(
        frequency, ["mass"], amplitude[None], 1.0, "N", sigma=np.full((1, 6), SIGMA),
        frequency_sigma=np.full(6, FREQUENCY_SIGMA), place="mass", quantity="force",
    )  # fmt: skip
    return Objective({"stepped": Reference("stepped", measured, excitation=FORCE)}, [Term(ResponseDistance())])


def test_the_measured_curve_is_at_no_distance():
    assert objective()({"stepped": simulated(2.0)}).cost < 1e-5


def test_a_response_that_is_too_large_is_far_by_as_much():
    score = objective()({"stepped": simulated(2.0, 1.001)})
    flat = 0.001 / np.sqrt(3.0)
    assert 0.5 * flat < score.cost < 1.05 * flat


def test_a_fold_that_comes_early_is_a_distance_in_frequency_and_no_jump():
    compared = objective()
    folds = np.linspace(1.96, 2.02, 61)
    residuals = np.array([compared({"stepped": simulated(fold)}).residuals for fold in folds])
    steps = np.abs(np.diff(residuals, axis=0)).max(axis=1)
    assert steps.max() < 6.0 * np.median(steps)
    aligned = compared.aligned("stepped", simulated(1.96))
    assert float(aligned.frequency[3]) == pytest.approx(1.96, abs=0.01)
    assert float(aligned.in_phase[0, 3]) > 0.9, "the end of its own branch, not the other one"


def test_a_failed_response_costs_infinitely_and_a_nuisance_is_refused():
    compared = objective()
    wrong = simulated(2.0).assign_attrs(status="not periodic", reason="chaotic")
    assert compared({"stepped": wrong}).cost == np.inf
    with pytest.raises(CalibError, match="a frequency response has no nuisances"):
        Reference("stepped", simulated(2.0).drop_vars("piece"), nuisance=["trigger"], excitation=FORCE)
