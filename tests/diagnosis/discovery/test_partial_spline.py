"""Forces as a formula and what the records add to it, on a simulator in closed form."""

import numpy as np
import pytest
from diagnosis.discovery.test_formulas import searched
from diagnosis.discovery.test_penalised import STATES

from calib.diagnosis.discovery.partial_spline import PartialSpline

LAW = -10.0 * STATES.x * np.abs(STATES.x)
BUMP = 3.0 * np.exp(-(((STATES.x - 0.5) / 0.15) ** 2))


def apart(force, true):
    """Difference (n,) of two forces, less the constant that the calibrated height absorbs."""
    return force - force.mean() - (true - true.mean())


def rms(values):
    return np.sqrt(np.mean(values**2))


def about(fitted, trials, text):
    [trial] = [trial for trial in trials if trial.formula.text == text]
    return PartialSpline.of(fitted, trial)


@pytest.mark.slow
def test_beside_the_right_formula_the_force_is_nearer_and_its_band_covers():
    free, partial, covered = [], [], []
    for seed in range(8):
        fitted, trials = searched(LAW, seed)
        force, error = about(fitted, trials, "c1 x |x|").surface(STATES.x, STATES.v)
        free.append(rms(apart(fitted.surface(STATES.x, STATES.v)[0], LAW)))
        partial.append(rms(apart(force, LAW)))
        covered.append(np.mean(np.abs(apart(force, LAW)) <= 1.96 * error))
    assert rms(np.array(partial)) < 0.75 * rms(np.array(free))
    assert np.mean(covered) > 0.9


def test_what_the_formula_lacks_is_added():
    fitted, trials = searched(LAW + BUMP)
    partial = about(fitted, trials, "c1 x |x|")
    force, _ = partial.surface(STATES.x, STATES.v)
    alone = partial.formula.values(STATES.x, STATES.v)
    assert rms(apart(force, LAW + BUMP)) < 0.5 * rms(apart(alone, LAW + BUMP))


def test_a_constant_that_calibration_absorbs_is_no_part_of_it():
    fitted, trials = searched(-10.0 * STATES.x**2)
    partial = about(fitted, trials, "c1 x^2")
    force, _ = partial.surface(STATES.x, STATES.v)
    assert force.mean() == pytest.approx(0.0, abs=1e-6)
    rows = partial.model.matrix(STATES.x, STATES.v)
    alone = partial.formula_alone(rows, lambda formula: formula.values(STATES.x, STATES.v))
    assert alone.mean() == pytest.approx(0.0, abs=1e-6)
