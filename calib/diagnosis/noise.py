"""The noise of the measured channels: its level and its autocorrelation.

Where a record holds several cycles of a motion that returns, what is left about the mean cycle is noise, whatever the
model gets wrong (`calib.records.cycles.mean_cycle`: of the samples as they were measured). Where it does not, the
autocorrelation of the noise is taken from records that do and that are sampled as fast, and its level from the fastest
part of the residual; where there is no such record, both are read off the residual that is left when everything that is
known to the diagnosis has been fitted to it. A level that the record states comes before all of these. Where the
variance of what is left exceeds the stated one by more than a sample of such noise may, and by more than a stated level
may be wrong, it holds errors of the model: to take their autocorrelation for that of the noise would whiten away what
is looked for. Such noise is taken as white, and the scores over segments (see `score`) widen what autocorrelation of
either would make too sure.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import solve_banded, solve_toeplitz, toeplitz
from scipy.signal import lfilter, lfiltic
from scipy.sparse import dia_array

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.score import Projection

ORDER = 12  # highest of the autoregression
SAMPLES_PER_COEFFICIENT = 8  # of it, at least
FIXED_POINT_STEPS = 6  # of the correction for what a fit absorbs
NOTHING_ABSORBED = np.zeros((1, 1))  # by a fit, at lag 0
LEAST_CYCLES = 2.25  # of a record that shows its noise from cycle to cycle
LEAST = 1e-6  # of a channel's root mean square: noise below that is none, and the model's accuracy counts
QUICK = 0.6052697  # median |2 x_i - x_(i-2) - x_(i+2)| to standard deviation (Stoehr et al. 2008, DER_SNR)
SAME_STEP = 0.01  # relative difference of two sampling intervals that count as one
STATED, CYCLIC, RESIDUAL = "stated in the record", "cycle to cycle", "the residual"


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one channel of a body: an autoregression.

    Attributes
    ----------
    sigma : standard deviation  [unit of the channel]
    ar : (order,) coefficients of its autoregression  [1]
    source : where the level comes from
    repeated : whether the autoregression is of cycles that repeat, not of what a fit leaves
    """

    sigma: float
    ar: np.ndarray
    source: str
    repeated: bool = False

    @property
    def is_independent(self) -> bool:
        """Whether it is known otherwise than as what a fit leaves: then a fit can be seen to leave more than noise."""
        return self.source != RESIDUAL or self.repeated

    @property
    def innovation(self) -> float:
        """Standard deviation of what is new in each sample, over that of the noise  [1]."""
        return math.sqrt(max(1e-12, 1.0 - float(self.ar @ _correlations(self.ar))))

    def autocorrelation(self, lags: int) -> np.ndarray:
        """Correlation (lags,) of samples 0, 1, 2, ... apart  [1]."""
        first, order = np.concatenate([[1.0], _correlations(self.ar)]), self.ar.size
        if not order or lags <= first.size:
            return np.pad(first, (0, max(0, lags - first.size)))[:lags]
        polynomial = np.concatenate([[1.0], -self.ar])
        state = lfiltic([1.0], polynomial, first[:0:-1])
        later, _ = lfilter([1.0], polynomial, np.zeros(lags - first.size), zi=state)
        return np.concatenate([first, later])

    def mean_square_std(self, counted: float) -> float:
        """Standard deviation of the mean square of so many samples, relative to the variance.

        For Gaussian noise of the autocorrelations rho_k it is sqrt(2 / n times the sum of rho_k^2 over all lags)
        (Priestley, Spectral Analysis and Time Series, 1981, section 5.3.3).
        """
        squares = self.autocorrelation(max(1, int(counted))) ** 2
        return math.sqrt(2.0 / max(counted, 1.0) * float(2.0 * squares.sum() - squares[0]))

    @cached_property
    def _predictors(self) -> tuple[np.ndarray, np.ndarray]:
        """Of a sample from the 0, 1, ..., order samples before it: coefficients (order + 1, order), what is new in it.

        By the equations of Yule and Walker; the last of them is the autoregression itself.
        """
        order, rho = self.ar.size, self.autocorrelation(self.ar.size + 1)
        coefficients, new = np.zeros((order + 1, order)), np.ones(order + 1)
        for known in range(1, order + 1):
            own = self.ar if known == order else solve_toeplitz(rho[:known], rho[1 : known + 1])
            coefficients[known, :known] = own
            new[known] = math.sqrt(max(1e-12, 1.0 - float(own @ rho[1 : known + 1])))
        return coefficients, self.sigma * new

    def _bands(self, weight: np.ndarray) -> np.ndarray:
        """Diagonals (order + 1, n), from the main one down, of the matrix that whitens rows.

        Each sample is predicted from those just before it, as far as all of them count as much as it does: what is
        known of it may not rest on what is less to be trusted. After a gap the prediction begins anew.
        """
        order, n = self.ar.size, weight.size
        known, goes_on = np.zeros(n, dtype=int), weight > 0.0
        for lag in range(1, min(order, n - 1) + 1):
            goes_on = goes_on & np.concatenate([np.zeros(lag, dtype=bool), weight[:-lag] >= weight[lag:]])
            known += goes_on
        coefficients, new = self._predictors
        bands = np.zeros((order + 1, n))
        bands[0] = 1.0 / new[known]
        for lag in range(1, min(order, n - 1) + 1):
            bands[lag, :-lag] = -(coefficients[known, lag - 1] / new[known])[lag:]
        return bands

    def whitened(self, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Rows (..., n) in units of the noise, whitened and weighted (n,).

        Of such noise they are white, and of variance weight^2.
        """
        if not self.ar.size:
            return rows * weight / self.sigma
        below = dia_array((self._bands(weight), -np.arange(self.ar.size + 1)), shape=(weight.size, weight.size))
        return (below @ rows.reshape(-1, weight.size).T).T.reshape(rows.shape) * weight

    def coloured(self, white: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Undo `whitened` for rows (..., n) where the weight (n,) is not 0; 0 elsewhere."""
        counts = weight > 0.0
        even = np.divide(white, weight, out=np.zeros(white.shape), where=counts)
        if not self.ar.size:
            return even * self.sigma
        bands, flat = self._bands(weight), even.reshape(-1, weight.size).T
        return solve_banded((self.ar.size, 0), bands, flat).T.reshape(white.shape) * counts

    def within(self, residual: np.ndarray, weight: np.ndarray) -> "Noise":
        """Return it no larger than a residual (n,) of this weight (n,), unless its level is known otherwise."""
        if self.source != RESIDUAL:
            return self
        new = self.whitened(residual, weight)
        share = float(new @ new) / max(1.0, float(weight @ weight))
        return replace(self, sigma=self.sigma * math.sqrt(min(1.0, share)))

    def drawn(self, rng: np.random.Generator, size: int) -> np.ndarray:
        """Draw noise (size,)."""
        lead = 20 * (self.ar.size + 1)
        new = self.sigma * self.innovation * rng.standard_normal(size + lead)
        return lfilter([1.0], np.concatenate([[1.0], -self.ar]), new)[lead:]


@dataclass(frozen=True, eq=False)
class Repeating:
    """Noise of a record whose cycles show it, by row, and the interval between its samples [s]."""

    step: float
    noise: Mapping[tuple[str, str], Noise]


@dataclass(frozen=True, eq=False)
class Remainder:
    """What a fit leaves of the rows of a record.

    Attributes
    ----------
    rows : (row, n)  [unit of the row]
    whole : (row, n) what is left before the candidates are fitted: that the noise does not exceed
    absorbed : (row, lag, lag) by how much the fit lowers the expected sum of the products of residuals l samples apart,
        for each unit of the noise's autocovariance at lag j  [1]; at l = j = 0 the degrees of freedom that it takes
    """

    rows: np.ndarray
    whole: np.ndarray
    absorbed: np.ndarray

    def scaled(self, row: int, weight: np.ndarray, ar: np.ndarray) -> np.ndarray:
        """Return a row (n,) as large as noise of known autoregression is on average, of samples of this weight (n,)."""
        counted = float((weight**2).sum())
        taken = _taken(self.absorbed[row], ar, 1)[0]
        return self.rows[row] * math.sqrt(counted / max(1.0, counted - taken))


def absorbed_by(basis: np.ndarray) -> np.ndarray:
    """What a projection P on an orthonormal basis, of which a row has this part (n, k), absorbs: see `Remainder`.

    With D_j the matrix of ones between samples j apart, the products of residuals l apart are e' D_l e / 2 and their
    expectation for each unit of the autocovariance at lag j is tr(D_l (1 - P) D_j (1 - P)) / 2; less that without P.
    What a shift moves beyond the ends of the row is left out of tr(P D_l D_j). Source: Worsley et al., NeuroImage 15
    (2002) 1, section 2.3.
    """
    n, lags = len(basis), np.arange(min(ORDER, (len(basis) - 1) // 2) + 1)
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
    """Noise of one channel from what its cycles leave about their mean.

    Parameters
    ----------
    residual, weight, measured : (n,)
    parameters : of the mean cycle, which take as many degrees of freedom
    slow : columns (n, k) of changes of the motion from cycle to cycle that would be no noise; those of one of them are
        taken out where Schwarz's criterion asks for it
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

    The criterion is of as many samples whatever slow changes are taken out: what is better does not depend on the unit.
    """
    counted = float((weight**2).sum())
    about = max(counted - parameters, 1.0)  # samples that are free about the mean cycle
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
    """Return it with the level at which the residual (n,), once whitened, has unit variance in this record.

    The misfit of the same samples is judged by it.

    Parameters
    ----------
    free : degrees of freedom of the residual  [1]
    least : level that noise has at least  [unit of the channel]
    """
    new = noise.whitened(residual, weight)
    return replace(noise, sigma=max(noise.sigma * math.sqrt(float(new @ new) / free), least))


def _beside_stated(noise: Noise, stated: float, free: float, tolerated: float = 0.0) -> Noise:
    """Return noise that was estimated with so many degrees of freedom, of which the record states the level.

    A stated level is that of the noise as a whole. Where the noise is autocorrelated, its innovation is judged by, and
    that the residual tells better: the level of a sample of such noise is off by chance, its innovation hardly.
    Many cycles tell the level better, too, than it is stated, and what comes on top of it, as by a clock that jitters.

    tolerated : departure of the variance from the stated one, relative, by which a statement may be off  [1]
    """
    chance = CRITERIA.significance_std * noise.mean_square_std(free)
    off = abs((noise.sigma / stated) ** 2 - 1.0)
    own = max(chance, off) < tolerated or (noise.ar.size > 0 and off < chance)
    return replace(noise, sigma=noise.sigma if own else stated, source=STATED)


def from_residual(
    residual: np.ndarray,
    weight: np.ndarray,
    measured: np.ndarray,
    stated: float | None,
    absorbed: np.ndarray = NOTHING_ABSORBED,
) -> Noise:
    """Noise of one channel from what no fit explains of it: residual, weight and measured (n,).

    absorbed : (lag, lag) as `Remainder` has it
    """
    counted = float((weight**2).sum())
    free = max(counted - absorbed[0, 0], 1.0)
    noise = _noise(residual, weight, measured, RESIDUAL, absorbed)
    noise = _of_unit_innovations(noise, residual, weight, free, _least(measured))
    if stated is None:
        return noise
    excess = (noise.sigma / stated) ** 2 - CRITERIA.max_variance_ratio
    if excess < CRITERIA.significance_std * noise.mean_square_std(counted):
        return _beside_stated(noise, stated, free)
    return Noise(stated, np.zeros(0), STATED)


def with_autoregression(
    ar: np.ndarray, residual: np.ndarray, weight: np.ndarray, measured: np.ndarray, stated: float | None
) -> Noise:
    """Noise of known autoregression; its level from the fastest part of the residual."""
    if stated is not None:
        return Noise(stated, ar, STATED, repeated=True)
    new = Noise(1.0, ar, RESIDUAL).whitened(residual, weight)
    quick = np.abs(2.0 * new[2:-2] - new[:-4] - new[4:])
    level = QUICK * float(np.median(quick))
    return Noise(max(level, _least(measured)), ar, RESIDUAL, repeated=True)


def _noise(series, weight, measured, source, absorbed=NOTHING_ABSORBED) -> Noise:
    ar, variance = _autoregression(series, weight, absorbed)
    return Noise(max(math.sqrt(variance), _least(measured)), ar, source)


def _least(measured: np.ndarray) -> float:
    return LEAST * float(np.sqrt(np.mean(measured**2))) or 1e-300


def _autoregression(series: np.ndarray, weight: np.ndarray, absorbed: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients by least squares, of the order that Schwarz's criterion (1978) chooses; the variance.

    A fit leaves residuals that are correlated though the noise is white. What its projection absorbs of the products of
    residuals is added to them: of white noise at first, then of the noise that has come out (the correction of Worsley
    et al., NeuroImage 15 (2002) 1, section 2.3, by fixed-point iteration: solved for at once it would fill the
    frequencies that a fit takes out whole). Only the degrees of freedom that it leaves count.
    """
    n, total = series.size, float((weight**2).sum())
    freedom = max(1.0, total - absorbed[0, 0])
    moments, windows = _moments(series, weight, min(ORDER, int(freedom) // SAMPLES_PER_COEFFICIENT))
    lags, mean_square = range(len(moments)), float(((series * weight) ** 2).sum()) / max(1.0, total)
    both = np.array([max(1.0, float((weight[lag:] * weight[: n - lag]).sum())) for lag in lags])
    ar, taken = np.zeros(0), _taken(absorbed, np.zeros(0), len(lags))
    for _ in range(FIXED_POINT_STEPS):
        variance = mean_square * total / max(1.0, total - taken[0])
        before, mended = ar, moments + variance * toeplitz(taken / both)
        ar = _of_moments(mended, windows * freedom / max(1.0, total))
        taken = _taken(absorbed, ar, len(lags))
        if np.array_equal(before, ar):
            break
    return ar, mean_square * total / max(1.0, total - taken[0])


def _moments(series: np.ndarray, weight: np.ndarray, order: int) -> tuple[np.ndarray, float]:
    """Mean products (order + 1, order + 1) of the samples that lie 0, 1, ..., order before each; how many each is of.

    All are of the same windows of samples, those without a gap, so that they are the moments of something: estimated
    each from all pairs that there are, those of noise of long correlation are not, though a single sample is missing
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
    return bool(np.abs(np.roots(np.concatenate([[1.0], -ar]))).max(initial=0.0) < 0.9999)


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
    """Memory of the same channel of the same body in another record, else of the same channel of another body.

    An autoregression belongs to the interval between its samples: only records that are sampled as fast share it.

    Parameters
    ----------
    noises : of the rows of each record that repeats
    step : interval between the samples of the record that needs one  [s]
    """
    alike = [known.noise for known in noises if abs(known.step - step) <= SAME_STEP * step]
    own = [noise[row].ar for noise in alike if row in noise]
    others = [n.ar for noise in alike for (_, channel), n in noise.items() if channel == row[1]]
    return next(iter((*own, *others)), None)
