"""The closed loop: the mean of a record's cycles."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.record import channels as channels_of
from calib.record import stated_period


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
    CalibError : the record lacks one of the channels or bodies
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

    Samples that fall on the same phases in every cycle are taken as they are, and others are interpolated linearly. A
    record that lacks the last sample of its last cycle is closed by the first sample of that cycle.

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
    step = (time[-1] - time[0]) / (time.size - 1)
    length = period * periods
    count = int((time[-1] - time[0] + step) / length + 1e-4)
    if count < 1:
        raise CalibError(
            f"at least {periods} period(s) of {period:.6g} s are needed, but the record lasts "
            f"{time[-1] - time[0]:.6g} s; record more, or compare it over time instead"
        )
    own = max(1, round(period / step))
    drift = abs(period / step - own) * periods * count
    uniform = np.abs(time - (time[0] + step * np.arange(time.size))).max() < 0.05 * step
    if samples in (None, own) and uniform and drift < 0.05:
        offset = time[0] / period * own
        if samples is None or abs(offset - round(offset)) < 0.01:
            return _as_sampled(values, offset, own, periods, count)
    return _interpolated(time, values, period, periods, count, samples or own)


def _as_sampled(values, offset, own, periods, count):
    size = own * periods
    first = int(np.floor(offset + 0.01))
    cycles = values[:, : count * size].reshape(len(values), count, size)
    shift = first % size
    if shift:
        cycles = np.roll(cycles, shift, axis=-1)
    return cycles, (np.arange(size) + max(0.0, offset - first)) / own


def _interpolated(time, values, period, periods, count, samples):
    end = time[0] + count * period * periods
    if time[-1] < end:  # within one sample of it, see `cut`
        last = np.searchsorted(time, end - period * periods)
        values = np.concatenate([values, values[:, last : last + 1]], axis=1)
        time = np.append(time, end)
    size = samples * periods
    first = int(np.ceil(time[0] / period * samples - 1e-6))
    at = (first + np.arange(count * size)) * (period / samples)
    cycles = np.array([np.interp(at, time, row) for row in values]).reshape(len(values), count, size)
    return np.roll(cycles, first % size, axis=-1), np.arange(size) / samples


def phase_curve(record: xr.Dataset, periods: int = 1, samples: int | None = None) -> xr.Dataset:
    """Closed loop of each body: mean of the cycles, with its standard uncertainty.

    The uncertainty is sigma / sqrt(cycles) where the record has a sigma, otherwise the standard deviation between the
    cycles over sqrt(cycles); it is left out where neither is known. Where the record tells the instants of its impacts,
    velocity is averaged over one sample there (see `averaged_at_impacts`).

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
        values = sampled(record, channel)
        cycles, phase = cut(time, values, period, periods, samples)
        unit = {"units": record[channel].attrs.get("units", "")}
        variables[channel] = (("body", "phase"), cycles.mean(axis=1), unit)
        sigma = _uncertainty(record, channel, cycles, periods, samples)
        if sigma is not None:
            variables[f"{channel}_sigma"] = (("body", "phase"), sigma, unit)
    return xr.Dataset(
        variables,
        coords={"body": record.body.values, "phase": ("phase", phase, {"units": "1"})},
        attrs={"cycles": cycles.shape[1], "frequency": 1.0 / period},
    )


def loop_sigma(record: xr.Dataset, channel: str, periods: int = 1, samples: int | None = None) -> np.ndarray | None:
    """Standard uncertainty (body, phase) of the mean loop from the record's own sigma, None where it has none."""
    name = f"{channel}_sigma"
    if name not in record.variables:
        return None
    time, sigma = record.variables["time"].values, record.variables[name].values
    if sigma.ndim == 1:
        sigma = np.repeat(sigma[:, None], time.size, axis=1)
    variance, _ = cut(time, sigma**2, period_of(record), periods, samples)
    return np.sqrt(variance.mean(axis=1) / variance.shape[1])


def _uncertainty(record, channel, cycles, periods, samples):
    sigma = loop_sigma(record, channel, periods, samples)
    if sigma is None and cycles.shape[1] > 1:
        sigma = cycles.std(axis=1, ddof=1) / np.sqrt(cycles.shape[1])
    return sigma


def sampled(record: xr.Dataset, channel: str) -> np.ndarray:
    """Values (body, time) of a channel; velocity averaged over one sample where the record tells its impacts."""
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
    place = (impacts - time[0]) / step
    before = np.floor(place).astype(int)
    share = place - before
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
