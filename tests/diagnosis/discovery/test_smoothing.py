"""Penalised least squares for free functions, on linear problems whose answers are known."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, free_force
from calib.diagnosis.discovery.smoothing import BesideFormula, Smoothing
from calib.diagnosis.score import Projection

FORCE = free_force("mass", [DISPLACEMENT], {DISPLACEMENT: (-1.0, 1.0)})
X = np.sin(np.linspace(0.0, 20.0, 600))
BASIS = FORCE.matrix(X, X)
[BENDING] = FORCE.roughness
PRIOR = BASIS.T @ BASIS / (X.size * 100.0**2)


def problem(values, absorbed=(), noise=1.0, seed=0):
    """Data of values (n,) and noise; columns that calibration absorbs."""
    data = values + noise * np.random.default_rng(seed).standard_normal(X.size)
    others = Projection(np.column_stack(absorbed) if absorbed else np.zeros((X.size, 0)))
    freedom = X.size - others.rank
    return Smoothing.of(BASIS, others(BASIS), others(data), freedom, FORCE.roughness, PRIOR)


def rms(values):
    return np.sqrt(np.mean(values**2))


def test_a_smooth_function_is_found_with_its_error():
    errors, standard = [], []
    for seed in range(20):
        truth = 10.0 * np.sin(2.0 * X)
        smoothing = problem(truth, seed=seed)
        error = BASIS @ smoothing.coefficients(smoothing.weight) - truth
        errors.append(rms(error))
        standard.append(np.mean(np.sum((BASIS @ smoothing.covariance(smoothing.weight)) * BASIS, axis=1)))
    assert max(errors) < 0.25  # of noise 1 in 600 samples
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(standard)) == pytest.approx(1.0, abs=0.25)


def test_the_weight_is_larger_where_the_function_is_smoother():
    line, wave = problem(10.0 * X), problem(10.0 * np.sin(9.0 * X))
    assert line.weight > 100.0 * wave.weight
    assert line.effective_parameters(line.weight) < 3.5
    assert wave.effective_parameters(wave.weight) > 8.0


def test_a_weight_leaves_as_many_parameters_as_asked_for():
    wave = problem(10.0 * np.sin(9.0 * X))
    for allowed in (1.0, 3.0, 5.0):
        beyond_linear = wave.effective_parameters(wave.weight_of(allowed)) - 2.0
        assert 0.6 * allowed < beyond_linear <= allowed + 0.01
    assert wave.weight_of(np.inf) == wave.weight_of(50.0) == wave.weight


def test_damped_coefficients_lie_between_those_before_and_the_minimum():
    smoothing = problem(10.0 * np.sin(3.0 * X))
    near, least = np.zeros(BASIS.shape[1]), smoothing.coefficients(smoothing.weight)
    apart = [
        rms(BASIS @ (smoothing.coefficients(smoothing.weight, d, near) - least)) for d in (0.0, 0.01, 1.0, 1e3, 1e9)
    ]
    assert apart == sorted(apart)
    assert (apart[0], apart[-1]) == pytest.approx((0.0, rms(BASIS @ least)), rel=1e-3)


def test_weight_and_estimate_agree_with_the_restricted_likelihood_by_its_definition():
    smoothing = problem(3.0 * np.cos(4.0 * X))
    weights = smoothing.weight * np.array([0.01, 1.0, 100.0])
    data = 3.0 * np.cos(4.0 * X) + np.random.default_rng(0).standard_normal(X.size)
    jitter = 1e-9 * np.diag(smoothing.prior).max() * np.eye(BASIS.shape[1])
    for weight in weights:
        precision = weight * BENDING.T @ BENDING + PRIOR + jitter
        covariance = np.eye(X.size) + BASIS @ np.linalg.solve(precision, BASIS.T)
        sign, determinant = np.linalg.slogdet(covariance)
        by_definition = X.size * np.log(data @ np.linalg.solve(covariance, data)) + determinant
        assert smoothing.criterion(weight) == pytest.approx(by_definition, rel=1e-5)
    assert smoothing.criterion(weights[1]) < min(smoothing.criterion(weights[0]), smoothing.criterion(weights[2]))


def test_a_linear_part_that_calibration_absorbs_is_left_out():
    smoothing = problem(10.0 * X + 5.0 * X**3, absorbed=[X])
    assert smoothing.absorbed.shape[1] == 1
    gauge = smoothing.gauge(BASIS)
    value = BASIS @ gauge @ smoothing.coefficients(smoothing.weight)
    expected = 5.0 * (X**3 - X * (X @ X**3) / (X @ X))
    assert rms(value - expected) < 0.2
    assert X @ value == pytest.approx(0.0, abs=1e-6)
    assert BASIS @ gauge @ np.linalg.lstsq(BASIS, X, rcond=None)[0] == pytest.approx(0.0, abs=1e-6)


def test_the_root_of_the_penalty_gives_the_same_estimate_as_further_data():
    smoothing = problem(10.0 * np.sin(3.0 * X))
    data = 10.0 * np.sin(3.0 * X) + np.random.default_rng(0).standard_normal(X.size)
    root = smoothing.root(smoothing.weight)
    stacked = np.linalg.lstsq(np.vstack([BASIS, root]), np.concatenate([data, np.zeros(len(root))]), rcond=None)[0]
    assert smoothing.coefficients(smoothing.weight) == pytest.approx(stacked, abs=1e-6)
    assert smoothing.penalty(smoothing.weight, stacked) == pytest.approx(float(np.sum((root @ stacked) ** 2)))


def surface_problem(values, x, v, noise=1.0, seed=0):
    """Data of a function of two arguments and noise, and the basis functions of a surface there."""
    region = {DISPLACEMENT: (-1.0, 1.0), VELOCITY: (-1.0, 1.0)}
    surface = free_force("mass", [DISPLACEMENT, VELOCITY], region)
    basis = surface.matrix(x, v)
    data = values + noise * np.random.default_rng(seed).standard_normal(x.size)
    prior = basis.T @ basis / (x.size * 100.0**2)
    return basis, Smoothing.of(basis, basis, data, x.size, surface.roughness, prior)


def test_a_surface_is_as_rough_along_each_argument_as_it_has_to_be():
    rng = np.random.default_rng(1)
    x, v = rng.uniform(-1.0, 1.0, (2, 2000))
    errors, freedom = [], []
    for seed in range(10):
        truth = 10.0 * x * np.sin(3.0 * v)  # straight along the first
        basis, smoothing = surface_problem(truth, x, v, seed=seed)
        errors.append(rms(basis @ smoothing.coefficients(smoothing.weight) - truth))
        freedom.append(smoothing.effective_parameters(smoothing.weight))
        along_x, along_v = smoothing.relative_weights
        assert along_x > 1e4 * along_v
    assert 8.0 < np.mean(freedom) < 18.0  # 16 functions are straight along it, of 64
    assert np.mean(errors) < 1.2 * np.sqrt(np.mean(freedom) / x.size)


def test_the_weights_of_a_surface_are_those_of_the_largest_restricted_likelihood():
    rng = np.random.default_rng(1)
    x, v = rng.uniform(-1.0, 1.0, (2, 800))
    _, smoothing = surface_problem(5.0 * x**2 * v, x, v)
    own = smoothing.weight * smoothing.relative_weights
    least = smoothing.criterion(smoothing.weight)
    for factors in ((0.1, 1.0), (10.0, 1.0), (1.0, 0.1), (1.0, 10.0), (10.0, 10.0), (0.1, 0.1)):
        penalty = sum(w * f * square for w, f, square in zip(own, factors, smoothing.penalties, strict=True))
        precision = smoothing.gram + penalty + smoothing.prior
        left = smoothing.square - smoothing.moment @ np.linalg.solve(precision, smoothing.moment)
        determinants = np.linalg.slogdet(precision)[1] - np.linalg.slogdet(penalty + smoothing.prior)[1]
        assert smoothing.freedom * np.log(left) + determinants > least - 0.05  # the grid has four weights a decade


LINE = np.linalg.lstsq(BASIS, X, rcond=None)[0][:, None]  # x, by the coefficients


def beside_formula(values, calibrated, absorbed, seed=0):
    """Data of values (n,) and noise; functions beside 10 x |x|, whose number is changed, and a calibrated column."""
    columns = np.column_stack([BASIS, 10.0 * X * np.abs(X)])
    data = values + np.random.default_rng(seed).standard_normal(X.size)
    others, prior = Projection(calibrated), block_diag(PRIOR, 1e-4 * np.mean(columns[:, -1] ** 2))
    known = BesideFormula(BASIS, absorbed)
    smoothing = Smoothing.of(
        columns, others(columns), others(data), X.size - others.rank, FORCE.roughness, prior, known
    )
    return others(columns), smoothing


@pytest.mark.parametrize("apart", [1e-5, 1e-3])
def test_a_number_of_the_formula_is_as_certain_beside_a_line_that_calibration_absorbs(apart):
    """As by least squares, however exactly the derivative of the calibrated parameter is a line."""
    for seed in range(5):
        columns, smoothing = beside_formula(0.0 * X, (X + apart * np.sin(9.0 * X))[:, None], LINE, seed)
        number = np.zeros((1, columns.shape[1]))
        number[0, -1] = 1.0
        error = smoothing.errors(number, smoothing.weight)[0]
        assert error == pytest.approx(1.0 / np.linalg.norm(columns[:, -1]), rel=0.2)


def test_beside_a_formula_a_line_that_calibration_nearly_absorbs_adds_no_error_of_its_own():
    none, added, errors = np.zeros((BASIS.shape[1], 0)), [], []
    for seed in range(20):
        columns, smoothing = beside_formula(0.0 * X, (X + 0.05 * np.sin(9.0 * X))[:, None], none, seed)
        coefficients = smoothing.coefficients(smoothing.weight)
        added.append(rms(BASIS @ coefficients[:-1]))
        errors.append(rms(smoothing.errors(np.pad(BASIS, ((0, 0), (0, 1))), smoothing.weight)))
    alone = rms(X) / np.linalg.norm(columns[:, :-1] @ LINE)
    assert np.median(added) < 0.2 * alone
    assert np.median(errors) < 0.5 * alone


def test_a_line_that_the_data_show_beside_a_formula_is_added():
    _, smoothing = beside_formula(5.0 * X, np.zeros((X.size, 0)), np.zeros((BASIS.shape[1], 0)))
    values = np.column_stack([BASIS, 10.0 * X * np.abs(X)]) @ smoothing.coefficients(smoothing.weight)
    assert rms(values - 5.0 * X) < 0.2


def test_of_two_functions_that_are_added_one_constant_less_the_other_is_not_absorbed():
    """It is no function: of what calibration absorbs of one, no share may fall to the other."""
    rng = np.random.default_rng(2)
    v = rng.uniform(-1.0, 1.0, X.size)
    basis = np.column_stack([BASIS, FORCE.matrix(v, v)])
    columns = basis * (1.0 + 1e-9 * rng.standard_normal(basis.shape))  # as differences of simulations have them
    zero, size = np.zeros_like(BENDING), BASIS.shape[1]
    differences = [np.hstack([BENDING, zero]), np.hstack([zero, BENDING])]
    for absorbed in (v, v + 1e-5 * np.sin(9.0 * X)):
        others = Projection(absorbed[:, None])
        prior = block_diag(PRIOR, PRIOR)
        smoothing = Smoothing.of(columns, others(columns), others(3.0 * X + v), X.size - 1.0, differences, prior)
        assert smoothing.absorbed.shape[1] == 1
        own = basis[:, :size] @ smoothing.absorbed[:size, 0]
        other = basis[:, size:] @ smoothing.absorbed[size:, 0]
        assert rms(own) < 1e-4 * rms(other)
        assert abs(np.corrcoef(other, v)[0, 1]) > 0.99999
