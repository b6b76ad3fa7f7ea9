"""Penalised least squares for the coefficients of free functions, with the weights of the penalties by REML.

    minimise |y - A c|^2 + w (r_1 |D_1 c|^2 + r_2 |D_2 c|^2 + ...) + |R c|^2

y and A are free of what calibrated parameters and nuisances absorb, D_j are second differences along one argument of
one function, and R is a weak prior that decides where the data do not. The weights w r_j maximise the restricted
likelihood (Wood, Generalized Additive Models, 2017, section 6.2.4; Wahba, Annals of Statistics 13 (1985) 1378), in
which the penalties are the inverse variances of a Gaussian prior of the coefficients, the unknown level of the noise in
common. A function may be as rough along one argument as it has to, and straight along the other (tensor product
smooths: Wood, Biometrics 62 (2006) 1025).

Some functions cannot be distinguished from calibrated parameters: a multiple of the displacement beside a calibrated
stiffness changes nothing that the stiffness does not. Linear functions of which calibration absorbs all but a share of
less than `MIN_LEFT_SHARE` are left to the prior, which makes the force as small as possible over the visited states: it
is then what the calibrated law does not express.

Others are determined badly: of one of which calibration leaves a tenth, the error is ten times as large. Where no
function is expected, beside a formula, the linear ones have a penalty of their own, their mean square over the visited
states less what calibration absorbs (the double penalty of Marra & Wood, Computational Statistics & Data Analysis 55
(2011) 2372): they are as small as the data let them be. The numbers of the formula are no functions: they have no
penalty, and none is taken for absorbed.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, cho_solve, eigh, null_space

MIN_LEFT_SHARE = 0.01  # of the length of a change that calibration has to leave, to determine a function by it  [1]
MIN_LINEAR_CHANGE = 1e-4  # length of a change over the largest one, of a linear function that is one  [1]
NULL_SPACE_TOLERANCE = 1e-9  # singular value over the largest, below which a function is not penalised  [1]
RELATIVE_JITTER = 1e-9  # of the largest eigenvalue, added where a matrix has to be positive definite  [1]
WEIGHT_DECADES = -8.0, 6.0, 57  # of the weights that are tried, over that of which both terms have the same trace
MAX_WEIGHT_ROUNDS = 4  # in which the weights are chosen one after the other  [count]


@dataclass(frozen=True, eq=False)
class Smoothing:
    """A linearised problem for the coefficients of free functions.

    Inside, coefficients are those of the columns of `frame`: rough functions, then linear ones, then the numbers of a
    formula, for which the matrices are well conditioned after scaling.

    Attributes
    ----------
    frame : (p, p) functions of which the others are composed, by their coefficients
    gram, moment : (p, p), (p,) A' A and A' y without the directions that calibration absorbs
    square : y' y
    freedom : number of residuals less that of calibrated parameters and nuisances
    penalties : of each argument of each function, (p, p) D_j' D_j, and that of linear functions beside a formula
    prior : (p, p) R' R
    absorbed : (p, q) linear functions that calibration absorbs, by their coefficients
    """

    frame: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    square: float
    freedom: float
    penalties: tuple[np.ndarray, ...]
    prior: np.ndarray
    absorbed: np.ndarray

    @classmethod
    def of(
        cls,
        columns: np.ndarray,
        projected: np.ndarray,
        target: np.ndarray,
        freedom: float,
        differences: Sequence[np.ndarray],
        prior: np.ndarray,
        beside: "BesideFormula | None" = None,
    ) -> "Smoothing":
        """Set the problem up.

        Parameters
        ----------
        columns : (N, p) changes of the data with the coefficients
        projected : (N, p) the same without what calibrated parameters and nuisances absorb
        target : (N,) y
        freedom : see above
        differences : D_j, (k, p) each; of functions beside a formula (k, m), the p - m last columns being changes with
            the numbers of the formula
        prior : (p, p) R' R
        beside : what is known of functions beside a formula; None: without one
        """
        count = differences[0].shape[1]
        known = None if beside is None else beside.absorbed
        linear = _linear(columns[:, :count], projected[:, :count], np.vstack(differences), known)
        frame = block_diag(np.column_stack([linear.rough, linear.functions]), np.eye(columns.shape[1] - count))
        absorbed, dual = (_lengthened(own, len(frame)) for own in (linear.absorbed, linear.dual))
        free = projected - (projected @ absorbed) @ dual.T
        turned, prior = free @ frame, frame.T @ prior @ frame
        penalties = [_penalty(own @ linear.rough, len(frame)) for own in differences]
        if beside is not None and linear.functions.shape[1] > linear.absorbed.shape[1]:
            penalties.append(_linear_penalty(linear, beside.visited, len(frame)))
        return cls(
            frame=frame,
            gram=turned.T @ turned,
            moment=turned.T @ target,
            square=float(target @ target),
            freedom=freedom,
            penalties=tuple(penalties),
            prior=prior + RELATIVE_JITTER * np.diag(prior).max() * np.eye(len(prior)),
            absorbed=absorbed,
        )

    def criterion(self, weight: float) -> float:
        """Minus twice the logarithm of the restricted likelihood, but for a constant."""
        return self._criterion(weight * self.roughness)

    def _criterion(self, penalty: np.ndarray) -> float:
        prior, posterior = _Scaled(penalty + self.prior), _Scaled(self.gram + penalty + self.prior)
        left = self.square - float(self.moment @ posterior.solved(self.moment))
        determinants = posterior.log_determinant - prior.log_determinant
        return self.freedom * float(np.log(max(left, 1e-300))) + determinants

    def _posterior(self, weight: float) -> "_Scaled":
        return _Scaled(self.gram + weight * self.roughness + self.prior)

    @cached_property
    def roughness(self) -> np.ndarray:
        """Sum of the penalties (p, p), each with its relative weight."""
        return self._sum(self.relative_weights)

    @cached_property
    def relative_weights(self) -> np.ndarray:
        """Weights of the penalties over their geometric mean, by the largest restricted likelihood.

        One after the other is chosen on its grid, the others held, from where all terms have the same trace.
        """
        if len(self.penalties) == 1:
            return np.ones(1)
        grids = [self._grid(own) for own in self.penalties]
        weights = min((np.array(one) for one in zip(*grids, strict=True)), key=self._criterion_at)
        for _ in range(MAX_WEIGHT_ROUNDS):
            before = weights
            for j, grid in enumerate(grids):
                weights = min((_replaced(weights, j, w) for w in grid), key=self._criterion_at)
            if np.array_equal(weights, before):
                break
        return weights / np.exp(np.mean(np.log(weights)))

    def _criterion_at(self, weights: np.ndarray) -> float:
        return self._criterion(self._sum(weights))

    def _sum(self, weights: np.ndarray) -> np.ndarray:
        return np.asarray(np.tensordot(weights, self.penalties, axes=1))

    @cached_property
    def weight(self) -> float:
        """Weight of their sum that maximises the restricted likelihood."""
        return float(self._weights[int(np.argmin([self.criterion(w) for w in self._weights]))])

    @cached_property
    def _weights(self) -> np.ndarray:
        """Weights of their sum that are tried, increasing."""
        return self._grid(self.roughness)

    def _grid(self, penalty: np.ndarray) -> np.ndarray:
        """Weights of a penalty that are tried, increasing."""
        unit = np.trace(self.gram) / max(float(np.trace(penalty)), 1e-300)
        low, high, number = WEIGHT_DECADES
        return max(unit, 1e-300) * np.logspace(low, high, int(number))

    def coefficients(self, weight: float, damping: float = 0.0, near: np.ndarray | None = None) -> np.ndarray:
        """Coefficients (p,) of the minimum, or between it and those `near` (p,) by the damping of Marquardt."""
        if damping == 0.0 or near is None:
            return self.frame @ self._posterior(weight).solved(self.moment)
        matrix = self.gram + weight * self.roughness + self.prior
        held = damping * np.diag(matrix)
        right = self.moment + held * np.linalg.solve(self.frame, near)
        return self.frame @ _Scaled(matrix + np.diag(held)).solved(right)

    def penalty(self, weight: float, coefficients: np.ndarray) -> float:
        """Value of the penalties at coefficients (p,)."""
        return float(np.sum((self.root(weight) @ coefficients) ** 2))

    def root(self, weight: float) -> np.ndarray:
        """Rows (p, p) whose squares sum up to the penalties: they augment the data of a least-squares problem."""
        return np.asarray(np.linalg.solve(self.frame.T, _Scaled(weight * self.roughness + self.prior).factor).T)

    def covariance(self, weight: float) -> np.ndarray:
        """Covariance (p, p) of the coefficients by noise of unit variance and the prior (Wahba; Wood, section 6.10)."""
        return self.frame @ self._posterior(weight).solved(self.frame.T)

    def errors(self, rows: np.ndarray, weight: float) -> np.ndarray:
        """Standard errors (n,) of rows (n, p) by the coefficients, by noise of unit variance and the prior."""
        return np.sqrt(np.maximum(0.0, np.sum((rows @ self.covariance(weight)) * rows, axis=1)))

    def weight_of(self, effective_parameters: float) -> float:
        """Least weight at which there are no more effective parameters than these, but for those of linear functions.

        Not less than `weight`.
        """
        if not np.isfinite(effective_parameters):
            return self.weight
        weights = self._weights[self._weights >= self.weight]
        most = self.effective_parameters(float(weights[-1])) + effective_parameters
        first = bisect_left(weights.tolist(), -most, key=lambda weight: -self.effective_parameters(weight))
        return float(weights[min(first, weights.size - 1)])

    def effective_parameters(self, weight: float) -> float:
        """Effective number of coefficients: trace of the influence of the data on them."""
        return float(np.trace(self._posterior(weight).solved(self.gram)))

    def gauge(self, visited: np.ndarray) -> np.ndarray:
        """Matrix (p, p) that takes from coefficients what calibration absorbs, over the visited states.

        visited : (n, p) basis functions there
        """
        functions = visited @ self.absorbed
        return np.eye(visited.shape[1]) - self.absorbed @ (np.linalg.pinv(functions) @ visited)


@dataclass(frozen=True, eq=False)
class BesideFormula:
    """What is known of functions beside a formula.

    Attributes
    ----------
    visited : (n, m) basis functions at the visited states
    absorbed : (m, q) linear functions that calibration absorbs, of the free function, by their coefficients
    """

    visited: np.ndarray
    absorbed: np.ndarray


class _Scaled:
    """A positive definite matrix, factorised with a unit diagonal."""

    def __init__(self, matrix: np.ndarray):
        self._scale = np.sqrt(np.diag(matrix))
        unit = matrix / np.multiply.outer(self._scale, self._scale)
        self._lower = np.linalg.cholesky(unit + RELATIVE_JITTER * np.eye(len(matrix)))

    @property
    def factor(self) -> np.ndarray:
        """Lower factor (p, p) of Cholesky."""
        return self._scale[:, None] * self._lower

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant."""
        return float(2.0 * np.sum(np.log(np.diag(self._lower) * self._scale)))

    def solved(self, right: np.ndarray) -> np.ndarray:
        """Solution for right-hand sides (p,) or (p, q)."""
        scale = self._scale if right.ndim == 1 else self._scale[:, None]
        return np.asarray(cho_solve((self._lower, True), right / scale) / scale)


@dataclass(frozen=True, eq=False)
class _LinearFunctions:
    """Functions that the penalty takes for smooth, and the others.

    Attributes
    ----------
    rough : (p, r) functions on which the penalty has an influence, by their coefficients
    functions : (p, s) linear functions
    absorbed : (p, q) those of them that calibration absorbs
    dual : (p, q) vectors whose products with these are unity
    """

    rough: np.ndarray
    functions: np.ndarray
    absorbed: np.ndarray
    dual: np.ndarray


def _replaced(values: np.ndarray, at: int, value: float) -> np.ndarray:
    return np.concatenate([values[:at], [value], values[at + 1 :]])


def _penalty(rows: np.ndarray, size: int) -> np.ndarray:
    """Squares (size, size) of rows (k, r) by the first coefficients."""
    penalty = np.zeros((size, size))
    penalty[: rows.shape[1], : rows.shape[1]] = rows.T @ rows
    return penalty


def _linear_penalty(linear: _LinearFunctions, visited: np.ndarray, size: int) -> np.ndarray:
    """Mean square (size, size) of the linear functions over visited states (n, p), less what calibration absorbs."""
    values, absorbed = visited @ linear.functions, visited @ linear.absorbed
    values = values - absorbed @ (np.linalg.pinv(absorbed) @ values)
    first = linear.rough.shape[1]
    own = slice(first, first + values.shape[1])
    penalty = np.zeros((size, size))
    penalty[own, own] = values.T @ values / len(values)
    return penalty


def _lengthened(columns: np.ndarray, size: int) -> np.ndarray:
    """Columns (p, q) with zeros for further coefficients (size, q)."""
    return np.pad(columns, ((0, size - len(columns)), (0, 0)))


def _linear(
    columns: np.ndarray, projected: np.ndarray, differences: np.ndarray, absorbed: np.ndarray | None = None
) -> _LinearFunctions:
    """Split functions by their smoothness, and linear ones by whether calibration absorbs them.

    Of two functions that are added, one constant less the other is none: it changes nothing, and is not absorbed.

    absorbed : (p, q) those that it absorbs; None: by what it leaves of them
    """
    _, size, turn = np.linalg.svd(differences)
    rank = int(np.sum(size > NULL_SPACE_TOLERANCE * size[0]))
    smooth = turn[rank:].T
    sizes, turned = eigh((columns @ smooth).T @ (columns @ smooth))
    idle = sizes <= MIN_LINEAR_CHANGE**2 * sizes[-1]
    moving = smooth @ turned[:, ~idle]
    one, other = columns @ moving, projected @ moving
    whole = one.T @ one
    if absorbed is None:
        squared_share, directions = eigh(other.T @ other, whole)
        inside = squared_share < MIN_LEFT_SHARE**2
        own, left = directions[:, inside], directions[:, ~inside]
    else:
        own = moving.T @ absorbed
        left = null_space(own.T @ whole)
        left = left @ eigh(left.T @ other.T @ other @ left, left.T @ whole @ left)[1]
    dual = np.linalg.solve(own.T @ whole @ own, own.T @ whole).T
    functions = np.column_stack([moving @ own, moving @ left, smooth @ turned[:, idle]])
    return _LinearFunctions(turn[:rank].T, functions, moving @ own, moving @ dual)
