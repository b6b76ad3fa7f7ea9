"""Score tests: which effect the residuals indicate, without a refit.

The residual e of the calibrated model, in units of the noise, is e = S theta + noise where an effect of size theta is
missing and S is its signature. What calibrated parameters and nuisances absorb is projected out of both. Then

    theta = A^-1 S' e,   A = S' S,   X2 = theta' A theta,   z = the normal deviate of the same probability

Noise whose autocorrelation departs from the assumed one would make z too large: the scores are summed over segments of
the records, with theta's own part removed, and where their spread exceeds A, z is reduced by it (Newey and West
1987 for the reasoning). The largest |z| that a complete model may show is estimated by drawing noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.special import ndtri

from calib.confidence.covariance import sandwich
from calib.diagnosis.criteria import CRITERIA

THRESHOLD_DRAWS = 5000  # of which the threshold is a quantile  [count]
MIN_ERROR_RATIO = 3.0  # of what calibration leaves of a signature over its error: less counts as zero  [1]
ROUNDING_SHARE = 1e-5  # of a signature that is left by rounding where calibration absorbs it  [1]
GRAM_RANK_TOLERANCE = 1e-6  # least eigenvalue that counts, of normal equations of columns of unit length  [1]
MIN_LOG_PROBABILITY = -600.0  # below it a tail probability underflows, and its asymptote is used  [1]
ABSORPTION_RANK_TOLERANCE = 1e-7  # singular value over the largest, below which a direction is not absorbed  [1]


class Projection:
    """Projection of vectors onto the complement of the span of some columns."""

    def __init__(self, columns: np.ndarray):
        """Columns (N, k)."""
        size = np.linalg.norm(columns, axis=0)
        columns = columns[:, size > 0.0] / size[size > 0.0]
        self.basis = np.zeros((len(columns), 0))
        if columns.shape[1]:
            left, singular, _ = np.linalg.svd(columns, full_matrices=False)
            self.basis = left[:, singular > ABSORPTION_RANK_TOLERANCE * singular[0]]

    def __call__(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (N,) or (N, m) without the part in the span of the columns."""
        return vectors - self.basis @ (self.basis.T @ vectors)

    @property
    def rank(self) -> int:
        """Number of directions that are projected out."""
        return self.basis.shape[1]


def variance_along(direction: np.ndarray, residual: np.ndarray, rows: np.ndarray) -> float:
    """Variance along a unit vector (N,) of what a model leaves, over the noise's; at least 1  [1].

    It is estimated as for the standard errors: the residual has an autocorrelation of its own. Its component along the
    vector itself does not count, for that may be the effect in question.

    Parameters
    ----------
    residual : (N,) in units of the noise
    rows : (N,) number of the row that each belongs to
    """
    residual = residual - direction * (direction @ residual)
    counted = (residual != 0.0) | (direction != 0.0)
    covariance, _ = sandwich(direction[counted, None], residual[counted], rows[counted])
    return max(1.0, float(covariance[0, 0]))


@dataclass(frozen=True, eq=False)
class Signature:
    """Signature of a candidate, free of what calibration absorbs.

    Attributes
    ----------
    columns : (N, p) per unit of each free parameter, in units of the noise
    absorbed : share of the signature's length that calibration absorbs, the least among the parameters  [1]
    """

    columns: np.ndarray
    absorbed: float

    @classmethod
    def of(cls, columns: np.ndarray, projection: Projection, relative_error: np.ndarray) -> "Signature":
        """Project the columns (N, p), of these relative errors (p,): what is left has to be more than its error."""
        projected = projection(columns)
        whole = np.linalg.norm(columns, axis=0)
        share = np.divide(np.linalg.norm(projected, axis=0), whole, out=np.zeros_like(whole), where=whole > 0.0)
        projected = projected * (share > np.maximum(MIN_ERROR_RATIO * relative_error, ROUNDING_SHARE))
        absorbed = 1.0 - float(share.max(initial=0.0))
        return cls(projected, absorbed if absorbed > ROUNDING_SHARE else 0.0)


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """A score test.

    Attributes
    ----------
    z : normal deviate; of one parameter with the sign of its size
    size, error : (p,) estimates and their standard errors  [units of the parameters]
    chi2_reduction : predicted  [1]
    """

    z: float
    size: np.ndarray
    error: np.ndarray
    chi2_reduction: float


def score_test(residual: np.ndarray, signature: Signature, segments: np.ndarray) -> ScoreTest:
    """Test one candidate.

    Parameters
    ----------
    residual : (N,) projected
    signature : projected
    segments : (N,) numbers of the segments whose scores are independent
    """
    scale = np.linalg.norm(signature.columns, axis=0)
    size, error = np.zeros(scale.size), np.full(scale.size, np.inf)
    nonzero = scale > 0.0
    if not nonzero.any():
        return ScoreTest(0.0, size, error, 0.0)
    unit = signature.columns[:, nonzero] / scale[nonzero]
    equations = _NormalEquations(_products(unit, unit, segments))
    theta, reduction, inflation = equations.solved(_products(unit, residual[:, None], segments))
    size[nonzero] = theta[:, 0] / scale[nonzero]
    error[nonzero] = np.sqrt(inflation[0] * np.diag(equations.inverse)) / scale[nonzero]
    sign = np.sign(theta[0, 0]) if nonzero.sum() == 1 else 1.0
    z = float(sign * deviate(reduction[0] / inflation[0], equations.rank))
    return ScoreTest(z, size, error, float(reduction[0]))


class _NormalEquations:
    """The products of unit columns, summed over segments.

    parts : (segment, p, p)
    """

    def __init__(self, parts: np.ndarray):
        self.parts = parts
        gram = parts.sum(axis=0)
        self.inverse = np.linalg.pinv(gram, rcond=GRAM_RANK_TOLERANCE, hermitian=True)
        self.rank = max(1, int(np.linalg.matrix_rank(gram, tol=GRAM_RANK_TOLERANCE, hermitian=True)))

    def solved(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimates (p, draw), reduction of chi-square (draw,), inflation of variance by autocorrelation (draw,).

        scores : (segment, p, draw)
        """
        total = scores.sum(axis=0)
        theta = self.inverse @ total
        residual = scores - self.parts @ theta
        spread = ((self.inverse @ residual) * residual).sum(axis=(0, 1)) / self.rank
        return theta, (theta * total).sum(axis=0), np.maximum(1.0, spread)


def _products(one: np.ndarray, other: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Products (segment, p, q) of the columns (N, p) and (N, q), summed over each segment."""
    order = np.argsort(segments, kind="stable")
    inner = np.split(order, np.searchsorted(segments[order], np.arange(1, int(segments.max()) + 1)))
    return np.array([one[own].T @ other[own] for own in inner])


def deviate(chi2: np.ndarray | float, freedom: int) -> np.ndarray:
    """Normal deviate of the same two-sided probability as a chi-square of `freedom` degrees, elementwise."""
    square = np.asarray(np.maximum(0.0, chi2))
    if freedom == 1:
        return np.sqrt(square)
    log = scipy.stats.chi2.logsf(square, freedom)
    underflows = ~(log > MIN_LOG_PROBABILITY)
    asymptotic = np.sqrt(np.maximum(0.0, square - (freedom - 1) * np.log(np.maximum(square, 2.0))))
    return np.where(underflows, asymptotic, -ndtri(0.5 * np.exp(np.where(underflows, 0.0, log))))


def threshold(signatures: Sequence[Signature], segments: np.ndarray, seed: int, signs: Sequence[int]) -> float:
    """99 % quantile of the largest |z| of all candidates under noise alone.

    Noise is drawn, white in each segment, and tested as the residual is. Of a candidate whose size has one admissible
    sign, that sign alone counts.

    Parameters
    ----------
    signs : per candidate, 0 where both signs are admissible, else the sign
    """
    bases = [(_orthonormal(signature.columns), sign) for signature, sign in zip(signatures, signs, strict=True)]
    bases = [(basis, sign) for basis, sign in bases if basis.shape[1]]
    if not bases:
        return float(-ndtri(0.5 * (1.0 - CRITERIA.threshold_quantile)))
    ranks = np.array([basis.shape[1] for basis, _ in bases])
    whole = np.column_stack([basis for basis, _ in bases])
    parts = _products(whole, whole, segments)
    total, spread = _drawn_scores(parts, np.repeat(np.arange(ranks.size), ranks), seed)
    largest, first = np.zeros(THRESHOLD_DRAWS), 0
    for rank, (_, sign) in zip(ranks, bases, strict=True):
        own = slice(first, first + rank)
        first = own.stop
        inflation = np.maximum(1.0, spread[own].sum(axis=0) / rank)
        z = deviate((total[own] ** 2).sum(axis=0) / inflation, rank)
        if sign and rank == 1:
            z = np.where(total[own][0] * sign > 0.0, z, 0.0)
        largest = np.maximum(largest, z)
    return float(np.quantile(largest, CRITERIA.threshold_quantile))


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (N, rank) of the span of columns (N, p); of a single one in its direction."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0.0] / size[size > 0.0]
    if unit.shape[1] < 2:
        return unit
    values, vectors = np.linalg.eigh(unit.T @ unit)
    counted = values > GRAM_RANK_TOLERANCE * values[-1]
    return unit @ (vectors[:, counted] / np.sqrt(values[counted]))


def _drawn_scores(parts: np.ndarray, candidate: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw the scores of white noise along columns that are orthonormal within each candidate.

    The squares of what a candidate's estimate leaves of the scores of each segment are summed while they are drawn. In
    single precision: its rounding is far below the error of a quantile of so many draws.

    Parameters
    ----------
    parts : (segment, m, m) products of the columns, summed over each segment
    candidate : (m,) number of the candidate that each column belongs to

    Returns
    -------
    total : (m, draw) sums of the scores over all segments
    spread : (m, draw) sums of squares over the segments of the scores without the estimate's own part
    """
    rng = np.random.default_rng(seed)
    own = np.where(candidate[:, None] == candidate, parts, 0.0).astype(np.float32)
    values, vectors = np.linalg.eigh(parts)
    negligible = GRAM_RANK_TOLERANCE / len(parts)
    total, squares, cross = np.zeros((3, candidate.size, THRESHOLD_DRAWS), dtype=np.float32)
    for part, variances, directions in zip(own, values, vectors, strict=True):
        drawn = variances > negligible
        root = (directions[:, drawn] * np.sqrt(variances[drawn])).astype(np.float32)
        scores = root @ rng.standard_normal((root.shape[1], THRESHOLD_DRAWS), dtype=np.float32)
        total += scores
        cross += part @ scores
        squares += scores * scores
    return total, squares - total * (2.0 * cross - (own @ own).sum(axis=0) @ total)
