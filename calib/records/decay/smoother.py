"""The smoother of a free decay: range above the noise, harmonics, other modes, number of splines, noise."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calib.errors import CalibError
from calib.records.decay.analytic_signal import MIN_DECAY_PERIODS, AnalyticSignal, analytic_signal
from calib.records.decay.oscillation import (
    MAX_OSCILLATION_STEPS,
    MAX_TRIAL_STEPS,
    Oscillation,
    SplineBasis,
    fitted,
)
from calib.records.decay.residual import in_period_noise, noise_std, other_mode, outlying

MIN_SIGNAL_TO_NOISE = 5.0  # amplitude over its standard error from one period, below which a decay is left out  [1]
MIN_AMPLITUDE_SHARE = 1e-3  # of the largest amplitude, below which a decay is left out whatever its noise  [1]
FIRST_AMPLITUDE_SHARE = 0.03  # of the largest amplitude, down to which the noise is first looked for  [1]
SPLINE_INTERVALS = 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36  # tried after polynomials of degree 1 and 2  [count]
TIME_SHARE = 0.25  # of a step between breaks; the rest is one of the log amplitude  [1]
MIN_BREAK_PERIODS = 2.0  # between breaks, and for each spline
MAX_WORSE_BASES = 3  # tried in a row after the best
MIN_AKAIKE_WEIGHT = 1e-3  # over that of the best, of fits whose spread counts as uncertainty  [1]
FITTED_HARMONICS = 2, 3  # orders that are fitted beside the motion where they are sampled
SAMPLES_PER_HARMONIC_PERIOD = 2.5  # from which a harmonic differs from its aliases
MAX_OTHER_MODES = 3  # other modes that are fitted beside the dominant one
MAX_RANGE_ROUNDS = 10  # in which range, noise, other modes and splines are found from each other
START_BEND_WEIGHT = 1e-2  # of second differences, against a sample of the largest amplitude  [1]
START_FLOOR = 1e-6  # of the largest amplitude, which the logarithm of the analytic signal's is held above  [1]


@dataclass(frozen=True, eq=False)
class DecayFrame:
    """What the measured record alone decides of the smoother: simulations of it are smoothed alike.

    Attributes
    ----------
    basis : over the range that is analysed
    harmonics : orders of the harmonics fitted
    companions : frequencies of the other modes fitted  [Hz]
    """

    basis: SplineBasis
    harmonics: tuple[int, ...]
    companions: tuple[float, ...] = ()

    def smoothed(self, time: np.ndarray, values: np.ndarray) -> Oscillation:
        """Fit the oscillation to samples (n,) at instants (n,), of which those in the range count."""
        return self.fitted(time, values, analytic_signal(time, values), np.ones(time.size, dtype=bool))

    def fitted(
        self,
        time: np.ndarray,
        values: np.ndarray,
        tone: AnalyticSignal,
        used: np.ndarray,
        steps: int = MAX_OSCILLATION_STEPS,
    ) -> Oscillation:
        """Fit the oscillation to those samples (n,) in the range that are used, whose analytic signal is known."""
        start, end = self.basis.range
        inside = (time >= start) & (time <= end)
        return fitted(
            time[inside],
            values[inside],
            self.basis,
            _start(tone, self.basis),
            self.harmonics,
            self.companions,
            used[inside],
            steps,
        )


class WeightedFit(NamedTuple):
    """A fit with another number of splines, and its Akaike weight."""

    oscillation: Oscillation
    weight: float


@dataclass(frozen=True, eq=False)
class SmoothedDecay:
    """A record of a free decay, smoothed.

    Attributes
    ----------
    frame : how
    oscillation : the fit
    alternatives : fits with fewer or more splines, whose weights add up to at most 1
    outliers : (m,) instants of samples that are left out as outliers  [s]
    noise : standard deviation of white noise of a sample as strong as the record's about the motion's frequency  [unit]
    dominant : frequency of the largest line  [Hz]
    floor : amplitude below which the record is left out  [unit]
    cut : instant from which on it is left out, None where all of it is analysed  [s]
    time, values : (n,) samples that are fitted  [s], [unit]
    start : instant before which the record is left out, None where it begins with the decay  [s]
    disturbed : samples right before it that are left out because the release still disturbs the motion  [count]
    """

    frame: DecayFrame
    oscillation: Oscillation
    alternatives: tuple[WeightedFit, ...]
    outliers: np.ndarray
    noise: float
    dominant: float
    floor: float
    cut: float | None
    time: np.ndarray
    values: np.ndarray
    start: float | None = None
    disturbed: int = 0

    @property
    def without_mean(self) -> tuple[np.ndarray, np.ndarray]:
        """Instants  [s] and values  [unit] of the samples that are fitted, the mean and the other modes subtracted."""
        one, time = self.oscillation, self.time
        splines = one.basis.matrix(time)
        beside = splines @ one.mean
        for frequency, (real, imaginary) in zip(self.frame.companions, one.companions, strict=True):
            turn = 2.0 * np.pi * frequency * time
            beside = beside + splines @ real * np.cos(turn) + splines @ imaginary * np.sin(turn)
        return time, self.values - beside

    @property
    def facts(self) -> dict[str, str | float]:
        """Noise of a sample, floor and ends of the range, and the other modes, as attributes of a Dataset."""
        others = ", ".join(f"{frequency:.4g}" for frequency in self.frame.companions)
        ends = {name: at for name, at in (("start", self.start), ("cut", self.cut)) if at is not None}
        return {
            "noise": self.noise,
            "floor": float(self.floor),
            "other_modes": others,
            "outliers": self.outliers.size,
            **ends,
        }


def smoothed(time: np.ndarray, values: np.ndarray, sigma: float | None = None) -> SmoothedDecay:
    """Smooth a motion that is free from the first sample on: log amplitude and phase as splines.

    The range ends where the amplitude is no longer 5 times its standard error from a single period. The number of
    splines is the next above the one that minimises the corrected Akaike criterion of the residual, demodulated period
    by period, so that only noise about the motion's own frequency counts. At the minimum the bias is as large as the
    noise, and no uncertainty could be stated (undersmoothing). The breaks are denser where the amplitude falls fast.

    Parameters
    ----------
    time, values : (n,)  [s], [unit]
    sigma : standard uncertainty of a sample; where it is None, or the residual says more, the residual's  [unit]

    Raises
    ------
    CalibError : too few samples or periods above the noise

    Source: Hurvich, Tsai, Biometrika 76 (1989) 297 (criterion); Hall, Annals of Statistics 20 (1992) 675
    (undersmoothing); Burnham, Anderson, Model Selection and Multimodel Inference (2002) 4.3 (weights).
    """
    tone = analytic_signal(time, values)
    per_period = (time.size - 1) / ((time[-1] - time[0]) * tone.dominant)
    largest = float(tone.envelope.max())
    harmonics = tuple(m for m in FITTED_HARMONICS if per_period >= SAMPLES_PER_HARMONIC_PERIOD * m)
    frame = DecayFrame(SplineBasis.between(tone.time[[0, -1]], 1), harmonics)
    end, used = _end(tone, FIRST_AMPLITUDE_SHARE * largest), np.ones(time.size, dtype=bool)
    for _ in range(MAX_RANGE_ROUNDS):
        one, alternatives = _selected(time, values, tone, end, frame, used)
        noise = max(sigma or 0.0, noise_std(one))
        floor = max(MIN_SIGNAL_TO_NOISE * noise * np.sqrt(2.0 / per_period), MIN_AMPLITUDE_SHARE * largest)
        mode = other_mode(one, largest) if len(frame.companions) < MAX_OTHER_MODES else None
        outliers = outlying(one)
        steady = np.array_equal(outliers, ~one.used)
        before, end = end, _end(tone, floor)
        if mode is None and steady and abs(end - before) <= tone.period:
            break
        if mode is not None:
            frame = replace(frame, companions=(*frame.companions, mode))
        used = ~np.isin(time, one.time[outliers])
    frame, last = replace(frame, basis=one.basis), one.basis.range[1]
    one = frame.fitted(time, values, tone, ~np.isin(time, one.time[~one.used]))
    return SmoothedDecay(
        frame=frame,
        oscillation=one,
        alternatives=alternatives,
        outliers=one.time[~one.used],
        noise=noise,
        dominant=tone.dominant,
        floor=floor,
        cut=last if last < tone.time[-1] - 0.5 / tone.dominant else None,
        time=one.time[one.used],
        values=values[np.isin(time, one.time[one.used])],
    )


def _end(tone: AnalyticSignal, floor: float) -> int:
    """Last sample before the amplitude falls below a floor.

    Raises
    ------
    CalibError : too few periods before
    """
    first = int(np.argmax(tone.envelope))
    below = np.flatnonzero(tone.envelope[first:] < floor)
    end = first + int(below[0]) if below.size else tone.time.size - 1
    periods = (tone.time[end] - tone.time[0]) * tone.dominant
    if periods < MIN_DECAY_PERIODS:
        raise CalibError(
            f"frequency and damping of a free decay need {MIN_DECAY_PERIODS:.0f} periods with amplitudes above "
            f"{floor:.3g}, got {periods:.1f} at the dominant frequency of {tone.dominant:.4g} Hz; "
            "record longer, or with less noise"
        )
    return end


def _start(tone: AnalyticSignal, basis: SplineBasis) -> np.ndarray:
    """Coefficients (2, size) of log amplitude and phase by the analytic signal, to begin with.

    What the last period of the record says is left out, where the end of the record reaches; second differences of the
    coefficients are held near 0 by a small weight.
    """
    first, last = basis.range
    inside = (tone.time >= first) & (tone.time <= min(last, tone.time[-1] - 1.0 / tone.dominant))
    amplitude = tone.amplitude[inside]
    weight = np.sqrt(amplitude / amplitude.max())[:, None]
    logarithm = np.log(np.maximum(amplitude, START_FLOOR * amplitude.max()))
    right = weight * np.column_stack([logarithm, tone.phase[inside] - 2.0 * np.pi * tone.dominant * tone.time[inside]])
    bends = START_BEND_WEIGHT * np.sqrt(amplitude.size) * np.diff(np.eye(basis.size), 2, axis=0)
    columns = np.vstack([weight * basis.matrix(tone.time[inside]), bends])
    coefficients = np.linalg.lstsq(columns, np.vstack([right, np.zeros((len(bends), 2))]), rcond=None)[0].T
    coefficients[1] += 2.0 * np.pi * tone.dominant * basis.sites
    return np.asarray(coefficients)


def _bases(tone: AnalyticSignal, end: int) -> Iterator[SplineBasis]:
    """Bases of rising size, a line and a parabola first: breaks where the log amplitude has fallen by equal steps.

    A quarter of the step is one of time, for where it does not fall; breaks within two periods of others are left out.
    Where the beginning of the record reaches, the envelope is not trusted to be less than behind.
    """
    time, envelope, reached = tone.time[: end + 1], tone.envelope[: end + 1].copy(), tone.inside.start
    envelope[:reached] = np.maximum(envelope[:reached], envelope[reached])
    fall = np.maximum.accumulate(-np.log(np.maximum(envelope, START_FLOOR * envelope.max())))
    share = (time - time[0]) / (time[-1] - time[0])
    if fall[-1] > fall[0]:
        share = TIME_SHARE * share + (1.0 - TIME_SHARE) * (fall - fall[0]) / (fall[-1] - fall[0])
    apart = MIN_BREAK_PERIODS / tone.dominant
    most = int((time[-1] - time[0]) / apart)
    sizes = {2}
    yield SplineBasis.between(time[[0, -1]], 1)
    if most >= MIN_DECAY_PERIODS:
        yield SplineBasis.between(time[[0, -1]], 2)
    for count in SPLINE_INTERVALS:
        inner = [time[0]]
        for at in np.interp(np.arange(1, count) / count, share, time):
            if at - inner[-1] >= apart and time[-1] - at >= apart:
                inner.append(at)
        basis = SplineBasis.between(np.array([*inner, time[-1]]), 3)
        if basis.size <= most and basis.size not in sizes:
            sizes.add(basis.size)
            yield basis


def _selected(
    time: np.ndarray, values: np.ndarray, tone: AnalyticSignal, end: int, frame: DecayFrame, used: np.ndarray
) -> tuple[Oscillation, tuple[WeightedFit, ...]]:
    """Fit whose number of splines the record decides, and others with their weights."""
    fits, criteria = list[Oscillation](), list[float]()
    for basis in _bases(tone, end):
        one = replace(frame, basis=basis).fitted(time, values, tone, used, MAX_TRIAL_STEPS)
        noise = in_period_noise(one)
        count, free = 2 * noise.size, 2 * basis.size
        if fits and count <= free + 2:
            break
        square = max(float(np.sum(np.abs(noise) ** 2)), np.finfo(float).tiny)
        fits.append(one)
        criteria.append(count * np.log(square / count) + 2.0 * free * count / (count - free - 1.0))
        if len(criteria) - 1 - int(np.argmin(criteria)) >= MAX_WORSE_BASES:
            break
    taken = min(int(np.argmin(criteria)) + 1, len(fits) - 1)
    likelihood = np.exp(-0.5 * (np.array(criteria) - min(criteria)))
    weights = np.where(likelihood < MIN_AKAIKE_WEIGHT, 0.0, likelihood) / likelihood.sum()
    return fits[taken], tuple(WeightedFit(fits[k], float(weights[k])) for k in np.flatnonzero(weights) if k != taken)
