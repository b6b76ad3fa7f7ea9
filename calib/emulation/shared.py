"""Emulator of a vector from few noiseless simulations: one covariance shared by all its components."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize
from sklearn.gaussian_process.kernels import Matern

from calib.emulation.gaussian_process import SMOOTHNESS, Emulated
from calib.emulation.trend import PRIOR_COEFFICIENT_STD, Trend, monomials_of_trend

SHARED_LENGTH_BOUNDS = (0.02, 1.0)  # of correlation lengths, edges of the cube: no parameter counts as without effect
PRIOR_LENGTH = 0.5  # median of the prior of a correlation length, edges of the cube  [1]
PRIOR_LOG_LENGTH_STD = 1.4  # standard deviation of its natural logarithm  [1]
INTERPOLATION_VARIANCE = 1e-8  # nugget, variances of the process: what keeps close points from being singular  [1]
MAX_LIKELIHOOD_STEPS = 40  # of one climb to the most probable lengths  [1]


@dataclass(frozen=True)
class SharedGaussianProcess:
    """Interpolating emulator whose components share correlation lengths and differ in variance.

    The covariance of component k is s_k^2 (Matern 5/2 + trend + nugget): a multi-output emulator (Conti & O'Hagan 2010,
    J. Stat. Plan. Inference 140, 640) of uncorrelated components. All together cost one factorisation.

    Parameters
    ----------
    points, values : (n, dim) of the unit cube, (n, components)
    trend : degree of the trend
    lengths : (dim,), edges of the cube
    log_density : logarithm of the posterior density of the lengths, up to a constant for these points
    """

    points: np.ndarray
    values: np.ndarray
    trend: Trend
    lengths: np.ndarray
    log_density: float
    _root: np.ndarray  # (n, n), lower Cholesky factor of the covariance
    _weights: np.ndarray  # (n, components), covariance^-1 values

    @property
    def scale(self) -> np.ndarray:
        """Standard deviation (components,) s_k of each component's process, in the units of the values."""
        return np.sqrt(np.maximum((self.values * self._weights).sum(axis=0), 0.0) / len(self.points))

    def mean(self, points: np.ndarray) -> np.ndarray:
        """Mean (m, components) at points (m, dim)."""
        return self._across(points) @ self._weights

    def predict(self, points: np.ndarray) -> Emulated:
        """Mean and standard deviation (m, components) at points (m, dim)."""
        across = self._across(points)
        own = 1.0 + PRIOR_COEFFICIENT_STD**2 * (monomials_of_trend(points, self.trend) ** 2).sum(axis=1)
        explained = (solve_triangular(self._root, across.T, lower=True) ** 2).sum(axis=0)
        return Emulated(across @ self._weights, np.sqrt(np.maximum(own - explained, 0.0))[:, None] * self.scale)

    def _across(self, points: np.ndarray) -> np.ndarray:
        return _matern(self.lengths)(points, self.points) + _trend(points, self.points, self.trend)

    def slope(self, point: np.ndarray) -> np.ndarray:
        """Derivative (components, dim) of the mean at a point (dim,), per edge of the cube."""
        offset = (point - self.points) / self.lengths
        distance = np.sqrt(5 * (offset**2).sum(axis=1))
        matern = (-5 / 3 * (1 + distance) * np.exp(-distance))[:, None] * offset / self.lengths
        slope = matern.T @ self._weights
        if self.trend is not Trend.CONSTANT:
            by_monomial = PRIOR_COEFFICIENT_STD**2 * monomials_of_trend(self.points, self.trend).T @ self._weights
            slope = slope + 2 * by_monomial[1 : 1 + point.size]  # a coordinate is taken as -1 to 1
        return slope.T

    def extended(self, points: np.ndarray, values: np.ndarray) -> Self:
        """The emulator with more points (k, dim) and values (k, components), lengths held."""
        points, values = np.vstack([self.points, points]), np.vstack([self.values, values])
        root = _root(_covariance(points, self.lengths, self.trend))
        return replace(self, points=points, values=values, _root=root, _weights=cho_solve((root, True), values))


def fit_shared(
    points: np.ndarray,
    values: np.ndarray,
    trend: Trend = Trend.LINEAR,
    start: np.ndarray | None = None,
    steps: int = MAX_LIKELIHOOD_STEPS,
) -> SharedGaussianProcess:
    """Emulator of values (n, components) at points (n, dim), of the most probable correlation lengths.

    The likelihood is that of one component with the covariance of all: components of a simulated curve are not so many
    witnesses. A prior keeps the lengths where few points say little of them.

    Parameters
    ----------
    points, values : (n, dim) of the unit cube, (n, components); finite
    trend : degree of the trend
    start : lengths (dim,) to begin from
    steps : towards the most probable lengths at most; with none, those of `start` are held
    """
    points, values = np.asarray(points, float), np.asarray(values, float)
    trend_part = _trend(points, points, trend) + INTERPOLATION_VARIANCE * np.eye(len(points))

    def cost(logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the log posterior density of the lengths, up to a constant, with its gradient (dim,)."""
        covariance, slopes = _matern(np.exp(logs))(points, eval_gradient=True)
        root = _root(covariance + trend_part)
        inverse = cho_solve((root, True), np.eye(len(points)))
        weights = inverse @ values
        energy = float((values * weights).sum()) + 1e-300
        deviation = (logs - np.log(PRIOR_LENGTH)) / PRIOR_LOG_LENGTH_STD
        outer = inverse - len(points) / energy * (weights @ weights.T)
        gradient = 0.5 * np.einsum("ij,ijk->k", outer, slopes) + deviation / PRIOR_LOG_LENGTH_STD
        level = 0.5 * len(points) * np.log(energy) + np.log(np.diag(root)).sum()
        return level + 0.5 * float(deviation @ deviation), gradient

    logs = np.log(np.full(points.shape[1], PRIOR_LENGTH) if start is None else start)
    if steps and values.any():
        bounds = [tuple(np.log(SHARED_LENGTH_BOUNDS))] * logs.size
        options = {"maxiter": steps}
        logs = minimize(cost, logs, method="L-BFGS-B", jac=True, bounds=bounds, options=options).x
    lengths = np.exp(logs)
    root = _root(_covariance(points, lengths, trend))
    weights = cho_solve((root, True), values)
    return SharedGaussianProcess(points, values, trend, lengths, -cost(logs)[0], root, weights)


def _matern(lengths: np.ndarray) -> Any:
    return Matern(lengths, SHARED_LENGTH_BOUNDS, nu=SMOOTHNESS)


def _trend(points: np.ndarray, others: np.ndarray, trend: Trend) -> np.ndarray:
    return PRIOR_COEFFICIENT_STD**2 * (monomials_of_trend(points, trend) @ monomials_of_trend(others, trend).T)


def _covariance(points: np.ndarray, lengths: np.ndarray, trend: Trend) -> np.ndarray:
    nugget = INTERPOLATION_VARIANCE * np.eye(len(points))
    return _matern(lengths)(points) + _trend(points, points, trend) + nugget


def _root(covariance: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor (n, n); a covariance that rounding has made indefinite gets as much nugget as it needs."""
    nugget = 0.0
    while True:
        try:
            return cholesky(covariance + nugget * np.eye(len(covariance)), lower=True)
        except np.linalg.LinAlgError:
            nugget = max(10 * nugget, INTERPOLATION_VARIANCE)
