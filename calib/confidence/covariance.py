"""The covariance of the best point, from the residuals there and their derivatives.

The residual vector r(u) is linearised about the best point u of the unit cube, r(u + d) = r + J d, so that noise n in
the residuals moves the best point by d = -J^+ n and the covariance of the estimate is the sandwich
J^+ Sigma J^+^T. Sigma is not assumed to be a multiple of the unit matrix:

1. Each block (one term, record, body, channel) has its own noise level and its own autocovariance, both estimated from
   its residuals (block-wise stationary noise; lag window and its width: Politis 2003).
2. Where Newey and West's estimate (1987; White's, 1980, when the residuals are white), which asks for no stationarity,
   gives a larger standard error, the larger one is taken: so misfit counts where the residuals are sensitive.
3. Residuals of a fit are smaller than the noise; each block is scaled so that its expected sum of squares is the
   observed one. Few degrees of freedom widen the interval through Student's t (Satterthwaite 1946 over the blocks).
4. Blocks are taken as independent, unless `noise_draws` show how the noise of one channel correlates several of them:
   then each variance is corrected by the ratio that they give.
5. The distance from the point to the minimum of the linearised problem in the window is added in quadrature: a search
   that stopped early has wider intervals. `calib.confidence.local` says when it has none.
"""

import math

import numpy as np
from scipy.optimize import lsq_linear

MIN_BLOCK_SIZE = 8  # residuals: smaller blocks share a noise level with others of their term  [count]
MIN_LEVEL_SIZE = 3  # residuals that determine a noise level at all  [count]
MIN_SINGULAR_RATIO = 1e-9  # of the largest singular value: smaller ones are raised to it  [1]
MIN_FREE_SHARE = 0.05  # of a block's residuals that the fit leaves  [1]: bounds the correction for what it absorbs
MIN_VARIANCE_RATIO = 0.25  # of a variance with the blocks correlated to that without, at least  [1]
MIN_DENSITY_RATIO = 1e-3  # of a spectral density to the variance, to which negative estimates are raised  [1]
STEP_RANK_TOLERANCE = 1e-6  # singular value over the largest, below which a direction is not moved  [1]
MAX_LEVERAGE = 0.99  # of one residual: where it is 1 the fit leaves no residual  [1]


def sandwich(
    jacobian: np.ndarray, residuals: np.ndarray, blocks: np.ndarray, noise_draws: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Robust covariance (dim, dim) of a least-squares estimate and the degrees of freedom (dim,) of its variances.

    jacobian (m, dim) and residuals (m,) at the minimum, blocks (m,): numbers of the blocks, noise_draws (number, m)
    or None. Sources: module docstring.
    """
    if not jacobian.any():  # no residual depends on any parameter
        return np.eye(jacobian.shape[1]) / MIN_SINGULAR_RATIO**2, np.ones(jacobian.shape[1])
    left, turn = _decomposed(jacobian)  # estimate = -turn @ left.T @ residuals
    leverage = np.minimum(np.sum(left**2, axis=1), MAX_LEVERAGE)

    parts = [np.flatnonzero(members) for members in _members(blocks)]
    models = [_autocovariance(residuals[i]) for i in parts]
    meats = [_toeplitz_form(left[i], gamma) for i, (gamma, _) in zip(parts, models, strict=True)]
    grams = [left[i].T @ left[i] for i in parts]
    factors = np.ones(len(parts))
    for _ in range(3):  # expected against observed sum of squares, block by block; converges at once
        total = sum(c * meat for c, meat in zip(factors, meats, strict=True))
        for b, (i, (gamma, _)) in enumerate(zip(parts, models, strict=True)):
            own = i.size * gamma[0] - 2.0 * np.trace(meats[b])  # tr Sigma - 2 tr (P Sigma), per unit factor
            others = np.trace(grams[b] @ total) - factors[b] * np.trace(grams[b] @ meats[b])  # tr (P Sigma P), theirs
            own += np.trace(grams[b] @ meats[b])
            observed = residuals[i] @ residuals[i]
            factors[b] = (
                max(1.0, (observed - others) / max(own, MIN_FREE_SHARE * i.size * gamma[0])) if gamma[0] > 0.0 else 1.0
            )

    spread = np.array([c * np.diag(turn @ meat @ turn.T) for c, meat in zip(factors, meats, strict=True)])
    covariance = turn @ sum(c * meat for c, meat in zip(factors, meats, strict=True)) @ turn.T
    local_form = sum(
        _score_form(left[i] * (residuals[i] / np.sqrt(1.0 - leverage[i]))[:, None], lag)
        for i, (_, lag) in zip(parts, models, strict=True)
    )
    variance = np.maximum(np.diag(covariance), 1e-300)
    widen = np.sqrt(np.maximum(1.0, np.diag(turn @ local_form @ turn.T) / variance))
    if noise_draws is not None and len(parts) > 1 and len(noise_draws) > 1:
        moves = [noise_draws[:, i] @ left[i] @ turn.T for i in parts]
        independent = sum(np.var(move, axis=0) for move in moves)
        ratio = np.var(sum(moves), axis=0) / np.maximum(independent, 1e-300)
        widen *= np.sqrt(np.clip(ratio, MIN_VARIANCE_RATIO, len(parts)))
    own_freedom = np.array(
        [
            max(1.0, i.size * gamma[0] ** 2 / max(2.0 * gamma @ gamma - gamma[0] ** 2, 1e-300) - leverage[i].sum())
            for i, (gamma, _) in zip(parts, models, strict=True)
        ]
    )
    total_spread = np.maximum(spread.sum(axis=0), 1e-300)
    freedom = total_spread**2 / np.maximum((spread**2 / own_freedom[:, None]).sum(axis=0), 1e-300)
    return covariance * np.outer(widen, widen), np.maximum(freedom, 1.0)


def unit_covariance(jacobian: np.ndarray) -> np.ndarray:
    """Covariance (dim, dim) of a least-squares estimate under white noise of unit variance, regularised as `sandwich`.

    jacobian (m, dim) of the residuals.
    """
    if not jacobian.any():
        return np.eye(jacobian.shape[1]) / MIN_SINGULAR_RATIO**2
    _, turn = _decomposed(jacobian)
    return turn @ turn.T


def pooled_noise(residuals: np.ndarray, blocks: np.ndarray, dim: int) -> tuple[float, float]:
    """Variance of the noise per residual and its degrees of freedom, where no Jacobian says what the noise moves.

    The largest spectral density of each block's residuals takes the place of their variance, so that no direction of
    the parameters, whatever its spectrum, has a smaller error than stated; residuals (m,), blocks (m,), `dim`
    parameters were fitted.
    """
    level = freedom = 0.0
    for i in (np.flatnonzero(members) for members in _members(blocks)):
        gamma, _ = _autocovariance(residuals[i])
        density = np.fft.fft(np.concatenate([gamma, gamma[:0:-1]])).real
        level += i.size * max(float(density.max()), float(gamma[0]))
        freedom += i.size * gamma[0] ** 2 / max(2.0 * gamma @ gamma - gamma[0] ** 2, 1e-300)
    return level / max(residuals.size - dim, 1), max(freedom - dim, 1.0)


def _decomposed(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left singular vectors (m, k) of the scaled Jacobian, and what turns noise along them into parameters (dim, k)."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = MIN_SINGULAR_RATIO * scale.max()
    left, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    singular = np.maximum(singular, MIN_SINGULAR_RATIO * singular[0])
    return left, (right.T / singular) / scale[:, None]


def _members(blocks: np.ndarray) -> list[np.ndarray]:
    """Masks (m,) of the blocks; those that do not determine a noise level are joined."""
    masks = [blocks == b for b in np.unique(blocks)]
    short = [mask for mask in masks if mask.sum() < MIN_LEVEL_SIZE]
    return [mask for mask in masks if mask.sum() >= MIN_LEVEL_SIZE] + ([np.any(short, axis=0)] if short else [])


def _autocovariance(residuals: np.ndarray) -> tuple[np.ndarray, int]:
    """Tapered autocovariance (n,) of one block and the last lag that counts, by the flat-top rule of Politis (2003)."""
    n = residuals.size
    size = 1 << (2 * n - 1).bit_length()
    raw = np.fft.irfft(np.abs(np.fft.rfft(residuals, size)) ** 2, size)[:n] / n
    if raw[0] <= 0.0 or n < 2 * MIN_BLOCK_SIZE:
        return np.concatenate([raw[:1], np.zeros(n - 1)]), 0
    small = np.abs(raw / raw[0]) < 2.0 * math.sqrt(math.log10(n) / n)
    run = max(5, math.ceil(math.sqrt(math.log10(n))))
    quiet = next((m for m in range(n - run) if small[m + 1 : m + 1 + run].all()), n // 4)
    lag = min(2 * quiet, n // 2)
    taper = np.clip(2.0 - 2.0 * np.arange(n) / lag, 0.0, 1.0) if lag else (np.arange(n) == 0).astype(float)
    return raw * taper, lag


def _toeplitz_form(left: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Return left.T @ toeplitz(gamma) @ left, negative spectral densities raised to a small positive one."""
    n = gamma.size
    size = 1 << (2 * n - 1).bit_length()
    symmetric = np.zeros(size)
    symmetric[:n] = gamma
    symmetric[size - n + 1 :] = gamma[:0:-1]
    density = np.maximum(np.fft.fft(symmetric).real, MIN_DENSITY_RATIO * gamma[0])
    spectrum = np.fft.fft(left, size, axis=0)
    return np.real(spectrum.conj().T @ (density[:, None] * spectrum)) / size


def _score_form(scores: np.ndarray, lag: int) -> np.ndarray:
    """Sum of the autocovariances of the scores (n, dim) with Bartlett weights up to `lag` (Newey and West 1987)."""
    return _toeplitz_form(scores, np.clip(1.0 - np.arange(len(scores)) / (lag + 1.0), 0.0, 1.0))


def distance_to_minimum(jacobian: np.ndarray, residuals: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Step (dim,) from a point (dim,) of the unit cube to the minimum of the linearised problem in the cube."""
    left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    kept = singular > STEP_RANK_TOLERANCE * singular[0]
    if not kept.any():
        return np.zeros(u.size)
    bounds = (-u, 1.0 - u)
    step = lsq_linear(singular[kept, None] * right[kept], -(left[:, kept].T @ residuals), bounds, method="bvls").x
    return np.asarray(step, dtype=float)
