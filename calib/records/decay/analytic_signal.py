"""Dominant frequency, amplitude and phase of sampled values by their analytic signal."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from calib.errors import CalibError

PASS_BAND = 0.5, 1.6  # of the dominant frequency, that the band-pass leaves  [1]
BAND_PASS_ORDER = 2  # of the Butterworth band-pass, run forwards and backwards
MIN_DECAY_PERIODS = 4.0  # of an oscillation whose frequency and damping are told
MIN_DECAY_SAMPLES_PER_PERIOD = 4.0  # of an oscillation whose frequency and damping are told
MIN_DECAY_SAMPLES = int(MIN_DECAY_PERIODS * MIN_DECAY_SAMPLES_PER_PERIOD)  # [count]
END_PERIODS = 6.0  # by which values are continued beyond their ends
ZERO_PADDING = 4  # length of the transform over that of the values, so that its largest line is near the true one


@dataclass(frozen=True, eq=False)
class AnalyticSignal:
    """Values in the band about their dominant frequency, as amplitude and phase.

    Attributes
    ----------
    time : (n,) uniform  [s]
    dominant : frequency of the largest line of the spectrum  [Hz]
    amplitude, phase : (n,) of the values  [their unit], [rad]
    """

    time: np.ndarray
    dominant: float
    amplitude: np.ndarray
    phase: np.ndarray

    @property
    def period(self) -> int:
        """Samples of a period of the dominant frequency."""
        return max(1, round(1.0 / (self.dominant * (self.time[1] - self.time[0]))))

    @property
    def frequency(self) -> np.ndarray:
        """Instantaneous frequency (n,), the phase averaged over one period first  [Hz]."""
        return np.asarray(np.gradient(self._averaged(self.phase), self.time) / (2.0 * np.pi))

    @property
    def decay_rate(self) -> np.ndarray:
        """Rate (n,) at which the logarithm of the amplitude falls, averaged over one period first  [1/s]."""
        floor = np.finfo(float).tiny
        return -np.asarray(np.gradient(self._averaged(np.log(np.maximum(self.amplitude, floor))), self.time))

    @cached_property
    def envelope(self) -> np.ndarray:
        """Amplitude (n,), its root mean square over a period  [unit]."""
        count = min(self.period, self.time.size)
        padded = np.pad(self.amplitude**2, (count // 2, (count - 1) // 2), "edge")
        return np.asarray(np.sqrt(np.maximum(scipy.signal.fftconvolve(padded, np.ones(count), "valid") / count, 0.0)))

    @property
    def inside(self) -> slice:
        """Samples that the ends of the record do not reach through the band-pass: all but two periods at each."""
        return slice(2 * self.period, self.time.size - 2 * self.period)

    def _averaged(self, values: np.ndarray) -> np.ndarray:
        count = 2 * (self.period // 2) + 1
        slope = (values[-1] - values[0]) / (values.size - 1) * np.arange(values.size)  # what remains may be mirrored
        return np.asarray(
            scipy.signal.fftconvolve(_mirrored(values - slope, count), np.ones(count) / count, "valid") + slope
        )


def _mirrored(values: np.ndarray, count: int) -> np.ndarray:
    return np.pad(values, count // 2, mode="reflect", reflect_type="odd")


def dominant_frequency(time: np.ndarray, values: np.ndarray) -> float:
    """Frequency of the largest line of the spectrum of values (n,), their mean removed  [Hz].

    time : (n,) increasing; where it is not uniform, values are interpolated linearly  [s]
    """
    values = np.interp(np.linspace(time[0], time[-1], time.size), time, values)
    window = scipy.signal.windows.hann(values.size, sym=False)
    size = ZERO_PADDING * values.size
    power = np.abs(np.fft.rfft(window * (values - values.mean()), size)) ** 2
    lowest = 2 * ZERO_PADDING  # lines below are of the mean, through the window
    top = lowest + int(np.argmax(power[lowest:-1]))
    before, at, after = np.log(np.maximum(power[top - 1 : top + 2], np.finfo(float).tiny))
    bend = before - 2.0 * at + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    interval = (time[-1] - time[0]) / (time.size - 1)
    return float((top + np.clip(shift, -0.5, 0.5)) / (size * interval))


def analytic_signal(time: np.ndarray, values: np.ndarray) -> AnalyticSignal:
    """Amplitude and phase of values about their dominant frequency, by a band-pass and the Hilbert transform.

    Parameters
    ----------
    time : (n,) increasing; where it is not uniform, values are interpolated linearly  [s]
    values : (n,)

    Raises
    ------
    CalibError : too few samples, or samples a period, or a constant

    Source: Feldman, Mechanical Systems and Signal Processing 8 (1994) 119-127 (FREEVIB).
    """
    if time.size < MIN_DECAY_SAMPLES:
        raise CalibError(
            f"frequency and damping of a free decay need at least {MIN_DECAY_SAMPLES} samples, got {time.size}; "
            "record longer, or at a higher rate"
        )
    if np.ptp(values) == 0.0:
        raise CalibError(f"expected a motion that decays, got the constant {values[0]:.4g}; leave this channel out")
    uniform = np.linspace(time[0], time[-1], time.size)
    even = np.interp(uniform, time, values)
    dominant = dominant_frequency(uniform, even)
    rate = (uniform.size - 1) / (uniform[-1] - uniform[0])
    if rate < MIN_DECAY_SAMPLES_PER_PERIOD * dominant:
        raise CalibError(
            f"frequency and damping of a free decay need at least {MIN_DECAY_SAMPLES_PER_PERIOD:.0f} samples a period, "
            f"got {rate / dominant:.2g} at the dominant frequency of {dominant:.4g} Hz; record at a higher rate"
        )
    low, high = (dominant * share for share in PASS_BAND)
    even = even - even.mean()
    if high < 0.49 * rate:
        band = scipy.signal.butter(BAND_PASS_ORDER, (low, high), "bandpass", fs=rate, output="sos")
    else:
        band = scipy.signal.butter(BAND_PASS_ORDER, low, "highpass", fs=rate, output="sos")
    padding = min(even.size - 1, int(END_PERIODS * rate / dominant))
    passed = scipy.signal.sosfiltfilt(band, even, padlen=padding)
    analytic = scipy.signal.hilbert(_faded(passed, padding))[padding : padding + even.size]
    return AnalyticSignal(uniform, dominant, np.abs(analytic), np.unwrap(np.angle(analytic)))


def _faded(values: np.ndarray, padding: int) -> np.ndarray:
    """Values continued beyond both ends by their mirror image, which fades.

    Otherwise the step from the last sample to the first, as large as the first amplitude, would reach the small ones.
    """
    fade = np.pad(np.ones(values.size), padding, "linear_ramp")
    return _mirrored(values, 2 * padding) * np.square(np.sin(0.5 * np.pi * fade))
