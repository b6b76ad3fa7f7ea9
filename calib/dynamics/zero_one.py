"""The 0-1 test: whether a series is chaotic, from the series alone."""

import math

import numpy as np

from calib.errors import CalibError

TEST_FREQUENCIES = 100  # values of c whose median is taken: some of them resonate with a regular series
FREQUENCY_PARTS = 10  # that they are taken in: what stays in the processor's cache is done sooner
MIN_SERIES_POINTS = 100  # points of a series
GOLDEN_RATIO = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples fill an interval evenly


def zero_one(series: np.ndarray) -> float:
    """K of a series (n,): about 1 where it is chaotic, about 0 where it is periodic or quasi-periodic  [1].

    The series drives a point of the plane, p_c(n) = sum_(j <= n) phi_j exp(i j c). A regular series keeps it in
    bounds, a chaotic one sends it wandering like a random walk, its mean square displacement

        M_c(n) = mean_j |p_c(j + n) - p_c(j)|^2

    growing with n. K_c is the correlation of n = 1..n_total / 10 with D_c = M_c - V_osc, which damps the oscillation
    V_osc = (mean phi)^2 (1 - cos n c) / (1 - cos c) that the mean of the series brings; K is the median of K_c
    over 100 values of c in (pi/5, 4 pi/5). A constant series has K = 0. The points should not be oversampled: one in
    a period of the excitation is right. A series that is only weakly chaotic needs many of them.

    Raises
    ------
    CalibError : fewer than 100 points, or one that is not finite

    Source: Gottwald and Melbourne (2004), Proc. R. Soc. A 460, 603-611; Gottwald and Melbourne (2009), SIAM J. Applied
    Dynamical Systems 8, 129-145 (the correlation method).
    """
    series = np.asarray(series, dtype=float)
    if series.ndim != 1 or len(series) < MIN_SERIES_POINTS or not np.isfinite(series).all():
        raise CalibError(
            f"the 0-1 test needs a series of at least {MIN_SERIES_POINTS} finite numbers, got shape {series.shape}; "
            "go on for more periods, or drop a motion that fails"
        )
    if np.ptp(series) <= 1e-12 * np.abs(series).max():
        return 0.0  # constant but for rounding, which would look like noise
    c = np.pi / 5.0 * (1.0 + 3.0 * ((np.arange(1, TEST_FREQUENCIES + 1) * GOLDEN_RATIO) % 1.0))
    lags = np.arange(1, len(series) // 10 + 1)
    oscillation = (1.0 - np.cos(np.outer(c, lags))) / (1.0 - np.cos(c))[:, None]
    parts = [_mean_square_displacement(series, part, len(lags)) for part in np.split(c, FREQUENCY_PARTS)]
    damped = np.concatenate(parts) - series.mean() ** 2 * oscillation
    return float(np.median(_correlation(lags, damped)))


def _mean_square_displacement(series: np.ndarray, c: np.ndarray, longest: int) -> np.ndarray:
    """M_c (c, lag) for the lags 1..longest, each a mean over the same starts j.

    |p(j + n) - p(j)|^2 = |p(j + n)|^2 + |p(j)|^2 - 2 Re p(j + n) conj p(j); the last, summed over j, is a correlation,
    which a Fourier transform takes for all lags at once.
    """
    total = len(series)
    starts = total - longest
    p = np.cumsum(series * _turns(c, total), axis=1)
    p -= p.mean(axis=1, keepdims=True)  # differences stay; less is lost in the subtraction of squares
    length = 1 << (total - 1).bit_length()  # at least total: the lags do not wrap around
    product = np.fft.fft(p, length) * np.conj(np.fft.fft(p[:, :starts], length))
    crossed = np.fft.ifft(product)[:, 1 : longest + 1].real
    squares = np.cumsum(np.pad(np.abs(p) ** 2, ((0, 0), (1, 0))), axis=1)
    ahead = squares[:, starts + 1 : total + 1] - squares[:, 1 : longest + 1]
    return (ahead + squares[:, starts : starts + 1] - 2.0 * crossed) / starts


def _turns(c: np.ndarray, total: int) -> np.ndarray:
    """exp(i j c) (c, j) for j = 1..total, as products of few: an exponential costs ten times a product."""
    width = math.isqrt(total) + 1
    fine, coarse = np.arange(1, width + 1), width * np.arange(width)
    product = np.exp(1j * np.outer(c, coarse))[:, :, None] * np.exp(1j * np.outer(c, fine))[:, None, :]
    return product.reshape(len(c), -1)[:, :total]


def _correlation(lags: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Correlation (c,) of the lags (n,) with each row of `displacement` (c, n); 0 for a row that is constant."""
    x = lags - lags.mean()
    y = displacement - displacement.mean(axis=1, keepdims=True)
    norm = np.sqrt((x @ x) * (y**2).sum(axis=1))
    return np.divide(y @ x, norm, out=np.zeros(len(y)), where=norm > 0.0)
