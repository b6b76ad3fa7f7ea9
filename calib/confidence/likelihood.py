"""The likelihood ratio of parameter values, adjusted to noise that is neither white nor of a stated size.

A sum of squares of residuals is a log-likelihood only where the residuals are independent and of known variance.
Elsewhere it is adjusted as an independence log-likelihood is (vertical adjustment: R. E. Chandler, S. Bate, Inference
for clustered data using the independence loglikelihood, Biometrika 94 (2007) 167-183): the excess of the sum of squares
over its minimum is scaled, in each direction from it, by the ratio of the curvature that the robust covariance implies
to the curvature of the sum of squares. Where that is a parabola, the ratio is the quadratic form of the robust
covariance (`calib.confidence.covariance`) exactly, and the interval it gives is the local one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from calib.confidence.covariance import pooled_noise
from calib.confidence.local import INTERVAL_QUANTILE, Linearised

LEVEL = 2.0 * INTERVAL_QUANTILE - 1.0  # probability of an interval of 2 standard errors  [1]
MIN_NOISE_VARIANCE = 1e-24  # of a residual, in units of the scale of its feature: an exact fit has no noise  [1]


@dataclass(frozen=True, eq=False)
class AdjustedLikelihood:
    """Likelihood ratio against the best point.

    Attributes
    ----------
    square : sum of squares of the residuals at the best point, the least there is
    unit_covariance : (dim, dim) of the estimate under white noise of unit variance, in the unit cube
    covariance : (dim, dim) under the noise as it is
    degrees_of_freedom : (dim,) of its variances
    differentiable : whether both are those of the estimate; else they say only how large the noise is
    """

    square: float
    unit_covariance: np.ndarray
    covariance: np.ndarray
    degrees_of_freedom: np.ndarray
    differentiable: bool = True

    @classmethod
    def of(cls, linearised: Linearised) -> "AdjustedLikelihood":
        """Likelihood about the point at which the residuals were linearised."""
        return cls(
            float(linearised.residuals @ linearised.residuals),
            linearised.unit_covariance,
            linearised.covariance,
            linearised.degrees_of_freedom,
        )

    @classmethod
    def without_derivatives(cls, residuals: np.ndarray, blocks: np.ndarray, dim: int) -> "AdjustedLikelihood":
        """Likelihood about a point whose residuals (m,), in blocks (m,), have no derivatives by `dim` parameters."""
        variance, freedom = pooled_noise(residuals, blocks, dim)
        return cls(float(residuals @ residuals), np.eye(dim), variance * np.eye(dim), np.full(dim, freedom), False)

    def factor(self, axes: Sequence[int], shift: np.ndarray) -> float:
        """Likelihood ratio over the excess of the sum of squares, in the direction `shift` (k,) of the axes (k,)."""
        own = np.ix_(axes, axes)
        curvature = shift @ np.linalg.solve(self.unit_covariance[own], shift)
        robust = shift @ np.linalg.solve(self.robust_covariance[own], shift)
        return float(robust / curvature)

    def ratio(self, square: float, axes: Sequence[int], shift: np.ndarray) -> float:
        """Twice the difference of the adjusted log-likelihood from the best point, the other parameters fitted.

        Parameters
        ----------
        square : least sum of squares of the residuals where the axes are held
        axes : (k,) that are held
        shift : (k,) of them from the best point, in the unit cube; not zero
        """
        return (square - self.square) * self.factor(axes, shift) if math.isfinite(square) else math.inf

    def quantile(self, axes: Sequence[int]) -> float:
        """Quantile of the likelihood ratio over k axes at `LEVEL`: of chi-square, or of F where the noise is estimated.

        Of one axis it is the square of Student's t, as in the local interval.
        """
        freedom = float(self.degrees_of_freedom[list(axes)].min())
        return float(len(axes) * scipy.stats.f.ppf(LEVEL, len(axes), freedom))

    @property
    def standard_error(self) -> np.ndarray:
        """Standard errors (dim,) in the unit cube; meaningless where `differentiable` is false."""
        return np.sqrt(np.diag(self.robust_covariance))

    @property
    def robust_covariance(self) -> np.ndarray:
        """Covariance (dim, dim), not singular where the fit is exact."""
        return self.covariance + MIN_NOISE_VARIANCE * self.unit_covariance
