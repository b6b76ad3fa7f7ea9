"""The noise of the measured channels: its level and its autocorrelation.

Where a record holds several cycles of a periodic motion, the residual about the mean cycle is noise, whatever the model
error (`calib.records.cycles.mean_cycle`: of the samples as they were measured); so are differences of replicates of a
frequency response (`pure_error`). Where it does not, the autocorrelation of the noise is taken from records that do and
that have the same sampling interval, and its level from the differences of neighbouring residuals; where there is no
such record, both are estimated from the residual that remains when all candidates have been fitted to it. A level that
the record states has precedence over all of these. Where the variance of that residual exceeds the stated one by more
than sampling allows, and by more than a stated level may be wrong, it contains model error: whitening by its
autocorrelation would remove the effects in question. Such noise is taken as white, and the scores over segments (see
`score`) widen the errors that the autocorrelation of either would make too small.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import solve_banded, solve_toeplitz, toeplitz
from scipy.sparse import dia_array
from scipy.special import chdtri, ndtr

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.score import Projection

MAX_ORDER = 12  # of the autoregression  [samples]
SAMPLES_PER_COEFFICIENT = 8  # of it, at least  [count]
FIXED_POINT_STEPS = 6  # of the correction for what a fit absorbs  [count]
NOTHING_ABSORBED = np.zeros((1, 1))  # by a fit, at lag 0
MIN_NOISE_CYCLES = 2.25  # of a record whose noise is estimated from cycle to cycle  [count]
MIN_LEVEL = 1e-6  # of the noise over a channel's root mean square  [1]: below it the accuracy of the simulation counts
DER_SNR_FACTOR = 0.6052697  # standard deviation over median |2 x_i - x_(i-2) - x_(i+2)| (Stoehr et al. 2008, DER_SNR)
MAX_INTERVAL_DIFFERENCE = 0.01  # relative, of two sampling intervals that count as equal  [1]
MAX_CORRELATED_LAGS = 100_000  # beyond which a stable autoregression has forgotten  [samples]
MAX_ROOT = 0.9999  # magnitude of the roots of a stable autoregression  [1]
STATED, CYCLIC, REPLICATED, RESIDUAL = "stated in the record", "cycle to cycle", "sweep to sweep", "the residual"


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one channel of a body: an autoregression.

    Attributes
    ----------
    sigma : standard deviation  [unit of the channel]
    ar : (order,) coefficients of its autoregression  [1]
    source : from which the level is estimated
    repeated : whether the autoregression is that of repeated cycles or replicates, not of what a fit leaves
    profile : (n,) standard deviation of each sample over `sigma`, whose mean square is 1; 1.0 of all  [1]
    """

    sigma: float
    ar: np.ndarray
    source: str
    repeated: bool = False
    profile: np.ndarray | float = 1.0

    @property
    def innovation(self) -> float:
        """Standard deviation of the innovation of each sample, over that of the noise  [1]."""
        return math.sqrt(max(1e-12, 1.0 - float(self.ar @ _correlations(self.ar))))

    def autocorrelation(self, lags: int) -> np.ndarray:
        """Correlation (lags,) of samples 0, 1, 2, ... apart  [1]."""
        first, order = np.concatenate([[1.0], _correlations(self.ar)]), self.ar.size
        if not order or lags <= first.size:
            return np.pad(first, (0, max(0, lags - first.size)))[:lags]
        polynomial = np.concatenate([[1.0], -self.ar])
        state = scipy.signal.lfiltic([1.0], polynomial, first[:0:-1])
        later, _ = scipy.signal.lfilter([1.0], polynomial, np.zeros(lags - first.size), zi=state)
        return np.concatenate([first, later])

    def mean_square_std(self, counted: float) -> float:
        """Standard deviation of the mean square of so many samples, relative to the variance.

        For Gaussian noise of the autocorrelations rho_k it is sqrt(2 / n times the sum of rho_k^2 over all lags)
        (Priestley, Spectral Analysis and Time Series, 1981, section 5.3).
        """
        squares = self.autocorrelation(max(1, int(counted))) ** 2
        return math.sqrt(2.0 / max(counted, 1.0) * float(2.0 * squares.sum() - squares[0]))

    def mean_square_interval(self, counted: float) -> tuple[float, float]:
        """Bounds of the mean square of so many samples, over the variance, that only a significant departure passes.

        It is distributed about as chi-square over its degrees of freedom, with as many as give it its variance
        (Satterthwaite, Biometrics Bulletin 2 (1946) 110), two at least.
        """
        freedom = max(2.0, 2.0 / self.mean_square_std(counted) ** 2)
        tail = float(ndtr(-CRITERIA.significance_std))
        return float(chdtri(freedom, 1.0 - tail)) / freedom, float(chdtri(freedom, tail)) / freedom

    def at_interval(self, ratio: float) -> "Noise":
        """Return the same noise, sampled at `ratio` times its interval [1]; white noise stays white.

        Straight lines between its lags keep an autocorrelation positive definite.
        """
        if not self.ar.size or abs(ratio - 1.0) <= MAX_INTERVAL_DIFFERENCE:
            return self
        order = min(MAX_ORDER, math.ceil(self.ar.size / min(1.0, ratio)))
        lags = ratio * np.arange(order + 1)
        known = self.autocorrelation(min(MAX_CORRELATED_LAGS, math.ceil(lags[-1]) + 1))
        rho = np.interp(lags, np.arange(known.size), known, right=0.0)
        return replace(self, ar=solve_toeplitz(rho[:order], rho[1:]))

    @cached_property
    def _predictors(self) -> tuple[np.ndarray, np.ndarray]:
        """Of a sample from the 0, 1, ..., order samples before it: coefficients (order + 1, order), and innovations.

        By the equations of Yule and Walker; the last of them is the autoregression itself.
        """
        order, rho = self.ar.size, self.autocorrelation(self.ar.size + 1)
        coefficients, innovation = np.zeros((order + 1, order)), np.ones(order + 1)
        for known in range(1, order + 1):
            own = self.ar if known == order else solve_toeplitz(rho[:known], rho[1 : known + 1])
            coefficients[known, :known] = own
            innovation[known] = math.sqrt(max(1e-12, 1.0 - float(own @ rho[1 : known + 1])))
        return coefficients, self.sigma * innovation

    def _bands(self, weight: np.ndarray) -> np.ndarray:
        """Diagonals (order + 1, n), from the main one down, of the matrix that whitens rows.

        Each sample is predicted from those just before it, as far as all of them have at least its weight: its
        prediction may not rest on less reliable samples. After a gap the prediction begins again.
        """
        order, n = self.ar.size, weight.size
        known, usable = np.zeros(n, dtype=int), weight > 0.0
        for lag in range(1, min(order, n - 1) + 1):
            usable = usable & np.concatenate([np.zeros(lag, dtype=bool), weight[:-lag] >= weight[lag:]])
            known += usable
        coefficients, innovation = self._predictors
        bands = np.zeros((order + 1, n))
        bands[0] = 1.0 / innovation[known]
        for lag in range(1, min(order, n - 1) + 1):
            bands[lag, :-lag] = -(coefficients[known, lag - 1] / innovation[known])[lag:]
        return bands

    def whitened(self, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Rows (..., n) in units of the noise, whitened and weighted (n,).

        Rows of such noise become white, of variance weight^2.
        """
        rows = rows / self.profile
        if not self.ar.size:
            return rows * weight / self.sigma
        below = dia_array((self._bands(weight), -np.arange(self.ar.size + 1)), shape=(weight.size, weight.size))
        return (below @ rows.reshape(-1, weight.size).T).T.reshape(rows.shape) * weight

    def coloured(self, white: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Undo `whitened` for rows (..., n) where the weight (n,) is not 0; 0 elsewhere."""
        counts = weight > 0.0
        unweighted = np.divide(white, weight, out=np.zeros(white.shape), where=counts)
        if not self.ar.size:
            return unweighted * self.sigma * self.profile
        bands, flat = self._bands(weight), unweighted.reshape(-1, weight.size).T
        return solve_banded((self.ar.size, 0), bands, flat).T.reshape(white.shape) * counts * self.profile

    def within(self, residual: np.ndarray, weight: np.ndarray) -> "Noise":
        """Return the noise, no larger than a residual (n,) of this weight (n,) unless its level is known otherwise."""
        if self.source != RESIDUAL:
            return self
        white = self.whitened(residual, weight)
        share = float(white @ white) / max(1.0, float(weight @ weight))
        return replace(self, sigma=self.sigma * math.sqrt(min(1.0, share)))

    def drawn(self, rng: np.random.Generator, size: int) -> np.ndarray:
        """Draw noise (size,), stationary from its first sample on."""
        return self.coloured(rng.standard_normal(size), np.ones(size))


@dataclass(frozen=True, eq=False)
class Repeating:
    """Noise of a record that is estimated from its cycles, by row, and the interval between its samples [s]."""

    step: float
    noise: Mapping[tuple[str, str], Noise]


@dataclass(frozen=True, eq=False)
class Remainder:
    """What a fit leaves of the rows of a record.

    Attributes
    ----------
    rows : (row, n)  [unit of the row]
    whole : (row, n) what is left before the candidates are fitted, which bounds the noise
    absorbed : (row, lag, lag) by how much the fit lowers the expected sum of the products of residuals l samples apart,
        per unit of the noise's autocovariance at lag j  [1]; at l = j = 0 its degrees of freedom
    leverage : (row, n) part of the variance of each sample that the fit takes  [1]
    """

    rows: np.ndarray
    whole: np.ndarray
    absorbed: np.ndarray
    leverage: np.ndarray

    def scaled(self, row: int, weight: np.ndarray, ar: np.ndarray) -> np.ndarray:
        """Return a row (n,) scaled to the mean square of noise of this autoregression, of this weight (n,)."""
        counted = float((weight**2).sum())
        taken = _taken(self.absorbed[row], ar, 1)[0]
        return self.rows[row] * math.sqrt(counted / max(1.0, counted - taken))


def absorbed_by(basis: np.ndarray) -> np.ndarray:
    """What a projection P on an orthonormal basis absorbs of a row, which has this part (n, k) of it: see `Remainder`.

    With D_j the matrix of ones between samples j apart, the products of residuals l apart are e' D_l e / 2 and their
    expectation per unit of the autocovariance at lag j is tr(D_l (1 - P) D_j (1 - P)) / 2; less that without P. What a
    shift moves beyond the ends of the row is omitted from tr(P D_l D_j). Source: Worsley et al., NeuroImage 15
    (2002) 1 (reduction of the bias of autoregressive coefficients).
    """
    n, lags = len(basis), np.arange(min(MAX_ORDER, (len(basis) - 1) // 2) + 1)
    shifted = [basis[lag:].T @ basis[: n - lag] for lag in range(2 * lags.size)]
    sums = 2.0 * np.array([np.trace(product) for product in shifted])
    once = sums[np.abs(lags[:, None] - lags)] + sums[lags[:, None] + lags]  # tr(P D_l D_j), where D_0 counted twice
    both = np.array([(product + product.T).ravel() for product in shifted[: lags.size]])
    halves = np.where(lags == 0, 0.5, 1.0)
    return np.outer(np.where(lags == 0, 1.0, 0.5) * halves, halves) * (2.0 * once - both @ both.T)


def from_cycles(
    residual: np.ndarray,
    weight: np.ndarray,
    measured: np.ndarray,
    parameters: int,
    stated: float | None,
    slow: Sequence[np.ndarray] = (),
) -> Noise:
    """Noise of one channel from the residual about its mean cycle.

    Parameters
    ----------
    residual, weight, measured : (n,)
    parameters : number of the mean cycle's, which take as many degrees of freedom
    slow : sets of columns (n, k) of changes of the motion from cycle to cycle that are no noise; one set is projected
        out where that lowers Schwarz's criterion
    """
    taken = (np.zeros((residual.size, 0)), *slow)
    known = (_about_mean(residual, weight, measured, parameters, Projection(c * weight[:, None])) for c in taken)
    noise, free, _ = min(known, key=lambda one: one[2])
    return noise if stated is None else _beside_stated(noise, stated, free, CRITERIA.max_variance_ratio - 1.0)


def _about_mean(
    residual: np.ndarray,
    weight: np.ndarray,
    measured: np.ndarray,
    parameters: int,
    slow: Projection,
) -> tuple[Noise, float, float]:
    """Noise about the mean cycle and slow changes of it, its degrees of freedom, and Schwarz's criterion.

    The criterion is of the same number of samples whatever slow changes are projected out: which is better does not
    depend on the unit.
    """
    counted = float((weight**2).sum())
    about = max(counted - parameters, 1.0)  # degrees of freedom about the mean cycle
    free = max(about - slow.rank, 1.0)
    left = np.where(weight > 0.0, slow(residual * weight) / np.maximum(weight, 1e-300), 0.0)
    table = absorbed_by(slow.basis) if slow.rank else NOTHING_ABSORBED
    noise = _noise(left * math.sqrt(counted / about), weight, measured, CYCLIC, table)
    least = _least(measured)
    noise = replace(_of_unit_innovations(noise, left, weight, free, least), repeated=True)
    likeliest = noise.innovation * max(noise.sigma * math.sqrt(free / about), least)
    criterion = 2.0 * about * math.log(likeliest) + (noise.ar.size + slow.rank) * math.log(about)
    return noise, free, criterion


def _of_unit_innovations(noise: Noise, residual: np.ndarray, weight: np.ndarray, free: float, least: float) -> Noise:
    """Return the noise with the level at which the whitened residual (n,) has unit variance in this record.

    The misfit of the same samples is measured in that unit.

    Parameters
    ----------
    free : degrees of freedom of the residual  [1]
    least : least level of noise  [unit of the channel]
    """
    white = noise.whitened(residual, weight)
    return replace(noise, sigma=max(noise.sigma * math.sqrt(float(white @ white) / free), least))


def _beside_stated(noise: Noise, stated: float, free: float, tolerated: float = 0.0) -> Noise:
    """Return noise that was estimated with so many degrees of freedom, of which the record states the level.

    A stated level is that of the noise as a whole. Where the noise is autocorrelated, the misfit is measured by its
    innovation, which the residual determines better: the level of a sample of such noise varies by chance, its
    innovation hardly. Many cycles, too, determine the level better than it is stated, with additional noise such as
    that of a jittering clock.

    tolerated : relative error of a stated variance that is allowed for  [1]
    """
    chance = CRITERIA.significance_std * noise.mean_square_std(free)
    ratio = (noise.sigma / stated) ** 2
    low, high = noise.mean_square_interval(free)
    is_estimate_better = max(chance, abs(ratio - 1.0)) < tolerated or (noise.ar.size > 0 and low < ratio < high)
    return replace(noise, sigma=noise.sigma if is_estimate_better else stated, source=STATED)


def from_residual(
    residual: np.ndarray,
    weight: np.ndarray,
    measured: np.ndarray,
    stated: float | None,
    absorbed: np.ndarray = NOTHING_ABSORBED,
    profile: np.ndarray | float = 1.0,
) -> Noise:
    """Noise of one channel from what no fit explains of it: residual, weight and measured (n,).

    absorbed : (lag, lag) as `Remainder` has it
    profile : as `Noise` has it
    """
    counted = float((weight**2).sum())
    free = max(counted - absorbed[0, 0], 1.0)
    noise = replace(_noise(residual / profile, weight, measured, RESIDUAL, absorbed), profile=profile)
    noise = _of_unit_innovations(noise, residual, weight, free, _least(measured))
    if stated is None:
        return noise
    excess = (noise.sigma / stated) ** 2 - CRITERIA.max_variance_ratio
    if excess < CRITERIA.significance_std * noise.mean_square_std(counted):
        return _beside_stated(noise, stated, free)
    return Noise(stated, np.zeros(0), STATED, profile=profile)


def with_autoregression(
    ar: np.ndarray, residual: np.ndarray, weight: np.ndarray, measured: np.ndarray, stated: float | None
) -> Noise:
    """Noise of known autoregression; its level from the differences of neighbouring residuals."""
    if stated is not None:
        return Noise(stated, ar, STATED, repeated=True)
    counts = weight > 0.0
    white = Noise(1.0, ar, RESIDUAL).whitened(residual, weight)
    white = np.divide(white, weight, out=np.zeros(white.shape), where=counts)
    whole = sliding_window_view(counts, 5).all(axis=1) if counts.size >= 5 else np.zeros(0, dtype=bool)
    differences = np.abs(2.0 * white[2:-2] - white[:-4] - white[4:])[whole]
    if differences.size:
        level = DER_SNR_FACTOR * float(np.median(differences))
    else:  # no sample has its neighbours
        level = math.sqrt(float(white @ white) / max(1, int(np.count_nonzero(counts))))
    return Noise(max(level, _least(measured)), ar, RESIDUAL, repeated=True)


def _noise(
    series: np.ndarray, weight: np.ndarray, measured: np.ndarray, source: str, absorbed: np.ndarray = NOTHING_ABSORBED
) -> Noise:
    """Noise of one channel by the level and the autoregression of a series (n,)."""
    ar, variance = _autoregression(series, weight, absorbed)
    return Noise(max(math.sqrt(variance), _least(measured)), ar, source)


def _least(measured: np.ndarray) -> float:
    """Least level of the noise of a channel  [its unit]."""
    return MIN_LEVEL * float(np.sqrt(np.mean(measured**2))) or 1e-300


def _autoregression(series: np.ndarray, weight: np.ndarray, absorbed: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients by least squares, of the order that Schwarz's criterion (1978) chooses; the variance.

    A fit leaves residuals that are correlated though the noise is white. What its projection absorbs of the products of
    residuals is added to them: that of white noise at first, then that of the estimated noise (the correction of
    Worsley et al., NeuroImage 15 (2002) 1, by fixed-point iteration: a direct solution would fill the
    frequencies that a fit removes completely). Only the remaining degrees of freedom count.
    """
    n, total = series.size, float((weight**2).sum())
    freedom = max(1.0, total - absorbed[0, 0])
    moments, windows = _moments(series, weight, min(MAX_ORDER, int(freedom) // SAMPLES_PER_COEFFICIENT))
    lags, mean_square = range(len(moments)), float(((series * weight) ** 2).sum()) / max(1.0, total)
    both = np.array([max(1.0, float((weight[lag:] * weight[: n - lag]).sum())) for lag in lags])
    ar, taken = np.zeros(0), _taken(absorbed, np.zeros(0), len(lags))
    for _ in range(FIXED_POINT_STEPS):
        variance = mean_square * total / max(1.0, total - taken[0])
        before, corrected = ar, moments + variance * toeplitz(taken / both)
        ar = _of_moments(corrected, windows * freedom / max(1.0, total))
        taken = _taken(absorbed, ar, len(lags))
        if np.array_equal(before, ar):
            break
    return ar, mean_square * total / max(1.0, total - taken[0])


def _moments(series: np.ndarray, weight: np.ndarray, order: int) -> tuple[np.ndarray, float]:
    """Mean products (order + 1, order + 1) of the samples that lie 0, 1, ..., order before each; number of windows.

    All are of the same windows of samples, those without a gap, so that their matrix is positive semi-definite:
    estimated each from all available pairs, that of noise of long correlation is not, though a single sample is missing
    (Broersen, de Waele & Bos, Automatica 40 (2004) 1495). The order is the highest, up to the given one, for which such
    windows are half of the samples, and SAMPLES_PER_COEFFICIENT for each coefficient.
    """
    for length in range(order + 1, 0, -1):
        least = sliding_window_view(weight, length).min(axis=1)
        windows = float((least**2).sum())
        if windows >= max(0.5 * float((weight**2).sum()), SAMPLES_PER_COEFFICIENT * (length - 1)):
            break
    rows = sliding_window_view(series, length)[:, ::-1] * least[:, None]
    return rows.T @ rows / max(1.0, windows), windows


def _taken(absorbed: np.ndarray, ar: np.ndarray, lags: int) -> np.ndarray:
    """By how much a fit lowers the expected sums (lag,) of products of residuals of noise of unit variance."""
    rho = Noise(1.0, ar, RESIDUAL).autocorrelation(len(absorbed))
    taken = (absorbed @ rho)[:lags]
    return np.pad(taken, (0, lags - taken.size))


def _of_moments(moments: np.ndarray, freedom: float) -> np.ndarray:
    """Coefficients for moments (lag, lag), of the order that Schwarz's criterion chooses for so many samples."""
    if not moments[0, 0] > 0.0:
        return np.zeros(0)
    best, chosen = freedom * math.log(moments[0, 0]), np.zeros(0)
    for order in range(1, len(moments)):
        own = slice(1, order + 1)
        ar = np.linalg.lstsq(moments[own, own], moments[0, own], rcond=None)[0]
        left = moments[0, 0] - ar @ moments[0, own]
        if left > 0.0 and freedom * math.log(left) + order * math.log(freedom) < best and _stable(ar):
            best, chosen = freedom * math.log(left) + order * math.log(freedom), ar
    return chosen


def _stable(ar: np.ndarray) -> bool:
    """Whether an autoregression is stationary."""
    return bool(np.abs(np.roots(np.concatenate([[1.0], -ar]))).max(initial=0.0) < MAX_ROOT)


def _correlations(ar: np.ndarray) -> np.ndarray:
    """Correlations (order,) at lags 1, 2, ... of an autoregression: the equations of Yule and Walker for them."""
    order = ar.size
    matrix = np.eye(order)
    for k in range(1, order + 1):
        for j in range(1, order + 1):
            lag = abs(k - j)
            if lag > 0:
                matrix[k - 1, lag - 1] -= ar[j - 1]
    return np.linalg.solve(matrix, ar)


def shared(noises: Iterable[Repeating], row: tuple[str, str], step: float) -> np.ndarray | None:
    """Autoregression of the same channel of the same body in another record, else of the channel of another body.

    It belongs to the interval between its samples: only records of the same interval share it. None without one.

    Parameters
    ----------
    noises : of the rows of each record with cycles
    step : interval between the samples of the record that needs one  [s]
    """
    comparable = [known.noise for known in noises if abs(known.step - step) <= MAX_INTERVAL_DIFFERENCE * step]
    own = [noise[row].ar for noise in comparable if row in noise]
    others = [n.ar for noise in comparable for (_, channel), n in noise.items() if channel == row[1]]
    return next(iter((*own, *others)), None)
