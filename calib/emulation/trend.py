"""A polynomial trend with a vague prior as a covariance function of scikit-learn.

The sum of a stationary process and of a polynomial whose coefficients have a wide normal prior is universal kriging in
the limit of that width (Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, sec. 2.7).
"""

from enum import Enum
from typing import Any

import numpy as np
from sklearn.gaussian_process.kernels import Kernel

PRIOR_COEFFICIENT_STD = 10.0  # of a trend's coefficients, in standard deviations of the values  [1]


class Trend(Enum):
    """Degree of the polynomial about which an emulated quantity varies."""

    CONSTANT = 0
    LINEAR = 1
    QUADRATIC = 2


def monomials_of_trend(points: np.ndarray, trend: Trend) -> np.ndarray:
    """Monomials (n, terms) of points (n, dim) of the unit cube, each coordinate taken as -1 to 1."""
    z = 2 * np.asarray(points, dtype=float) - 1
    columns = [np.ones((len(z), 1))]
    if trend is not Trend.CONSTANT:
        columns.append(z)
    if trend is Trend.QUADRATIC:
        i, j = np.triu_indices(z.shape[1])
        columns.append(z[:, i] * z[:, j])
    return np.hstack(columns)


class PolynomialTrend(Kernel):
    """Covariance of a polynomial with independent normal coefficients; it has no hyperparameter.

    Parameters
    ----------
    trend : degree of the polynomial
    """

    def __init__(self, trend: Trend = Trend.LINEAR) -> None:
        self.trend = trend

    def __call__(self, X: np.ndarray, Y: np.ndarray | None = None, eval_gradient: bool = False) -> Any:  # noqa: N803
        """Covariance (n, m) of points X (n, dim) and Y (m, dim); with its empty gradient (n, n, 0) on request."""
        left = monomials_of_trend(X, self.trend)
        right = left if Y is None else monomials_of_trend(Y, self.trend)
        covariance = PRIOR_COEFFICIENT_STD**2 * (left @ right.T)
        return (covariance, np.empty((*covariance.shape, 0))) if eval_gradient else covariance

    def diag(self, X: np.ndarray) -> np.ndarray:  # noqa: N803
        """Variance (n,) at points X (n, dim)."""
        return PRIOR_COEFFICIENT_STD**2 * (monomials_of_trend(X, self.trend) ** 2).sum(axis=1)

    def is_stationary(self) -> bool:
        """Whether it depends on differences of points alone: it does not."""
        return False
