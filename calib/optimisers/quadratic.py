"""Quadratic models of a scalar cost, fitted to scattered points and minimised in a box."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize


@dataclass(frozen=True)
class Quadratic:
    """A quadratic about some point: level (), gradient (dim,) and hessian (dim, dim) there."""

    level: float
    gradient: np.ndarray
    hessian: np.ndarray

    def __call__(self, z: np.ndarray) -> float:
        """Value at an offset z (dim,): level + gradient z + z hessian z / 2."""
        return self.level + self.gradient @ z + 0.5 * z @ self.hessian @ z

    def lowest(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Offset (dim,) where the model is least in the box low..high, searched from the box's point nearest zero."""
        result = minimize(
            lambda z: (self(z), self.gradient + self.hessian @ z),
            np.clip(0.0, low, high),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low, high, strict=True)),
        )
        return np.clip(result.x, low, high)


def monomials(z: np.ndarray) -> np.ndarray:
    """Columns 1, z_i, and z_i z_j scaled so that their coefficients' norm is the Frobenius norm of the hessian.

    Parameters
    ----------
    z : (n, dim)

    Returns
    -------
    (n, 1 + dim + dim (dim + 1) / 2)
    """
    i, j = np.triu_indices(z.shape[1])
    return np.hstack([np.ones((len(z), 1)), z, z[:, i] * z[:, j] * np.where(i == j, 0.5, np.sqrt(0.5))])


def pack(hessian: np.ndarray) -> np.ndarray:
    """Coefficients of the second-order columns of `monomials` that make up a hessian (dim, dim)."""
    i, j = np.triu_indices(len(hessian))
    return hessian[i, j] * np.where(i == j, 1.0, np.sqrt(2.0))


def unpack(coefficients: np.ndarray, dim: int) -> Quadratic:
    """The model with the given coefficients of `monomials`."""
    i, j = np.triu_indices(dim)
    hessian = np.empty((dim, dim))
    hessian[i, j] = hessian[j, i] = coefficients[1 + dim :] * np.where(i == j, 1.0, np.sqrt(0.5))
    return Quadratic(coefficients[0], coefficients[1 : 1 + dim], hessian)


def nearest_model(
    z: np.ndarray, values: np.ndarray, weights: np.ndarray, hessian: np.ndarray, stiffness: float
) -> Quadratic:
    """Weighted least-squares quadratic whose hessian keeps close to a given one.

    With fewer points than coefficients and little stiffness this is the interpolant whose hessian changes least in
    the Frobenius norm (Powell 2004, Math. Program. 100, 183, eq. 1.3); with more it is a regression.

    Parameters
    ----------
    z, values, weights : (n, dim), (n,), (n,)
    hessian : (dim, dim), the one to keep close to
    stiffness : float, what a squared unit of change of the hessian costs, in squared units of value
    """
    dim = z.shape[1]
    columns, root = monomials(z), np.sqrt(weights)
    guess = np.concatenate([np.zeros(1 + dim), pack(hessian)])
    hold = np.sqrt(stiffness) * np.eye(len(guess))[1 + dim :]
    lhs = np.vstack([columns * root[:, None], hold])
    rhs = np.concatenate([(values - columns @ guess) * root, np.zeros(len(hold))])
    return unpack(guess + np.linalg.lstsq(lhs, rhs, rcond=None)[0], dim)
