"""The kind of a motion: after how many periods of the excitation it returns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records.cycles.bad_samples import without_bad_samples
from calib.records.cycles.impacts import impacts_per_period
from calib.records.cycles.loop import cut, cycles_in, period_of, sampled, samples_in_step
from calib.records.cycles.mean_cycle import IN_STEP_TOLERANCE, mean_cycle
from calib.records.cycles.stroboscopic import section
from calib.records.record import MIN_SECTION_PERIODS, STATE
from calib.records.white_noise import MAD_PER_STD, white_noise_std

MAX_PERIOD = 16  # periods of the excitation: the longest return that is distinguishable from irregular motion
CYCLE_RETURN_TOLERANCE = 1e-3  # of the amplitude, within which a periodic motion returns
MAX_NOISE_RATIO = 1.5  # of the difference of a measured cycle that returns to its noise, in standard deviations
MIN_CYCLES_OF_MEAN = 4  # for each period tried on freely sampled cycles
MAX_JUMP_SHARE = 0.01  # of the samples of a cycle that jumps of the velocity may have before them or behind them  [1]
MAX_RESIDUAL = 0.01  # of the amplitude: residual about a mean cycle of few samples
LIMITS_OF_RECORD = "; a record alone does not distinguish chaotic from quasi-periodic motion, or from a longer period"
MIN_SHRINKING_DIFFERENCES = 6  # count: fewer show no trend
BESIDE_ATTRIBUTE = "beside"  # attribute of a simulated record: what is known of other motions at the same parameters
IRREGULAR, UNDECIDED, NO_CONTACT, NOT_PERIODIC = "irregular", "undecided", "no contact", "not periodic"
SWEPT = "a sweep"  # the motions of a frequency response, which are many
WITHOUT_KIND = (NOT_PERIODIC, SWEPT)


@dataclass(frozen=True)
class MotionKind:
    """Kind of a motion, with its evidence.

    Attributes
    ----------
    kind : "period-1" (2, ...), "irregular", "undecided", "no contact" (only of a record that lists its contacts) or
        "not periodic" (the excitation has no period) or "a sweep" (of a frequency response, whose motions are many)
    period : periods of the excitation after which the motion returns, None where that is not known
    evidence : one sentence with the numbers on which the kind was decided
    recurrence : difference of the states n = 1, 2, ... periods apart, as a share of the amplitude; up to the period
    likely : of an undecided motion, the period that it is settling to, where it is identified
    impacts : impacts per period, NaN where the record does not list them; reported, not part of the kind
    """

    kind: str
    period: int | None
    evidence: str
    recurrence: tuple[float, ...] = ()
    likely: int | None = None
    impacts: float = float("nan")


def kind_of_motion(record: xr.Dataset) -> MotionKind:
    """Return the kind of a motion: after how many periods of the excitation it returns.

    From the section (64 periods or more, every body and channel): the largest difference of states n = 1..16 periods
    apart, over the later half of the section, as a share of the channel's amplitude, against `CYCLE_RETURN_TOLERANCE`.
    A difference that shrinks steadily, or halves from the first to the last third, belongs to a motion that still
    settles: undecided. Without a section the cycles of the record are compared with its noise (its sigma, otherwise
    estimated from second differences of what its mean cycle leaves): that distinguishes a returning motion from one
    that does not return, but a short record is never called irregular. A shorter return counts where cycles differ from
    it at jumps of the velocity alone. Where this leaves it undecided, a section of fewer than 64 periods may show a
    return, or that the motion still settles. A record that was read from a closed curve states after how many periods
    it returns (attribute `returns_after`), and a simulated one which motions coexist with its own (attribute `beside`).

    To distinguish chaotic motion from quasi-periodic motion or one of a long period takes the simulator's own map; see
    `calib.dynamics.motion`.

    Parameters
    ----------
    record : Dataset with displacement or velocity over (body, time), with or without section
    """
    if "frequency" not in record.attrs:
        return MotionKind(NOT_PERIODIC, None, "the excitation has no period")
    sections = section(record)
    impacts = impacts_per_period(record)
    if sections and next(iter(sections.values())).shape[1] >= MIN_SECTION_PERIODS:
        motion = _from_section(record, sections)
    else:
        motion = _from_cycles(record)
        if motion.kind == UNDECIDED and sections:
            motion = _from_short_section(record, sections, motion)
    kind, evidence = motion.kind, motion.evidence
    if impacts == 0.0 and record.attrs.get("contact_fraction", 0.0) > 0.0:
        evidence = f"in contact without an impact; {evidence}"
    elif impacts == 0.0:
        kind, evidence = NO_CONTACT, f"no impact in the record; {evidence}"
    elif np.isfinite(impacts):
        evidence = f"{evidence}; {impacts:.3g} impact(s) a period"
    if BESIDE_ATTRIBUTE in record.attrs:
        evidence = f"{evidence}; {record.attrs[BESIDE_ATTRIBUTE]}"
    return MotionKind(kind, motion.period, evidence, motion.recurrence, motion.likely, impacts)


def _amplitude(values: np.ndarray) -> float:
    """Half the peak-to-peak value of the body (body, time) that moves most."""
    return float(0.5 * np.ptp(values, axis=-1).max()) or 1.0


def _from_section(record: xr.Dataset, sections: Mapping[str, np.ndarray]) -> MotionKind:
    states = np.concatenate([values / _amplitude(record.variables[c].values) for c, values in sections.items()])
    size = states.shape[1]
    differences, recurrence = list[np.ndarray](), list[float]()
    for lag in range(1, MAX_PERIOD + 1):
        difference = np.abs(states[:, lag:] - states[:, :-lag]).max(axis=0)
        differences.append(difference)
        recurrence.append(float(difference[difference.size // 2 :].max()))
        if recurrence[-1] <= CYCLE_RETURN_TOLERANCE:
            break
    settled = recurrence[-1] <= CYCLE_RETURN_TOLERANCE
    shrinking = [n for n, d in enumerate(differences, 1) if recurrence[n - 1] > CYCLE_RETURN_TOLERANCE and _shrinks(d)]
    shrinking = [n for n in shrinking if not settled or (n < lag and lag % n == 0)]
    sentence = f"over {size} periods the state {{}} of the amplitude (tolerance {CYCLE_RETURN_TOLERANCE:.0e})"
    if shrinking:
        n = shrinking[0]
        text = f"still settles towards period-{n}: {n} period(s) apart it differs by {recurrence[n - 1]:.1e}, falling,"
        return MotionKind(UNDECIDED, None, sentence.format(text), tuple(recurrence), n)
    if settled:
        text = sentence.format(f"returns after {lag} period(s) within {recurrence[-1]:.1e}")
        return MotionKind(f"period-{lag}", lag, text, tuple(recurrence))
    text = f"does not return within {MAX_PERIOD} periods, best after {_best(recurrence)}: {min(recurrence):.1e}"
    return MotionKind(IRREGULAR, None, sentence.format(text) + LIMITS_OF_RECORD, tuple(recurrence))


def _from_short_section(record: xr.Dataset, sections: Mapping[str, np.ndarray], undecided: MotionKind) -> MotionKind:
    """Kind from a section of few periods, where the cycles of the record leave it undecided.

    A motion returns that does so over all of its later half, and over more periods than it takes to return; that it
    does not return, few periods cannot show.
    """
    states = np.concatenate([values / _amplitude(record.variables[c].values) for c, values in sections.items()])
    size, recurrence = states.shape[1], list[float]()
    for lag in range(1, min(MAX_PERIOD, size // 2) + 1):
        difference = np.abs(states[:, lag:] - states[:, :-lag]).max(axis=0)
        recurrence.append(float(difference[difference.size // 2 :].max()))
        if recurrence[-1] <= CYCLE_RETURN_TOLERANCE:
            text = (
                f"over {size - 1} periods, too few to tell more, the state returns after {lag} period(s) within "
                f"{recurrence[-1]:.1e} of the amplitude (tolerance {CYCLE_RETURN_TOLERANCE:.0e})"
            )
            return MotionKind(f"period-{lag}", lag, text, tuple(recurrence))
        if difference.size >= MIN_SHRINKING_DIFFERENCES and _shrinks(difference):
            text = (
                f"over {size - 1} periods, too few to tell more, the state still settles towards period-{lag}: {lag} "
                f"period(s) apart it differs by {recurrence[-1]:.1e} of the amplitude, falling"
            )
            return MotionKind(UNDECIDED, None, text, tuple(recurrence), lag)
    if not recurrence:
        return undecided
    text = f"{undecided.evidence}; at phase 0 the state of {size - 1} periods differs by {min(recurrence):.1e} at best"
    return MotionKind(UNDECIDED, None, text, tuple(recurrence))


def _best(recurrence: Sequence[float]) -> int:
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


def _from_cycles(record: xr.Dataset) -> MotionKind:
    period, time = period_of(record), record.variables["time"].values
    count, own, _ = cycles_in(time, period, 1)
    if count <= record.attrs.get("returns_after", 0):
        return _stated(record)
    if count >= 2 and not samples_in_step(time, period, own, count, IN_STEP_TOLERANCE):
        return _from_mean_cycles(record, period, count)
    cycles, noise = _normalised_cycles(record)
    count = cycles.shape[1]
    if count < 2:
        return MotionKind(UNDECIDED, None, "one cycle of the record cannot show whether it returns")
    motion = _compared(cycles, noise, _states_noise(record))
    if motion.period is None and (mended := without_bad_samples(cycles, noise)) is not None:
        again = _compared(mended.cycles, noise, _states_noise(record))
        if again.period is not None:
            left_out = f"; {mended.samples} samples in {mended.stretches} stretch(es) are left out as bad"
            return replace(again, evidence=again.evidence + left_out)
    return motion


def _compared(cycles: np.ndarray, noise: np.ndarray, stated: np.ndarray) -> MotionKind:
    """Kind by the differences of cycles (row, cycle, phase), against noise (row,) that the record states or not."""
    count = cycles.shape[1]
    differences = [cycles[:, lag:] - cycles[:, :-lag] for lag in range(1, min(MAX_PERIOD, count // 2) + 1)]
    spreads = np.array([np.sqrt((difference**2).mean(axis=(1, 2))) for difference in differences])
    if count >= MIN_CYCLES_OF_MEAN:
        noise = np.where(stated, noise, _least_deviation(spreads / np.sqrt(2.0), noise))
    recurrence = spreads.max(axis=1).tolist()
    limit = np.sqrt(2.0) * MAX_NOISE_RATIO * noise
    for lag, spread in enumerate(spreads, 1):
        if (spread <= limit).all():
            shorter = (n for n in range(1, lag) if lag % n == 0 and _returns_but_at_jumps(differences[n - 1], limit))
            own = next(shorter, lag)
            text = f"{count} cycles of the record return after {own} period(s) within {MAX_NOISE_RATIO} of their noise"
            return MotionKind(f"period-{own}", own, text, tuple(recurrence[:own]))
    text = f"{count} cycles of the record do not return within {len(recurrence)} period(s)"
    if count >= MIN_SECTION_PERIODS:
        return MotionKind(IRREGULAR, None, text + LIMITS_OF_RECORD, tuple(recurrence))
    return MotionKind(UNDECIDED, None, f"{text}, and are too few to call it irregular", tuple(recurrence))


def _returns_but_at_jumps(difference: np.ndarray, limit: np.ndarray) -> bool:
    """Whether cycles that are n periods apart differ (row, pair, phase) by less than a limit (row,) but at few phases.

    A sample at an impact is before it in one cycle and behind it in another, as rounding and the clock have it: two
    such samples may be alike in every second cycle by chance.
    """
    square = np.sort((difference**2).mean(axis=1), axis=1)
    most = square.shape[1] - int(MAX_JUMP_SHARE * square.shape[1])
    return bool((np.sqrt(square[:, :most].mean(axis=1)) <= limit).all())


def _from_mean_cycles(record: xr.Dataset, period: float, count: int) -> MotionKind:
    """Kind of a record whose clock runs freely: by its residuals about mean cycles of 1, 2, ... periods.

    A motion returns after so many periods where the residuals about no longer cycle are much smaller, and these are
    small themselves. Their size is taken from the median of their absolute values: a jump of velocity between samples
    makes a residual about any cycle, but at few instants. The steps of a converter repeat wherever samples fall on the
    same phases again, and set a lower bound. So do samples that fall on the same phases after n periods, between which
    a mean of n periods need not be right: a shorter cycle is preferred whose mean, with knots as near as the samples of
    all cycles allow, leaves as little.
    """
    time = record.variables["time"].values
    present = _state_channels(record)
    values = [sampled(record, channel) for channel in present]
    amplitude = np.concatenate([np.full(len(v), _amplitude(v)) for v in values])
    noise = np.concatenate([_noise(record, c, v) for c, v in zip(present, values, strict=True)]) / amplitude
    stacked, sizes = np.concatenate(values) / amplitude[:, None], list[np.ndarray]()
    for lag in range(1, max(1, min(MAX_PERIOD, count // MIN_CYCLES_OF_MEAN)) + 1):
        sizes.append(_deviation(time, stacked, period, lag))
        if (sizes[-1] <= MAX_NOISE_RATIO * np.maximum(noise, CYCLE_RETURN_TOLERANCE)).all():
            break
    deviations = np.array(sizes)
    steps = np.concatenate([_steps(v) for v in values]) / (4.0 * MAD_PER_STD * amplitude)  # median: a fourth
    limit = MAX_NOISE_RATIO * _least_deviation(deviations, noise, steps)
    returning = np.flatnonzero((deviations <= limit).all(axis=1))
    recurrence = tuple(float(np.sqrt(2.0) * d.max()) for d in deviations)
    if not returning.size:
        text = f"{count} cycles of the record, sampled freely, do not return within {len(sizes)} period(s)"
        return MotionKind(UNDECIDED, None, text, recurrence)
    n = int(returning[0]) + 1
    for lag in [divisor for divisor in range(1, n) if n % divisor == 0]:
        finer = _deviation(time, stacked, period, lag, refined=True)
        if (finer <= limit).all():
            n, deviations[lag - 1] = lag, finer
            break
    text = f"its {count} cycles leave {deviations[n - 1].max():.1e} of the amplitude about a mean of {n} period(s)"
    return MotionKind(f"period-{n}", n, text, recurrence[:n])


def _deviation(time: np.ndarray, rows: np.ndarray, period: float, lag: int, refined: bool = False) -> np.ndarray:
    """Standard deviation (row,) of samples (row, n) about their mean cycle of `lag` periods, by the median."""
    mean = mean_cycle(time, rows, period, lag, refined=refined)
    free = max(0.1, 1.0 - mean.parameters / time.size)
    return np.median(np.abs(mean.residual), axis=1) / (MAD_PER_STD * np.sqrt(free))


def _least_deviation(deviations: np.ndarray, noise: np.ndarray, floor: np.ndarray | float = 0.0) -> np.ndarray:
    """Standard deviation (row,) of the noise of a motion that returns: the least over the periods tried (lag, row).

    Noise with memory, which second differences do not show, is as large whatever the period tried is. A least deviation
    that is neither small nor within the noise (row,) belongs to a motion that does not return. All as shares of the
    amplitude, and `floor` (row,) at least.
    """
    least = np.maximum(np.maximum(deviations.min(axis=0), CYCLE_RETURN_TOLERANCE), floor)
    return np.minimum(least, np.maximum(noise, MAX_RESIDUAL))


def _stated(record: xr.Dataset) -> MotionKind:
    """Kind of a record that is one closed curve: it returns after as many periods as the record states."""
    n = int(record.attrs["returns_after"])
    return MotionKind(
        f"period-{n}", n, f"the record is a closed curve, which returns after {n} period(s) by its source"
    )


def _normalised_cycles(record: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Cycles (row, cycle, phase) over the amplitude of their channel, and the deviation of their noise (row,)."""
    period, time = period_of(record), record.variables["time"].values
    cycles, noise = [], []
    for channel in _state_channels(record):
        values = sampled(record, channel)
        amplitude = _amplitude(values)
        cycles.append(cut(time, values, period)[0] / amplitude)
        noise.append(_noise(record, channel, values) / amplitude)
    return np.concatenate(cycles), np.maximum(
        np.concatenate(noise), CYCLE_RETURN_TOLERANCE / (np.sqrt(2.0) * MAX_NOISE_RATIO)
    )


def _state_channels(record: xr.Dataset) -> list[str]:
    """Return the channels from which the kind of a motion is decided."""
    present = [channel for channel in STATE if channel in record.variables]
    if not present:
        raise CalibError("the kind of a motion needs displacement or velocity, and the record has neither; add one")
    return present


def _noise(record: xr.Dataset, channel: str, values: np.ndarray) -> np.ndarray:
    """Standard deviation (row,) of the noise of a channel, that of the steps of its converter at least.

    That which the record states, or else that of white noise by second differences: of the samples, or of what their
    mean cycle leaves, of which the motion itself has no part.
    """
    name = f"{channel}_sigma"
    if name in record.variables:
        sigma = record.variables[name].values
        sigma = sigma if sigma.ndim == 1 else np.sqrt((sigma**2).mean(axis=1))
    else:
        mean = mean_cycle(record.variables["time"].values, values, period_of(record), refined=False)
        free = np.sqrt(max(0.1, 1.0 - mean.parameters / values.shape[1]))
        sigma = np.minimum(white_noise_std(values, order=2), white_noise_std(mean.residual, order=2) / free)
    return np.maximum(sigma, _steps(values) / np.sqrt(12.0))


def _states_noise(record: xr.Dataset) -> np.ndarray:
    """Whether the record states the standard deviation of the noise, for each row of its state."""
    return np.repeat([f"{c}_sigma" in record.variables for c in _state_channels(record)], record.sizes["body"])


def _steps(values: np.ndarray) -> np.ndarray:
    """Steps (row,) between the levels of a channel (row, n) that has fewer than half its samples; 0 of any other."""
    levels = [np.unique(row) for row in values]
    return np.array([np.median(np.diff(own)) if 1 < own.size < 0.5 * values.shape[1] else 0.0 for own in levels])
