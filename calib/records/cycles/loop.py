"""The closed loop: the mean of a record's cycles."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from calib.errors import CalibError
from calib.records.record import channels as channels_of
from calib.records.record import stated_period

PHASE_GRID_TOLERANCE = 0.05  # of a sample interval, by which samples may miss a common grid of phases


def period_of(record: xr.Dataset) -> float:
    """Period of the excitation [s].

    Raises
    ------
    CalibError : the record has none
    """
    period = stated_period(record)
    if period is None:
        raise CalibError("the record's excitation has no period (attribute frequency [Hz]); compare it over time")
    return period


def rows(record: xr.Dataset, bodies: Sequence[str] | None, channels: Sequence[str]) -> np.ndarray:
    """Channels of bodies as one array (body * channel, time), channels running fastest.

    Raises
    ------
    CalibError : one of the channels or bodies is missing
    """
    have = record.variables
    for channel in channels:
        if channel not in have:
            raise CalibError(f"the record has no channel {channel!r}; it has {', '.join(channels_of(record))}")
    known = [str(body) for body in have["body"].values]
    for body in bodies or ():
        if body not in known:
            raise CalibError(f"the record has no body {body!r}; it has {', '.join(known)}")
    index = [known.index(body) for body in bodies] if bodies else range(len(known))
    values = [have[channel].values for channel in channels]
    return np.array([v[i] for i in index for v in values])


def cut(
    time: np.ndarray, values: np.ndarray, period: float, periods: int = 1, samples: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Cut rows into cycles of `periods` periods on one grid of phases.

    Samples that fall on the same phases in every cycle are taken as they are, and others are interpolated by a cubic
    spline, which changes the noise of the samples: for means and for the noise itself there is `mean_cycle`. A record
    without the last sample of its last cycle is closed by the first sample of that cycle.

    Parameters
    ----------
    time : (n,)  [s]
    values : (row, n)
    period : of the excitation  [s]
    periods : length of a cycle, in periods
    samples : per period; None takes the record's own number, rounded

    Returns
    -------
    cycles : (row, cycle, phase)
    phase : (phase,) in [0, periods), counted from time zero  [1, in periods]

    Raises
    ------
    CalibError : the record is shorter than one cycle
    """
    count, own, _ = cycles_in(time, period, periods)
    if samples in (None, own) and samples_in_step(time, period, own, count * periods, PHASE_GRID_TOLERANCE):
        offset = time[0] / period * own
        if samples is None or abs(offset - round(offset)) < 0.01:
            return _as_sampled(values, offset, own, periods, count)
    return _interpolated(time, values, period, periods, count, samples or own)


def cycles_in(time: np.ndarray, period: float, periods: int) -> tuple[int, int, float]:
    """Whole cycles of a record (n,) [s], its samples per period, rounded, and the cycles that it lasts.

    Raises
    ------
    CalibError : the record is shorter than one cycle
    """
    step = (time[-1] - time[0]) / (time.size - 1)
    cycles = (time[-1] - time[0] + step) / (period * periods)
    count = int(cycles + 1e-4)
    if count < 1:
        raise CalibError(
            f"at least {periods} period(s) of {period:.6g} s are needed, but the record lasts "
            f"{time[-1] - time[0]:.6g} s: check the unit of time and the frequency, record more, or compare it over "
            "time instead"
        )
    return count, max(1, round(period / step)), cycles


def samples_in_step(time: np.ndarray, period: float, samples: int, periods: int, tolerance: float) -> bool:
    """Whether the samples (n,) [s] of so many periods fall on the same phases in each, within a share of a sample."""
    step = (time[-1] - time[0]) / (time.size - 1)
    drift = abs(period / step - samples) * periods
    uniform = np.abs(time - (time[0] + step * np.arange(time.size))).max() < tolerance * step
    return bool(uniform and drift < tolerance)


def _as_sampled(values: np.ndarray, offset: float, own: int, periods: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    size = own * periods
    first = int(np.floor(offset + 0.01))
    cycles = values[:, : count * size].reshape(len(values), count, size)
    shift = first % size
    if shift:
        cycles = np.roll(cycles, shift, axis=-1)
    return cycles, (np.arange(size) + max(0.0, offset - first)) / own


def _interpolated(
    time: np.ndarray, values: np.ndarray, period: float, periods: int, count: int, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    end = time[0] + count * period * periods
    if time[-1] < end:  # within one sample of it, see `cut`
        last = np.searchsorted(time, end - period * periods)
        values = np.concatenate([values, values[:, last : last + 1]], axis=1)
        time = np.append(time, end)
    size = samples * periods
    first = int(np.ceil(time[0] / period * samples - 1e-6))
    at = (first + np.arange(count * size)) * (period / samples)
    cycles = CubicSpline(time, values, axis=1)(at).reshape(len(values), count, size)
    return np.roll(cycles, first % size, axis=-1), np.arange(size) / samples


def sampled(record: xr.Dataset, channel: str) -> np.ndarray:
    """Values (body, time) of a channel; velocity averaged over one sample where the record lists its impacts."""
    values = record.variables[channel].values
    if channel == "velocity" and "impact_time" in record.variables:
        return averaged_at_impacts(
            record.variables["time"].values, values, record.variables["impact_time"].values, "frequency" in record.attrs
        )
    return values


def averaged_at_impacts(time: np.ndarray, velocity: np.ndarray, impacts: np.ndarray, closed: bool) -> np.ndarray:
    """Velocity whose samples next to an impact are means over one sample interval instead of instantaneous values.

    A jump that is sampled instantaneously does not move while its instant moves within a sample interval, and then
    moves by a whole one; the mean over the interval centred on the sample follows it continuously. With the impact the
    share a of an interval after sample k, and the jump J extrapolated from both sides, the mean of the sample that it
    is nearer to is v_k + J (1/2 - a) for a < 1/2, v_{k+1} - J (a - 1/2) otherwise.

    Parameters
    ----------
    time : (n,) uniform  [s]
    velocity : (row, n)  [m/s]
    impacts : (m,) instants  [s]
    closed : whether the first sample follows the last
    """
    size = time.size
    if not impacts.size or size < 4:
        return velocity
    step = (time[-1] - time[0]) / (size - 1)
    position = (impacts - time[0]) / step
    before = np.floor(position).astype(int)
    share = position - before
    inside = (before >= 1) & (before + 2 < size) if not closed else (before >= -1) & (before < size)
    before, share = before[inside], share[inside]
    hit = set(before.tolist())
    averaged = velocity.copy()
    for k, a in zip(before.tolist(), share.tolist(), strict=True):
        left = velocity[:, k % size]
        right = velocity[:, (k + 1) % size]
        if k - 1 not in hit:
            left = left + a * (left - velocity[:, (k - 1) % size])
        if k + 1 not in hit:
            right = right - (1.0 - a) * (velocity[:, (k + 2) % size] - right)
        nearer = k % size if a < 0.5 else (k + 1) % size
        averaged[:, nearer] += (right - left) * (0.5 - a)
    return averaged


def harmonics(loop: np.ndarray, number: int) -> np.ndarray:
    """Complex amplitudes (row, number) of harmonics 1..number of the excitation in closed loops (row, phase).

    x(phi) = mean + sum of Re[c_n exp(2 pi i n phi)], phi in periods from the loop's first sample.
    """
    return 2.0 * np.fft.rfft(loop, axis=-1)[..., 1 : number + 1] / loop.shape[-1]
