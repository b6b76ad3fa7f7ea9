import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import qmc
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from calib.emulation.gaussian_process import NegativeLogLikelihood, fit
from calib.emulation.trend import PolynomialTrend, Trend
from calib.errors import CalibError


def sobol(number, dim=3, seed=0):
    return qmc.Sobol(dim, seed=seed).random(number)


def waves(x):
    """Two quantities of three parameters; the second does not know the first parameter."""
    return np.column_stack([np.sin(4 * x[:, 0]) + x[:, 1] ** 2 + 5, 1e3 * np.cos(3 * x[:, 2]) * (1 + x[:, 1])])


def test_smooth_quantities_are_emulated_to_a_percent_of_their_spread():
    emulator = fit(sobol(64), waves(sobol(64)))
    apart = sobol(256, seed=1)
    error = emulator.predict(apart).mean - waves(apart)
    assert (np.sqrt((error**2).mean(axis=0)) < 0.01 * waves(apart).std(axis=0)).all()


def test_stated_errors_are_as_large_as_the_errors_are():
    """Also where a quantity has a kink, which no Matern process of this smoothness has."""

    def kinked(x):
        return np.abs(x[:, 0] - 0.4) + 0.3 * np.sin(5 * x[:, 1])

    emulator = fit(sobol(64), kinked(sobol(64)))
    apart = sobol(512, seed=1)
    predicted = emulator.predict(apart)
    z = (predicted.mean[:, 0] - kinked(apart)) / predicted.std[:, 0]
    assert 0.5 < np.sqrt((z**2).mean()) < 1.5


def test_noise_is_told_from_the_quantity():
    points = sobol(128)
    values = waves(points)[:, 0] + np.random.default_rng(2).normal(0, 0.1, 128)
    emulator = fit(points, values)
    assert emulator.noise_std[0] == pytest.approx(0.1, rel=0.25)
    apart = sobol(256, seed=1)
    assert np.sqrt(np.mean((emulator.predict(apart).mean[:, 0] - waves(apart)[:, 0]) ** 2)) < 0.05


def test_values_of_large_known_variance_weigh_little():
    """A point in four is off by as much as its variance says: the others tell the quantity."""
    points = sobol(128)
    variances = np.where(np.arange(128) % 4 == 0, 1.0, 0.0)
    values = waves(points)[:, 0] + np.sqrt(variances) * np.random.default_rng(3).standard_normal(128)
    apart = sobol(256, seed=1)
    error = fit(points, values, variances=variances).predict(apart).mean[:, 0] - waves(apart)[:, 0]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.sqrt(np.mean((fit(points, values).predict(apart).mean[:, 0] - waves(apart)[:, 0]) ** 2)) > 0.1


@pytest.mark.parametrize("trend", list(Trend))
def test_the_likelihood_and_its_gradient_are_those_of_scikit_learn(trend):
    points, theta = sobol(32), np.log([1.3, 0.4, 0.9, 2.0, 1e-3])
    values = waves(points)[:, 0] - waves(points)[:, 0].mean()
    kernel = ConstantKernel(1.0) * Matern(np.ones(3), nu=2.5) + WhiteKernel(1.0) + PolynomialTrend(trend)
    variances = np.linspace(0.01, 0.1, 32)
    regressor = GaussianProcessRegressor(kernel, optimizer=None, alpha=variances).fit(points, values)
    expected, slope = regressor.log_marginal_likelihood(theta, eval_gradient=True)
    value, gradient = NegativeLogLikelihood.of(points, values, trend, variances)(theta)
    assert value == pytest.approx(-expected, rel=1e-9)
    np.testing.assert_allclose(gradient, -slope, rtol=1e-6)


def test_a_parameter_without_influence_has_a_long_correlation():
    lengths = fit(sobol(64), waves(sobol(64))).lengths
    assert lengths[1, 0] > 10 * lengths[1, 2]
    assert lengths[0, 2] > 10 * lengths[0, 0]


@pytest.mark.parametrize(("trend", "power"), [(Trend.LINEAR, 1), (Trend.QUADRATIC, 2)])
def test_a_trend_goes_on_where_there_are_no_points(trend, power):
    def polynomial(x):
        return 3 + 2 * x[:, 0] - (x[:, 1] + x[:, 2]) ** power

    half = sobol(32) * [0.5, 1.0, 1.0]
    apart = sobol(64, seed=1)
    error = fit(half, polynomial(half), trend).predict(apart).mean[:, 0] - polynomial(apart)
    assert np.abs(error).max() < 1e-2
    if trend is Trend.QUADRATIC:
        constant = fit(half, polynomial(half), Trend.CONSTANT).predict(apart).mean[:, 0] - polynomial(apart)
        assert np.abs(error).max() < np.abs(constant).max()


def test_leave_one_out_is_what_leaving_one_out_gives():
    points, values = sobol(16), waves(sobol(16))
    emulator = fit(points, values, Trend.CONSTANT)
    other = np.delete(np.arange(16), 5)
    left_out = fit(points[other[:8]], values[other[:8]], Trend.CONSTANT)
    left_out = type(emulator)(
        points[other[:8]], values[other[:8]], Trend.CONSTANT, emulator.centre, emulator.scale,
        emulator.hyperparameters, emulator.variances[other[:8]], left_out._regressors,
    ).extended(points[other[8:]], values[other[8:]])  # fmt: skip
    predicted = left_out.predict(points[5:6])
    residuals = emulator.leave_one_out()
    np.testing.assert_allclose(residuals.residuals[5], (values[5] - predicted.mean[0]), rtol=1e-4)
    np.testing.assert_allclose(residuals.std[5] ** 2, predicted.std[0] ** 2 + emulator.noise_std**2, rtol=1e-3)


def test_points_added_enter_the_prediction_at_once():
    points, values = sobol(64), waves(sobol(64))
    emulator = fit(points[:48], values[:48])
    extended = emulator.extended(points[48:], values[48:])
    assert (extended.predict(points[48:]).std < 0.5 * emulator.predict(points[48:]).std).all()
    error = extended.predict(points[48:]).mean - values[48:]
    assert (np.abs(error) < 0.01 * values.std(axis=0)).all()


def test_a_fit_from_an_earlier_one_is_as_likely():
    points, values = sobol(64), waves(sobol(64))
    fresh = fit(points, values)
    warm = fit(points, values, start=fit(points[:32], values[:32]))
    np.testing.assert_allclose(
        warm.leave_one_out().residuals.std(axis=0), fresh.leave_one_out().residuals.std(axis=0), rtol=0.2
    )


def test_joint_draws_have_the_predicted_mean_spread_and_continuity():
    emulator = fit(sobol(16), waves(sobol(16)))
    close = np.repeat(sobol(4, seed=1), 2, axis=0) + np.tile([[0.0] * 3, [1e-3] * 3], (4, 1))
    drawn = emulator.draw(close, 4000, seed=3)
    predicted = emulator.predict(close)
    assert (np.abs(drawn.mean(axis=0) - predicted.mean) < 0.1 * predicted.std).all()
    np.testing.assert_allclose(drawn.std(axis=0), predicted.std, rtol=0.1)
    deviations = drawn - predicted.mean
    assert (np.abs(deviations[:, 1::2] - deviations[:, ::2]).mean(axis=0) < 0.1 * predicted.std[::2]).all()
    np.testing.assert_array_equal(drawn, emulator.draw(close, 4000, seed=3))


def test_a_constant_quantity_stays_constant():
    predicted = fit(sobol(16), np.full(16, 7.0)).predict(sobol(8, seed=1))
    np.testing.assert_allclose(predicted.mean, 7.0)
    assert np.isfinite(predicted.std).all()


@pytest.mark.parametrize(
    ("points", "values", "told"),
    [
        (np.zeros((8, 3)), np.zeros(7), "got shapes"),
        (sobol(8), np.full(8, np.nan), "failed"),
        (sobol(4), np.arange(4.0), "needs 8 points, got 4"),
    ],
)
def test_what_cannot_be_emulated_is_told(points, values, told):
    with pytest.raises(CalibError, match=told):
        fit(points, values)


def test_the_command_line_does_not_load_it():
    code = "import sys, calib.cli; sys.exit('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
