"""Distance of measured responses from simulated curves."""

import numpy as np
import pytest

from calib.errors import CalibError
from calib.features.frequency_response import ResponseDistance
from calib.objective import Objective, Reference, Term
from calib.objective.misfit import compared_rows
from calib.records.excitation import Excitation
from calib.records.response import PARTS, UNKNOWN_PHASE, make_response

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


@pytest.mark.parametrize("factor", [1.0, -1.0, 1.5])
def test_the_largest_amplitude_is_that_of_the_curve_whatever_its_phase(factor):
    """The point of a curve that is nearest to a measured one of another phase is a small one."""
    largest, where = objective().features("stepped", simulated(2.0, factor))
    assert largest.simulated == pytest.approx(abs(factor) * largest.measured, rel=1e-3)
    assert where.simulated == where.measured == 1.2


def test_a_failed_response_costs_infinitely_and_a_nuisance_is_refused():
    compared = objective()
    wrong = simulated(2.0).assign_attrs(status="not periodic", reason="chaotic")
    assert compared({"stepped": wrong}).cost == np.inf
    with pytest.raises(CalibError, match="a frequency response has no nuisances"):
        Reference("stepped", simulated(2.0).drop_vars("piece"), nuisance=["trigger"], excitation=FORCE)


# --- what is compared point by point, in standard uncertainties


def noisy(rng, fold=2.0):
    """Points of the upper branch up to the fold, each moved by noise of its stated uncertainties."""
    frequency = np.linspace(1.2, fold - 0.01, 60)
    amplitude = curve(fold, frequency) + SIGMA * (rng.standard_normal((60, 2)) @ [1.0, 1j])
    measured = make_response(
        frequency + FREQUENCY_SIGMA * rng.standard_normal(60), ["mass"], amplitude[None], 1.0, "N",
        sigma=np.full((1, 60), SIGMA), frequency_sigma=np.full(60, FREQUENCY_SIGMA), place="mass", quantity="force",
    )  # fmt: skip
    return Reference("stepped", measured, excitation=FORCE)


def residuals(reference, found):
    compared = Objective({"stepped": reference}, [Term(ResponseDistance())]).compared("stepped", found)
    return np.array([reference.compared[part][0].values - compared[part][0].values for part in PARTS])


def test_residuals_of_noise_have_unit_variance_whatever_the_slope_of_the_curve():
    rng = np.random.default_rng(5)
    drawn = np.array([residuals(noisy(rng), simulated(2.0)) for _ in range(60)])
    steep = slice(50, 58)  # where frequency counts more than amplitude
    assert np.mean(drawn**2) == pytest.approx(1.0, abs=0.06)
    assert np.mean(drawn[:, :, steep] ** 2) == pytest.approx(1.0, abs=0.15)


def test_residuals_have_the_length_of_the_distance_and_no_part_along_the_curve():
    rng = np.random.default_rng(6)
    reference = noisy(rng)
    objective = Objective({"stepped": reference}, [Term(ResponseDistance())])
    aligned = objective.aligned("stepped", simulated(2.0, 1.01))
    apart = [
        (reference.record.frequency.values - aligned.frequency.values) / FREQUENCY_SIGMA,
        *((reference.record[part][0].values - aligned[part][0].values) / SIGMA for part in PARTS),
    ]
    squares = (residuals(reference, simulated(2.0, 1.01)) ** 2).sum(axis=0)
    inside = slice(2, 55)
    np.testing.assert_allclose(squares[inside], np.square(apart).sum(axis=0)[inside], rtol=1e-3, atol=1e-3)


def test_residuals_change_smoothly_with_the_curve():
    reference = noisy(np.random.default_rng(7))
    found = np.array([residuals(reference, simulated(fold)) for fold in np.linspace(1.98, 2.02, 41)])
    steps = np.abs(np.diff(found[:, :, :50], axis=0)).max(axis=(1, 2))
    assert steps.max() < 3.0 * np.median(steps)


def test_without_phases_amplitudes_alone_are_compared():
    frequency = np.linspace(1.0, 2.5, 16)
    truth = 1.0 / (2.0 - frequency**2 + 0.3j * frequency)
    fine = np.linspace(0.9, 2.6, 200)
    turned = make_response(fine, ["mass"], np.exp(1.1j) / (2.0 - fine**2 + 0.3j * fine)[None], 1.0, "N")
    drawn = make_response(
        frequency, ["mass"], np.abs(truth)[None].astype(complex), 1.0, "N", place="mass", quantity="force",
        phases=UNKNOWN_PHASE,
    )  # fmt: skip
    compared = Objective({"drawn": Reference("drawn", drawn, excitation=FORCE)}, [Term(ResponseDistance())])
    assert compared({"drawn": turned.assign(piece=("point", np.zeros(200)))}).cost < 1e-4
    assert list(compared_rows(compared.references["drawn"], compared.terms)) == [("mass", "in_phase")]
