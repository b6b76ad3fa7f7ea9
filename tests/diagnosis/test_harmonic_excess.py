"""A model error that the sum of all squares hides shows in the low harmonics of the excitation."""

import numpy as np
import pytest

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import chi2_std, degrees_of_freedom, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.harmonic_excess import UNTESTED, harmonic_excess, model_error_chi2
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.signature import Point

PERIOD, RATE, CYCLES = 0.0731, 2000.0, 30  # s, Hz: a clock that does not divide the period
TIME = np.arange(round(CYCLES * PERIOD * RATE)) / RATE
ROWS = (("mass", "displacement"), ("mass", "velocity"))
PHASE = 2.0 * np.pi * TIME / PERIOD


def evidence(period=PERIOD, cycle=1, memory=()):
    noise = tuple(Noise(sigma, np.array(memory), STATED) for sigma in (1e-4, 1e-2))
    ones = np.ones((2, TIME.size))
    return Evidence((Part("tone", ROWS, TIME, 0.0 * ones, period, cycle, (), noise, ones > 0.0, ones),))


def fit(known, error, seed, columns=None):
    """Fit whose model leaves noise and an error (2, n) [unit of each row]."""
    [part] = known.parts
    size = part.measured.size
    columns = np.zeros((size, 0)) if columns is None else columns
    residual = np.random.default_rng(seed).standard_normal(size) + part.white(error)
    none = np.zeros((size, 0))
    left = Fit(Point({}, (), {}), (), residual, columns, tuple("abcdefgh"[: columns.shape[1]]), (), none, known.rows())
    return Fit(left.point, (), left.projection(residual), columns, left.names, (), none, left.rows)


def error_of(chi2, order):
    """Error of the displacement at a harmonic with so much chi-square."""
    wave = np.cos(order * PHASE + 0.3)
    return np.array([wave * 1e-4 * np.sqrt(chi2 / (wave @ wave)), 0.0 * wave])


def test_of_noise_alone_the_excess_has_mean_zero_and_the_stated_deviation():
    known = evidence(memory=(0.6,))
    columns = np.random.default_rng(1).standard_normal((2 * TIME.size, 4))
    columns[:, 0] = known.parts[0].white(error_of(1.0, 1))
    found = [harmonic_excess(known, fit(known, np.zeros((2, TIME.size)), seed, columns)) for seed in range(60)]
    totals = np.array([one.total for one in found])
    assert 2 * 21 - 1.3 < found[0].degrees.sum() < 2 * 21 - 1.0  # one column lies in them, the others hardly
    assert abs(totals.mean()) < 3.0 * found[0].std / np.sqrt(len(found))
    assert totals.std() == pytest.approx(found[0].std, rel=0.2)
    assert sum(one.is_significant for one in found) <= 3


@pytest.mark.parametrize(("order", "cycle"), [(0, 1), (1, 1), (10, 1), (0.5, 2)])
def test_an_error_in_low_harmonics_is_significant_that_all_squares_hide(order, cycle):
    known = evidence(cycle=cycle)
    model = fit(known, error_of(150.0, order), 5)
    excess, std = excess_chi2(known, model), chi2_std(known)
    assert not significant(excess, std)
    found = harmonic_excess(known, model)
    assert found.is_significant
    assert found.rows[0] == pytest.approx(150.0, abs=60.0)
    assert abs(found.rows[1]) < 30.0
    assert model_error_chi2(excess, std, found) == found.total


@pytest.mark.parametrize(("order", "period"), [(14.3, PERIOD), (1, None)])
def test_beyond_them_and_without_a_period_only_all_squares_count(order, period):
    known = evidence(period)
    small, large = (fit(known, error_of(chi2, order), 5) for chi2 in (150.0, 1500.0))
    assert model_error_chi2(excess_chi2(known, small), chi2_std(known), harmonic_excess(known, small)) == 0.0
    excess = excess_chi2(known, large)
    assert model_error_chi2(excess, chi2_std(known), harmonic_excess(known, large)) == excess > 1000.0


def test_what_parameters_absorb_is_no_degree_of_freedom():
    known = evidence()
    white = known.parts[0].white
    columns = np.array([white(error_of(1.0, order)) for order in range(4)]).T
    model = fit(known, error_of(1000.0, 2), 1, columns)
    assert harmonic_excess(known, model).degrees.tolist() == pytest.approx([17.0, 21.0], abs=1e-6)
    assert not harmonic_excess(known, model).is_significant
    assert degrees_of_freedom(known, model) == 2 * TIME.size - 4


def test_without_a_test_there_is_no_model_error_but_by_all_squares():
    assert model_error_chi2(10.0, 5.0, UNTESTED) == 0.0
    assert model_error_chi2(16.0, 5.0, UNTESTED) == 16.0
