"""A record cut by the period of its excitation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.record import channels as channels_of

LAGS = 16  # the longest motion that is told from an irregular one, in periods
SECTION = 64  # periods of a section from which "irregular" may be said
TOLERANCE = 1e-3  # how well a periodic motion returns, as a share of its amplitude
NOISE = 1.5  # a measured cycle returns where it differs by less than this many standard deviations of its noise
CONTACT_SHARE = 0.2  # a body is in contact while its acceleration stands out by this share of the greatest
PULSE = 0.02  # half width of the neighbourhood from which an impact stands out, in periods
PULSE_FOOT = 0.1  # share of its peak below which a pulse of acceleration ends


@dataclass(frozen=True)
class Motion:
    """Kind of a motion, and why it is called so.

    Attributes
    ----------
    kind : "period-1" (2, ...), "irregular", "undecided", "no contact" (only of a record that tells its contacts) or
        "not periodic" (the excitation has no period)
    period : periods of the excitation after which the motion returns, None where that is not known
    evidence : how it was found, one sentence
    recurrence : difference of the states n = 1, 2, ... periods apart, as a share of the amplitude; up to the period
    likely : of an undecided motion, the period that it is settling to, where that can be seen
    impacts : impacts per period, NaN where the record does not tell; reported, no part of the kind
    """

    kind: str
    period: int | None
    evidence: str
    recurrence: tuple[float, ...] = ()
    likely: int | None = None
    impacts: float = float("nan")


# --- the closed loop -------------------------------------------------------------------------------------------------


def period_of(record: xr.Dataset) -> float:
    """Period of the excitation [s].

    Raises
    ------
    CalibError : the record has none
    """
    frequency = record.attrs.get("frequency")
    if frequency is None:
        raise CalibError("the record's excitation has no period (attribute frequency [Hz]); compare it over time")
    return 1.0 / float(frequency)


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


# --- once per period -------------------------------------------------------------------------------------------------


def poincare(record: xr.Dataset, phase: float = 0.0) -> xr.Dataset:
    """State of each body once per period of the excitation.

    At phase 0 the record's own section is taken where it has one: it is longer than the record.

    Parameters
    ----------
    record : Dataset with displacement (body, time) [m] and velocity (body, time) [m/s]; either may be absent
    phase : float in [0, 1)  [1]

    Returns
    -------
    Dataset with displacement (body, cycle) [m] and velocity (body, cycle) [m/s]
    """
    if not 0.0 <= phase < 1.0:
        raise CalibError(f"a section's phase is in [0, 1) periods, got {phase}")
    own = section(record) if phase == 0.0 else {}
    if not own:
        period, time = period_of(record), record.time.values
        first = int(np.ceil(time[0] / period - phase - 1e-6))
        last = int(np.floor(time[-1] / period - phase + 1e-6))
        if last < first:
            raise CalibError(f"the record never passes phase {phase} of its period of {period:.6g} s; record more")
        at = (np.arange(first, last + 1) + phase) * period
        present = [channel for channel in ("displacement", "velocity") if channel in record]
        own = {c: np.array([np.interp(at, time, row) for row in record[c].values]) for c in present}
    return xr.Dataset(
        {c: (("body", "cycle"), v, {"units": record[c].attrs.get("units", "")}) for c, v in own.items()},
        coords={"body": record.body.values},
        attrs={"phase": phase},
    )


def section(record: xr.Dataset) -> dict[str, np.ndarray]:
    """Stroboscopic section (body, period) at phase 0 of each channel of the record; empty without one."""
    have = record.variables
    names = [c for c in ("displacement", "velocity") if c in have and f"section_{c}" in have]
    return {c: have[f"section_{c}"].values for c in names}


# --- impacts ---------------------------------------------------------------------------------------------------------


def impacts_per_period(record: xr.Dataset) -> float:
    """Impacts per period of the excitation, NaN where the record does not tell its impacts."""
    if "impact_time" not in record.variables or "frequency" not in record.attrs:
        return float("nan")
    time = record.variables["time"].values
    step = (time[-1] - time[0]) / (time.size - 1)
    periods = (time[-1] - time[0] + step) / period_of(record)
    return record.variables["impact_time"].size / periods


def impact(phase: np.ndarray, velocity: np.ndarray) -> tuple[float, float, float]:
    """Where a closed velocity loop changes fastest: phase, change and duration of its strongest impact.

    The pulse is where the acceleration stands out from its median within +-0.02 periods, around the sample where it
    does so most and down to a tenth of that. Its centroid is the phase of the impact, its integral the change of
    velocity, and the time for which it exceeds 0.2 of its peak the contact time (ends interpolated; an instantaneous
    impact lasts up to 2.7 samples). It is an impact where the change exceeds 5 % of the velocity's amplitude and ten
    standard deviations of its noise.

    Parameters
    ----------
    phase : (n,) uniform over whole periods  [1, in periods]
    velocity : (n,)  [m/s]

    Returns
    -------
    phase of the impact in [0, periods) [1, in periods], change of velocity [m/s], contact time [1, in periods];
    NaN where there is no impact
    """
    none = (float("nan"),) * 3
    size = velocity.size
    spacing = (phase[-1] - phase[0]) / (size - 1)
    half = max(3, round(PULSE / spacing))
    if size < 4 * half:
        return none
    gain = np.roll(velocity, -1) - velocity  # between samples j and j + 1
    around = np.arange(-half, half + 1)
    neighbours = np.lib.stride_tricks.sliding_window_view(np.pad(gain, half, mode="wrap"), around.size)
    excess = gain - np.median(neighbours, axis=1)
    peak = int(np.argmax(np.abs(excess)))
    pulse = np.sign(excess[peak]) * excess[(peak + around) % size]
    weight = _hump(pulse - PULSE_FOOT * pulse[half], half)
    change = float(np.sign(excess[peak]) * pulse[weight > 0.0].sum())
    noise = float(np.median(np.abs(np.diff(velocity, 2)))) / (0.6745 * np.sqrt(6.0))
    if abs(change) <= max(0.025 * np.ptp(velocity), 10.0 * noise):
        return none
    place = peak + 0.5 + (around @ weight) / weight.sum()
    contact = _width(pulse - CONTACT_SHARE * pulse[half], half)
    return float((phase[0] + place * spacing) % (size * spacing)), change, float(spacing * contact)


def _hump(values, centre):
    """Return the values of the stretch around `centre` that is positive, zero elsewhere."""
    negative = np.flatnonzero(values <= 0.0)
    left = negative[negative < centre].max(initial=-1)
    right = negative[negative > centre].min(initial=values.size)
    hump = np.zeros_like(values)
    hump[left + 1 : right] = values[left + 1 : right]
    return hump


def _width(values, centre):
    """Length in samples of the stretch around `centre` that is positive, its ends interpolated."""
    width = 0.0
    for side in (values[centre:], values[centre::-1]):
        below = np.flatnonzero(side <= 0.0)
        end = int(below[0]) if below.size else side.size - 1
        width += end - 1 + side[end - 1] / (side[end - 1] - side[end]) if below.size else end
    return width


# --- kind of motion --------------------------------------------------------------------------------------------------


def kind_of_motion(record: xr.Dataset, tolerance: float = TOLERANCE) -> Motion:
    """Say after how many periods of the excitation a motion returns.

    From the section (64 periods or more, every body and channel): the largest difference of states n = 1..16 periods
    apart, over the later half of the section, as a share of the channel's amplitude, against `tolerance`. A difference
    that shrinks steadily, or falls to half from the first to the last third, belongs to a motion that still settles:
    undecided. Without a section the cycles of the record are compared with its noise (its sigma, otherwise estimated
    from the second differences of its samples): that tells a returning motion from one that does not, but a short
    record is never called irregular.

    Parameters
    ----------
    record : Dataset with displacement or velocity over (body, time), with or without section
    tolerance : share of the amplitude within which a periodic motion returns  [1]
    """
    if "frequency" not in record.attrs:
        return Motion("not periodic", None, "the excitation has no period")
    sections = section(record)
    impacts = impacts_per_period(record)
    if sections and next(iter(sections.values())).shape[1] >= SECTION:
        motion = _from_section(record, sections, tolerance)
    else:
        motion = _from_cycles(record, tolerance)
    kind, evidence = motion.kind, motion.evidence
    if impacts == 0.0:
        kind, evidence = "no contact", f"no impact in the record; {evidence}"
    elif np.isfinite(impacts):
        evidence = f"{evidence}; {impacts:.3g} impact(s) a period"
    return Motion(kind, motion.period, evidence, motion.recurrence, motion.likely, impacts)


def _amplitude(values: np.ndarray) -> float:
    """Half the peak-to-peak value of the body (body, time) that moves most."""
    return float(0.5 * np.ptp(values, axis=-1).max()) or 1.0


def _from_section(record, sections, tolerance):
    states = np.concatenate([values / _amplitude(record.variables[c].values) for c, values in sections.items()])
    size = states.shape[1]
    differences, recurrence = [], []
    for lag in range(1, LAGS + 1):
        difference = np.abs(states[:, lag:] - states[:, :-lag]).max(axis=0)
        differences.append(difference)
        recurrence.append(float(difference[difference.size // 2 :].max()))
        if recurrence[-1] <= tolerance:
            break
    settled = recurrence[-1] <= tolerance
    shrinking = [n for n, d in enumerate(differences, 1) if recurrence[n - 1] > tolerance and _shrinks(d)]
    shrinking = [n for n in shrinking if not settled or (n < lag and lag % n == 0)]
    said = f"over {size} periods the state {{}} of the amplitude (tolerance {tolerance:.0e})"
    if shrinking:
        n = shrinking[0]
        text = f"still settles towards period-{n}: {n} period(s) apart it differs by {recurrence[n - 1]:.1e}, falling,"
        return Motion("undecided", None, said.format(text), tuple(recurrence), n)
    if settled:
        text = said.format(f"returns after {lag} period(s) within {recurrence[-1]:.1e}")
        return Motion(f"period-{lag}", lag, text, tuple(recurrence))
    text = said.format(f"does not return within {LAGS} periods, best after {_best(recurrence)}: {min(recurrence):.1e}")
    return Motion("irregular", None, text, tuple(recurrence))


def _best(recurrence):
    return int(np.argmin(recurrence)) + 1


def _shrinks(difference: np.ndarray) -> bool:
    """Whether differences of states fall steadily: geometrically, or to less than half over the section."""
    third = difference.size // 3
    early, middle, late = difference[:third], difference[third : 2 * third], difference[-third:]
    if late.max() < 0.5 * early.max() and np.median(late) < 0.5 * np.median(early):
        return bool(early.max() >= middle.max() >= late.max())
    logarithm = np.log(np.maximum(difference, 1e-300))
    index = np.arange(logarithm.size) - 0.5 * (logarithm.size - 1)
    slope = (index @ logarithm) / (index @ index)
    rest = logarithm - logarithm.mean() - slope * index
    explained = 1.0 - rest.var() / max(logarithm.var(), 1e-300)
    return bool(slope * logarithm.size < -0.1 and explained > 0.9)


def _from_cycles(record, tolerance):
    cycles, noise = _normalised_cycles(record, tolerance)
    count = cycles.shape[1]
    if count < 2:
        return Motion("undecided", None, "one cycle of the record cannot show whether it returns")
    recurrence = []
    for lag in range(1, min(LAGS, count // 2) + 1):
        difference = cycles[:, lag:] - cycles[:, :-lag]
        spread = np.sqrt((difference**2).mean(axis=(1, 2)))
        recurrence.append(float(spread.max()))
        if (spread <= np.sqrt(2.0) * NOISE * noise).all():
            text = f"{count} cycles of the record return after {lag} period(s) within {NOISE} of their noise"
            return Motion(f"period-{lag}", lag, text, tuple(recurrence))
    text = f"{count} cycles of the record do not return within {len(recurrence)} period(s)"
    if count >= SECTION:
        return Motion("irregular", None, text, tuple(recurrence))
    return Motion("undecided", None, f"{text}, and are too few to call it irregular", tuple(recurrence))


def _normalised_cycles(record, tolerance):
    """Cycles (row, cycle, phase) over the amplitude of their channel, and the deviation of their noise (row,)."""
    period, time = period_of(record), record.variables["time"].values
    cycles, noise = [], []
    for channel in ("displacement", "velocity"):
        if channel in record.variables:
            values = sampled(record, channel)
            amplitude = _amplitude(values)
            cycles.append(cut(time, values, period)[0] / amplitude)
            noise.append(_noise(record, channel, values) / amplitude)
    if not cycles:
        raise CalibError("the kind of a motion is told by displacement or velocity; the record has neither")
    return np.concatenate(cycles), np.maximum(np.concatenate(noise), tolerance / (np.sqrt(2.0) * NOISE))


def _noise(record, channel, values):
    name = f"{channel}_sigma"
    if name in record.variables:
        sigma = record.variables[name].values
        return sigma if sigma.ndim == 1 else np.sqrt((sigma**2).mean(axis=1))
    bend = np.abs(np.diff(values, 2, axis=1))
    return np.median(bend, axis=1) / (0.6745 * np.sqrt(6.0))  # white noise: var of a second difference is 6 sigma^2


def harmonics(loop: np.ndarray, number: int, periods: int = 1) -> np.ndarray:
    """Complex amplitudes (row, number) of harmonics 1..number of the excitation in closed loops (row, phase).

    x(phi) = mean + sum of Re[c_n exp(2 pi i n phi)], phi in periods from the loop's first sample.
    """
    return 2.0 * np.fft.rfft(loop, axis=-1)[..., periods : periods * number + 1 : periods] / loop.shape[-1]
