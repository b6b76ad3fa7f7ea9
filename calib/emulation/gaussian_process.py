"""Gaussian-process emulator of quantities over the unit cube, each with its own covariance, noise and trend.

A quantity is a polynomial trend plus a process with an anisotropic Matern 5/2 covariance plus white noise (Rasmussen &
Williams 2006, Gaussian Processes for Machine Learning, chap. 2 and 5; the computation is scikit-learn's).
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.optimize import minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, Sum, WhiteKernel

from calib.emulation.trend import PolynomialTrend, Trend, monomials_of_trend
from calib.errors import CalibError

SMOOTHNESS = 2.5  # nu of the Matern covariance: twice differentiable  [1]
LENGTH_BOUNDS = (0.03, 30.0)  # of correlation lengths, edges of the cube  [1]
START_LENGTHS = (0.3, 1.0, 3.0)  # at which the likelihood is first looked at, edges of the cube  [1]
SIGNAL_VARIANCE_BOUNDS = (1e-4, 1e4)  # variances of the values  [1]
NOISE_VARIANCE_BOUNDS = (1e-8, 1.0)  # variances of the values  [1]
START_NOISE_VARIANCE = 1e-4  # variances of the values  [1]
MAX_POINTS_OF_LIKELIHOOD = 300  # more would cost seconds a fit and change little; all points enter the prediction  [1]
MAX_LIKELIHOODS = 100  # evaluations of the marginal likelihood in one climb  [1]
POINTS_A_TREND_TERM = 2  # fewer leave nothing to tell the trend from the process by  [1]
MAX_JITTERS = 6  # powers of ten of the jitter that are tried
LEAST_NUGGET = 1e-10  # added to each value's, lest a covariance be singular, variances of the values  [1]
DRAW_JITTER = 1e-9  # added to the variance of joint draws, variances of the values  [1]


@dataclass(frozen=True)
class Emulated:
    """Emulated quantities at m points.

    Parameters
    ----------
    mean, std : (m, outputs), in the units of the values; `std` is of the quantity itself, without its noise
    """

    mean: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class LeaveOneOut:
    """Each value against its prediction by the other points, hyperparameters held.

    Parameters
    ----------
    residuals : (n, outputs), value minus prediction, in the units of the values
    std : (n, outputs), predicted standard deviation of these, noise included
    """

    residuals: np.ndarray
    std: np.ndarray


@dataclass(frozen=True)
class GaussianProcess:
    """Fitted emulator: what it predicts where, how sure it is, and how it stands the test of its own points.

    Parameters
    ----------
    points : (n, dim), of the unit cube
    values : (n, outputs)
    trend : degree of the trend
    centre, scale : (outputs,), by which values are standardised
    hyperparameters : (outputs, 2 + dim), logarithms of signal variance, correlation lengths and noise variance, of the
        standardised values
    variances : (n,) known ones of the values of each point, beside the noise; in the squared units of the values
    """

    points: np.ndarray
    values: np.ndarray
    trend: Trend
    centre: np.ndarray
    scale: np.ndarray
    hyperparameters: np.ndarray
    variances: np.ndarray
    _regressors: tuple[Any, ...]

    @property
    def lengths(self) -> np.ndarray:
        """Correlation lengths (outputs, dim), edges of the cube."""
        return np.exp(self.hyperparameters[:, 1:-1])

    @property
    def noise_std(self) -> np.ndarray:
        """Standard deviation (outputs,) of the noise, in the units of the values."""
        return self.scale * np.exp(self.hyperparameters[:, -1] / 2)

    def predict(self, points: np.ndarray) -> Emulated:
        """Mean and standard deviation of the quantities at points (m, dim)."""
        predicted = [regressor.predict(points, return_std=True) for regressor in self._regressors]
        mean = np.column_stack([mean for mean, _ in predicted])
        variance = np.column_stack([std**2 for _, std in predicted]) - np.exp(self.hyperparameters[:, -1])
        return Emulated(self.centre + self.scale * mean, self.scale * np.sqrt(np.maximum(variance, 0.0)))

    def covariance(self, points: np.ndarray) -> np.ndarray:
        """Posterior covariance (outputs, m, m) at points (m, dim), in the squared units of the values."""
        noise = np.exp(self.hyperparameters[:, -1])
        return np.stack(
            [
                scale**2 * (regressor.predict(points, return_cov=True)[1] - own * np.eye(len(points)))
                for regressor, own, scale in zip(self._regressors, noise, self.scale, strict=True)
            ]
        )

    def draw(self, points: np.ndarray, number: int, seed: int) -> np.ndarray:
        """Joint draws (number, m, outputs) of the quantities at points (m, dim), outputs independent of each other."""
        rng = np.random.default_rng(seed)
        drawn = [
            rng.standard_normal((number, len(points))) @ _root(covariance, scale).T
            for covariance, scale in zip(self.covariance(points), self.scale, strict=True)
        ]
        return self.predict(points).mean + np.stack(drawn, axis=-1)

    def leave_one_out(self) -> LeaveOneOut:
        """Residuals of each point predicted by all others (Rasmussen & Williams 2006, eqs. 5.10 to 5.12)."""
        residuals, variances = np.empty_like(self.values), np.empty_like(self.values)
        for output, regressor in enumerate(self._regressors):
            precision = np.diag(cho_solve((regressor.L_, True), np.eye(len(self.points))))
            residuals[:, output], variances[:, output] = regressor.alpha_ / precision, 1 / precision
        return LeaveOneOut(self.scale * residuals, self.scale * np.sqrt(variances))

    def extended(self, points: np.ndarray, values: np.ndarray) -> Self:
        """The emulator with more points (k, dim) and their values (k, outputs), hyperparameters held."""
        points, values = _checked(points, values)
        variances = np.append(self.variances, np.zeros(len(points)))
        return self.given(np.vstack([self.points, points]), np.vstack([self.values, values]), variances)

    def given(self, points: np.ndarray, values: np.ndarray, variances: np.ndarray | None = None) -> Self:
        """The emulator of other points (n, dim), values (n, outputs) and variances (n,), hyperparameters held."""
        points, values = _checked(points, values)
        variances = np.zeros(len(points)) if variances is None else variances
        regressors = tuple(
            _conditioned(theta, self.trend, points, (column - centre) / scale, variances / scale**2)
            for theta, column, centre, scale in zip(
                self.hyperparameters, values.T, self.centre, self.scale, strict=True
            )
        )
        return replace(self, points=points, values=values, variances=variances, _regressors=regressors)


def fit(
    points: np.ndarray,
    values: np.ndarray,
    trend: Trend = Trend.LINEAR,
    start: GaussianProcess | None = None,
    variances: np.ndarray | None = None,
) -> GaussianProcess:
    """Emulator of the values at these points, its hyperparameters by the largest marginal likelihood.

    Parameters
    ----------
    points : (n, dim), of the unit cube
    values : (n,) or (n, outputs), finite
    trend : degree of the trend
    start : an earlier emulator of the same quantities; the likelihood is climbed from its hyperparameters alone
    variances : (n,) known ones of the values of each point, beside the noise; None: there are none

    Raises
    ------
    CalibError
        where shapes differ, values are not finite, or the points are fewer than twice the coefficients of the trend
    """
    points, values = _checked(points, values)
    fewest = POINTS_A_TREND_TERM * monomials_of_trend(points[:1], trend).shape[1]
    if len(points) < fewest:
        raise CalibError(
            f"an emulator with a {trend.name.lower()} trend over {points.shape[1]} parameters needs {fewest} points, "
            f"got {len(points)}; evaluate more, or choose a lower trend"
        )
    centre, scale = values.mean(axis=0), values.std(axis=0)
    scale = np.where(scale > 1e-12 * np.maximum(np.abs(centre), 1e-300), scale, 1.0)
    standardised = (values - centre) / scale
    variances = np.zeros(len(points)) if variances is None else variances
    hyperparameters = np.array(
        [
            _most_likely(
                points, column, trend, None if start is None else start.hyperparameters[k], variances / scale[k] ** 2
            )
            for k, column in enumerate(standardised.T)
        ]
    )
    regressors = tuple(
        _conditioned(hyperparameters[k], trend, points, column, variances / scale[k] ** 2)
        for k, column in enumerate(standardised.T)
    )
    return GaussianProcess(points, values, trend, centre, scale, hyperparameters, variances, regressors)


def _checked(points: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, dim) and values (n, outputs) as arrays of floats, refused where they do not fit together."""
    points, values = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
    values = values[:, None] if values.ndim == 1 else values
    if points.ndim != 2 or values.ndim != 2 or len(points) != len(values):
        raise CalibError(
            f"expected points (n, dim) and values (n,) or (n, outputs), got shapes {points.shape} and {values.shape}"
        )
    if not (np.isfinite(points).all() and np.isfinite(values).all()):
        raise CalibError("an emulator needs finite points and values; leave out the runs that failed")
    return points, values


def _kernel(theta: np.ndarray, trend: Trend) -> Any:
    """Covariance with the hyperparameters theta (2 + dim,), which are logarithms."""
    signal, lengths, noise = np.exp(theta[0]), np.exp(theta[1:-1]), np.exp(theta[-1])
    process = ConstantKernel(signal, SIGNAL_VARIANCE_BOUNDS) * Matern(lengths, LENGTH_BOUNDS, nu=SMOOTHNESS)
    return Sum(process + WhiteKernel(noise, NOISE_VARIANCE_BOUNDS), PolynomialTrend(trend))


def _conditioned(theta: np.ndarray, trend: Trend, points: np.ndarray, column: np.ndarray, variances: np.ndarray) -> Any:
    """Regressor with the hyperparameters theta (2 + dim,), given standardised values (n,) with their variances (n,)."""
    kernel = _kernel(theta, trend)
    return GaussianProcessRegressor(kernel, alpha=variances + LEAST_NUGGET, optimizer=None).fit(points, column)


def _most_likely(
    points: np.ndarray, column: np.ndarray, trend: Trend, start: np.ndarray | None, variances: np.ndarray
) -> np.ndarray:
    """Hyperparameters (2 + dim,) of largest marginal likelihood, as logarithms, of standardised values (n,).

    Of more than MAX_POINTS_OF_LIKELIHOOD points an evenly spaced choice enters.
    """
    number = min(len(points), MAX_POINTS_OF_LIKELIHOOD)
    chosen = np.linspace(0, len(points) - 1, number).round().astype(int)
    dim = points.shape[1]
    starts = (
        [start]
        if start is not None
        else [np.log([1.0, *[length] * dim, START_NOISE_VARIANCE]) for length in START_LENGTHS]
    )
    bounds = _kernel(starts[0], trend).bounds
    likelihood = NegativeLogLikelihood.of(points[chosen], column[chosen], trend, variances[chosen])
    best = min((np.clip(theta, *bounds.T) for theta in starts), key=lambda theta: likelihood(theta)[0])
    options = {"maxfun": MAX_LIKELIHOODS}
    return minimize(likelihood, best, method="L-BFGS-B", jac=True, bounds=bounds, options=options).x


@dataclass(frozen=True)
class NegativeLogLikelihood:
    """Minus the log marginal likelihood of standardised values (Rasmussen & Williams 2006, eqs. 5.8 and 5.9).

    What does not change with the hyperparameters is computed once: the climb takes most of the time of a fit.

    Parameters
    ----------
    values : (n,)
    squares : (n * n, dim) squared differences of the points along each axis
    held : (n, n) covariance of the trend and of the values' known variances
    """

    values: np.ndarray
    squares: np.ndarray
    held: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, values: np.ndarray, trend: Trend, variances: np.ndarray) -> Self:
        """Return that of values (n,) with their variances (n,) at points (n, dim)."""
        squares = (points[:, None] - points[None]) ** 2
        return cls(values, squares.reshape(-1, points.shape[1]), PolynomialTrend(trend)(points) + np.diag(variances))

    def __call__(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient (2 + dim,) at the hyperparameters theta (2 + dim,), logarithms as in `_kernel`."""
        number = len(self.values)
        signal, precisions, noise = np.exp(theta[0]), np.exp(-2.0 * theta[1:-1]), np.exp(theta[-1])
        distance = np.sqrt(5.0 * (self.squares @ precisions)).reshape(number, number)
        falling = np.exp(-distance)
        process = signal * (1.0 + distance + distance**2 / 3.0) * falling
        try:
            root = cholesky(process + noise * np.eye(number) + self.held, lower=True)
        except np.linalg.LinAlgError:
            return np.inf, np.zeros_like(theta)
        weights, inverse = cho_solve((root, True), self.values), cho_solve((root, True), np.eye(number))
        value = 0.5 * self.values @ weights + np.log(np.diag(root)).sum() + 0.5 * number * np.log(2.0 * np.pi)
        outer = inverse - np.outer(weights, weights)
        by_length = (outer * (signal * 5.0 / 3.0 * (1.0 + distance) * falling)).ravel() @ self.squares * precisions
        gradient = 0.5 * np.array([np.vdot(outer, process), *by_length, noise * np.trace(outer)])
        return float(value), gradient


def _root(covariance: np.ndarray, scale: float) -> np.ndarray:
    """Lower triangular root (m, m) of a covariance, with as much jitter as it needs.

    scale : standard deviation of the values, in whose square jitter is stated
    """
    jitter = DRAW_JITTER * max(scale**2, float(np.diag(covariance).max()))
    for power in range(MAX_JITTERS):
        try:
            return cholesky(covariance + 10.0**power * jitter * np.eye(len(covariance)), lower=True)
        except np.linalg.LinAlgError:
            continue
    raise CalibError("the covariance of the emulator is not positive definite; its points may repeat")
