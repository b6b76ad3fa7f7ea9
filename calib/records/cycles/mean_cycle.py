"""The mean cycle of a record, by regression of its samples as they were taken on the phase of the cycle.

Where the clock runs in step with the drive the samples of all cycles fall on the same phases, and the mean cycle is
their mean at each. Where it runs freely the samples of all cycles fill the phases between them: the mean cycle is then
the periodic cubic spline that fits them best (de Boor, A Practical Guide to Splines, 2001, chapter XIV). Nothing is
interpolated, so that what is left about the mean cycle has the variance and the autocorrelation of the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import xarray as xr
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.sparse.linalg import SuperLU, splu

from calib.records.cycles.loop import cycles_in, period_of, sampled, samples_in_step
from calib.records.record import channels as channels_of

IN_STEP_TOLERANCE = 1e-3  # of a sample interval, by which samples of one phase may lie apart
MEAN_CYCLE_SPLINE_DEGREE = 3  # of the periodic spline of a mean cycle
KNOTS_PER_SAMPLE = (1, 2, 4)  # knots per sample of a cycle
SAMPLES_PER_KNOT = 4  # at least, where knots are nearer than samples of a cycle
MAX_CACHED_SPLINES = 16  # most recent ones, of a clock and a number of knots each
MAX_CACHED_SAMPLES = 100_000  # of such a clock: of longer records, 50 bytes a sample would add up
ROUGHNESS_WEIGHT = 1e-6  # weight of squared second differences of the coefficients: bridges phases without samples


@dataclass(frozen=True, eq=False)
class MeanCycle:
    """The mean cycle of several channels.

    Attributes
    ----------
    phase : (phase,) in [0, periods), counted from time zero  [1, in periods of the excitation]
    loop : (row, phase) mean cycle, in the channels' units
    residual : (row, n) samples less their mean cycle
    weight : (row, n) of the samples
    nearest : (n,) index of the phase that is nearest to each sample
    parameters : number of coefficients that each row was fitted with
    cycles : that the record lasts, whole ones or not  [1]
    """

    phase: np.ndarray
    loop: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    nearest: np.ndarray
    parameters: int
    cycles: float

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation (row, phase) of the samples; NaN where there are no more samples than coefficients."""
        return np.array([self._deviation(row, w) for row, w in zip(self.residual, self.weight, strict=True)])

    def _deviation(self, residual: np.ndarray, weight: np.ndarray) -> np.ndarray:
        size = self.phase.size
        free = 1.0 - self.parameters / max(float(weight.sum()), 1.0)
        if free < 1e-9:
            return np.full(size, np.nan)
        counted = np.bincount(self.nearest, weight, size)
        square = np.bincount(self.nearest, weight * residual**2, size)
        everywhere = square.sum() / max(counted.sum(), 1.0)
        return np.sqrt(np.where(counted > 0.0, square / np.where(counted > 0.0, counted, 1.0), everywhere) / free)


def mean_cycle(
    time: np.ndarray,
    values: np.ndarray,
    period: float,
    periods: int = 1,
    samples: int | None = None,
    weight: np.ndarray | None = None,
    refined: bool = True,
) -> MeanCycle:
    """Fit the mean cycle of `periods` periods to rows of samples.

    The knots of the spline are as far apart as the samples of a cycle, or a half or a fourth of that where Schwarz's
    criterion (1978) asks for it.

    Parameters
    ----------
    time : (n,)  [s]
    values : (row, n)
    period : of the excitation  [s]
    periods : length of a cycle, in periods
    samples : of the loop, per period; None takes the record's own number, rounded
    weight : (row, n) of the samples, 0 where one does not count; None: all have weight 1
    refined : whether knots may be nearer than the samples of a cycle

    Raises
    ------
    CalibError : the record is shorter than one cycle
    """
    count, own, length = cycles_in(time, period, periods)
    weight = np.ones_like(values) if weight is None else weight
    first = time[0] / period * own  # position of the first sample, in samples
    on_grid = samples is None or abs(first - round(first)) < IN_STEP_TOLERANCE
    if samples in (None, own) and on_grid and samples_in_step(time, period, own, count * periods, IN_STEP_TOLERANCE):
        whole = int(np.floor(first + IN_STEP_TOLERANCE))
        phase = (np.arange(own * periods) + max(0.0, first - whole)) / own
        nearest = (whole + np.arange(time.size)) % phase.size
        loop, fitted, parameters = *_phase_means(values, weight, nearest, phase.size), phase.size
    else:
        phase = np.arange((samples or own) * periods) / (samples or own)
        nearest = np.round(time / (period * periods) * phase.size).astype(int) % phase.size
        sizes = [own * periods * refinement for refinement in (KNOTS_PER_SAMPLE if refined else KNOTS_PER_SAMPLE[:1])]
        loop, fitted, parameters = _of_spline(time / (period * periods), values, weight, sizes, phase / periods)
    return MeanCycle(phase, loop, values - fitted, weight, nearest, parameters, length)


def _phase_means(
    values: np.ndarray, weight: np.ndarray, position: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Loop (row, size) and fitted samples (row, n): means of the samples (row, n) at the same `position` (n,)."""
    if (weight == 1.0).all() and values.shape[1] % size == 0:
        loop = np.roll(values.reshape(len(values), -1, size).mean(axis=1), position[0], axis=1)
    else:
        counted = np.array([np.bincount(position, w, size) for w in weight])
        weight = np.where(counted[:, position] > 0.0, weight, 1.0)  # where no sample counts, all do
        counted = np.array([np.bincount(position, w, size) for w in weight])
        loop = np.array([np.bincount(position, w * r, size) for r, w in zip(values, weight, strict=True)]) / counted
    return loop, loop[:, position]


def _of_spline(
    turn: np.ndarray, values: np.ndarray, weight: np.ndarray, sizes: Sequence[int], grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Loop (row, phase) at `grid`, fitted samples (row, n) and number of knots, the best of `sizes`.

    turn, grid : positions of the samples (n,) and of the loop (phase,), in cycles
    """
    best, knots = _fitted(turn, values, weight, sizes[0]), sizes[0]
    for more in sizes[1:]:
        if turn.size < SAMPLES_PER_KNOT * more:
            break
        finer = _fitted(turn, values, weight, more)
        if finer[0] < best[0]:
            best, knots = finer, more
    _, coefficients, samples = best
    return coefficients @ _basis(grid - turn[0], knots).T, samples, knots


def _fitted(
    turn: np.ndarray, values: np.ndarray, weight: np.ndarray, knots: int
) -> tuple[float, np.ndarray, np.ndarray]:
    """Schwarz's criterion, coefficients (row, knots) and fitted samples (row, n) of the spline of so many knots."""
    made = _spline if turn.size <= MAX_CACHED_SAMPLES else _spline.__wrapped__
    spline = made((turn - turn[0]).tobytes(), knots)
    coefficients = np.array([spline.fitted(row, w) for row, w in zip(values, weight, strict=True)])
    fitted = coefficients @ spline.basis.T
    return _schwarz(values, fitted, weight, knots), coefficients, fitted


@lru_cache(maxsize=MAX_CACHED_SPLINES)
def _spline(turn: bytes, knots: int) -> "_Spline":
    """Periodic spline at positions (n,) of float64, in cycles from a knot: records share their clocks."""
    return _Spline(_basis(np.frombuffer(turn), knots))


@dataclass(frozen=True, eq=False)
class _Spline:
    """A periodic spline to be fitted to samples.

    Attributes
    ----------
    basis : (n, knots) B-splines at the samples
    """

    basis: sparse.csr_array

    def fitted(self, row: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Coefficients (knots,) of weighted least squares of one row (n,) of samples."""
        equations = self._unweighted if (weight == 1.0).all() else self._factorised(weight)
        return equations.solve((weight * row) @ self.basis)

    @cached_property
    def _unweighted(self) -> SuperLU:
        return self._factorised(np.ones(self.basis.shape[0]))

    def _factorised(self, weight: np.ndarray) -> SuperLU:
        knots = self.basis.shape[1]
        index, ones = np.arange(knots), np.ones(knots)
        shifted = [sparse.csr_array((ones, (index, (index + by) % knots)), shape=(knots, knots)) for by in (-1, 1)]
        bend = 2.0 * sparse.eye_array(knots) - sum(shifted)
        stiffness = ROUGHNESS_WEIGHT * weight.sum() / knots * (bend.T @ bend)
        return splu(sparse.csc_matrix((self.basis * weight[:, None]).T @ self.basis + stiffness))


def _basis(turn: np.ndarray, knots: int) -> sparse.csr_array:
    """Periodic cubic B-splines (n, knots) at positions `turn` (n,), counted in cycles from a knot."""
    position = np.minimum((turn % 1.0) * knots, np.nextafter(knots, 0.0))
    spread = BSpline.design_matrix(
        position,
        np.arange(-MEAN_CYCLE_SPLINE_DEGREE, knots + MEAN_CYCLE_SPLINE_DEGREE + 1, dtype=float),
        MEAN_CYCLE_SPLINE_DEGREE,
    )
    index = np.arange(knots + MEAN_CYCLE_SPLINE_DEGREE)
    wrapped = sparse.csr_array((np.ones(index.size), (index, index % knots)), shape=(index.size, knots))
    return sparse.csr_array(spread) @ wrapped


def _schwarz(values: np.ndarray, fitted: np.ndarray, weight: np.ndarray, knots: int) -> float:
    """Schwarz's criterion of all rows (row, n) together."""
    counted = np.maximum(weight.sum(axis=1), 1.0)
    size = np.maximum((weight * values**2).sum(axis=1), 1e-300)
    left = (weight * (values - fitted) ** 2).sum(axis=1) / size
    return float((counted * np.log(np.maximum(left, 1e-24)) + knots * np.log(counted)).sum())


def phase_curve(record: xr.Dataset, periods: int = 1, samples: int | None = None) -> xr.Dataset:
    """Closed loop of each body: mean of the cycles, with its standard uncertainty.

    The uncertainty is sigma / sqrt(cycles) where the record has a sigma, otherwise the standard deviation of the
    samples about the loop over sqrt(cycles); it is left out where neither is known. Where the record tells the instants
    of its impacts, velocity is averaged over one sample there (see `averaged_at_impacts`).

    Parameters
    ----------
    record : Dataset with channels over (body, time), time [s] uniform or not, attribute frequency [Hz]
    periods : length of the loop, in periods
    samples : per period; None takes the record's own number

    Returns
    -------
    Dataset with the record's channels over (body, phase), ``<channel>_sigma`` (body, phase), and phase in
    [0, periods) [1, in periods of the excitation, counted from time zero]; attribute cycles

    Raises
    ------
    CalibError : no period, or a record shorter than the loop
    """
    period, time = period_of(record), record.time.values
    variables = {}
    for channel in channels_of(record):
        mean = mean_cycle(time, sampled(record, channel), period, periods, samples)
        unit = {"units": record[channel].attrs.get("units", "")}
        variables[channel] = (("body", "phase"), mean.loop, unit)
        sigma = loop_sigma(record, channel, periods, samples)
        if sigma is None and np.isfinite(mean.deviation).all():
            sigma = mean.deviation / np.sqrt(mean.cycles)
        if sigma is not None:
            variables[f"{channel}_sigma"] = (("body", "phase"), sigma, unit)
    return xr.Dataset(
        variables,
        coords={"body": record.body.values, "phase": ("phase", mean.phase, {"units": "1"})},
        attrs={"cycles": int(mean.cycles + 1e-4), "frequency": 1.0 / period},
    )


def loop_sigma(record: xr.Dataset, channel: str, periods: int = 1, samples: int | None = None) -> np.ndarray | None:
    """Standard uncertainty (body, phase) of the mean loop from the record's own sigma, None where it has none."""
    name = f"{channel}_sigma"
    if name not in record.variables:
        return None
    time, sigma = record.variables["time"].values, record.variables[name].values
    if sigma.ndim == 1:
        sigma = np.repeat(sigma[:, None], time.size, axis=1)
    variance = mean_cycle(time, sigma**2, period_of(record), periods, samples)
    return np.sqrt(np.maximum(variance.loop, 0.0) / variance.cycles)
