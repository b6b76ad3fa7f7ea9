"""Which effect the residuals point to: score tests that need no refit.

The residual e of the calibrated model, in units of the noise, is e = S theta + noise where an effect of size theta is
missing and S is its signature. What calibrated parameters and nuisances absorb is projected out of both. Then

    theta = A^-1 S' e,   A = S' S,   X2 = theta' A theta,   z = the normal deviate of the same probability

Noise whose memory is not quite what was taken would make z too large: the scores are summed over segments of the
records, with theta's own part taken out, and where their spread exceeds A, z is made smaller by it (Newey and West 1987
for the reasoning). The largest |z| that a sound model may show is found by drawing noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

DRAWS = 5000  # of the noise
QUANTILE = 0.99
CERTAIN = 3.0  # times its doubt: what is left of a signature that is less than that is none
ROUNDING = 1e-5  # share of a signature that is left by rounding where calibration absorbs it
RANK = 1e-7  # singular value, over the largest of the same column set, below which a direction is absorbed


class Projection:
    """What is left of a vector when some columns have been fitted to it."""

    def __init__(self, columns: np.ndarray):
        """Columns (N, k)."""
        size = np.linalg.norm(columns, axis=0)
        columns = columns[:, size > 0.0] / size[size > 0.0]
        self.basis = np.zeros((len(columns), 0))
        if columns.shape[1]:
            left, singular, _ = np.linalg.svd(columns, full_matrices=False)
            self.basis = left[:, singular > RANK * singular[0]]

    def __call__(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (N,) or (N, m) without the part in the span of the columns."""
        return vectors - self.basis @ (self.basis.T @ vectors)

    @property
    def rank(self) -> int:
        """Number of directions taken out."""
        return self.basis.shape[1]


@dataclass(frozen=True, eq=False)
class Signature:
    """Signature of a candidate, free of what calibration absorbs.

    Attributes
    ----------
    columns : (N, p) per unit of each free parameter, in units of the noise
    absorbed : share of the signature's length that calibration takes over, the least among the parameters  [1]
    """

    columns: np.ndarray
    absorbed: float

    @classmethod
    def of(cls, columns: np.ndarray, projection: Projection, doubt: np.ndarray) -> "Signature":
        """Project the columns (N, p), whose relative errors are doubt (p,): what is left has to be more than these."""
        left = projection(columns)
        whole = np.linalg.norm(columns, axis=0)
        share = np.divide(np.linalg.norm(left, axis=0), whole, out=np.zeros_like(whole), where=whole > 0.0)
        left = left * (share > np.maximum(CERTAIN * doubt, ROUNDING))
        absorbed = 1.0 - float(share.max(initial=0.0))
        return cls(left, absorbed if absorbed > ROUNDING else 0.0)


@dataclass(frozen=True, eq=False)
class Tested:
    """What a score test says.

    Attributes
    ----------
    z : normal deviate; of one parameter with the sign of its size over the direction that makes sense
    size, error : (p,) estimates and their standard errors  [units of the parameters]
    drop : by which the sum of squares would fall
    """

    z: float
    size: np.ndarray
    error: np.ndarray
    drop: float


def tested(residual: np.ndarray, signature: Signature, segments: np.ndarray) -> Tested:
    """Test one candidate.

    Parameters
    ----------
    residual : (N,) projected
    signature : projected
    segments : (N,) numbers of the segments whose scores are independent
    """
    scale = np.linalg.norm(signature.columns, axis=0)
    size, error = np.zeros(scale.size), np.full(scale.size, np.inf)
    alive = scale > 0.0
    if not alive.any():
        return Tested(0.0, size, error, 0.0)
    unit = signature.columns[:, alive] / scale[alive]
    form = _Form(_products(unit, unit, segments))
    theta, drop, wider = form.solved(_products(unit, residual[:, None], segments)[None, :, :, 0])
    size[alive] = theta[0] / scale[alive]
    error[alive] = np.sqrt(wider[0] * np.diag(form.inverse)) / scale[alive]
    sign = np.sign(theta[0, 0]) if alive.sum() == 1 else 1.0
    return Tested(float(sign * deviate(drop[0] / wider[0], form.rank)), size, error, float(drop[0]))


class _Form:
    """The products of unit columns, summed over segments.

    parts : (segment, p, p)
    """

    def __init__(self, parts: np.ndarray):
        self.parts = parts
        gram = parts.sum(axis=0)
        self.inverse = np.linalg.pinv(gram, rcond=1e-6, hermitian=True)
        self.rank = max(1, int(np.linalg.matrix_rank(gram, tol=1e-6, hermitian=True)))

    def solved(self, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimates (draw, p), fall of the sum of squares (draw,), and how much wider the noise is than white (draw,).

        scores : (draw, segment, p)
        """
        total = scores.sum(axis=1)
        theta = total @ self.inverse
        left = scores - np.einsum("bij,dj->dbi", self.parts, theta)
        spread = np.einsum("dbi,dbi->d", left @ self.inverse, left) / self.rank
        return theta, (theta * total).sum(axis=1), np.maximum(1.0, spread)


def _products(one: np.ndarray, other: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Products (segment, p, q) of the columns (N, p) and (N, q), summed over each segment."""
    order = np.argsort(segments, kind="stable")
    inner = np.split(order, np.searchsorted(segments[order], np.arange(1, int(segments.max()) + 1)))
    return np.array([one[own].T @ other[own] for own in inner])


def deviate(square: np.ndarray, freedom: int) -> np.ndarray:
    """Normal deviate of the same two-sided probability as a chi-square of `freedom` degrees, one by one."""
    square = np.maximum(0.0, square)
    if freedom == 1:
        return np.sqrt(square)
    log = stats.chi2.logsf(square, freedom)
    far = ~(log > -600.0)
    beyond = np.sqrt(np.maximum(0.0, square - (freedom - 1) * np.log(np.maximum(square, 2.0))))
    return np.where(far, beyond, stats.norm.isf(0.5 * np.exp(np.where(far, 0.0, log))))


def threshold(signatures: Sequence[Signature], segments: np.ndarray, seed: int, signs: Sequence[int]) -> float:
    """99 % quantile of the largest |z| of all candidates where nothing is missing.

    Noise is drawn, white in each segment, and tested as the residual is. Of a candidate whose size makes sense with one
    sign only, that sign alone counts.

    Parameters
    ----------
    signs : per candidate, 0 where both signs make sense, else the sign
    """
    rng = np.random.default_rng(seed)
    kept = [(signature.columns, sign) for signature, sign in zip(signatures, signs, strict=True)]
    kept = [(c[:, np.linalg.norm(c, axis=0) > 0.0], sign) for c, sign in kept]
    kept = [(c / np.linalg.norm(c, axis=0), sign) for c, sign in kept if c.shape[1]]
    if not kept:
        return float(stats.norm.isf(0.5 * (1.0 - QUANTILE)))
    whole = np.column_stack([c for c, _ in kept])
    parts = _products(whole, whole, segments)
    values, vectors = np.linalg.eigh(parts)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    drawn = np.einsum("bij,dbj->dbi", roots, rng.standard_normal((DRAWS, len(roots), roots.shape[-1])))
    largest, first = np.zeros(DRAWS), 0
    for columns, sign in kept:
        own = slice(first, first + columns.shape[1])
        first = own.stop
        form = _Form(parts[:, own, own])
        theta, drop, wider = form.solved(drawn[:, :, own])
        z = deviate(drop / wider, form.rank)
        if sign and columns.shape[1] == 1:
            z = np.where(theta[:, 0] * sign > 0.0, z, 0.0)
        largest = np.maximum(largest, z)
    return float(np.quantile(largest, QUANTILE))
