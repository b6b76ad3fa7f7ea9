"""What the fit of a decay leaves: the noise about the motion's frequency, and other modes."""

import numpy as np
import scipy

from calib.records.decay.oscillation import Oscillation

PRIOR_NOISE_PERIODS = 8.0  # for which the residual over all frequencies counts in the noise about the motion's own
MODE_SHARE = 0.002  # of the dominant amplitude, from which another mode is fitted  [1]
MODE_POWER = 40.0  # of a line over the median of the residual's spectrum  [1]
MIN_MODE_DISTANCE = 0.08  # of the dominant frequency, from the multiples of what it passes through  [1]
MIN_MODE_BEATS = 4.0  # of two modes in the record, which are told from one that changes
MIN_MODE_FREQUENCY = 0.3  # of the dominant frequency; below, it is a mean that moves  [1]
OUTLIER_MEDIANS = 12.0  # of the residual's magnitude nearby, beyond which a sample is an outlier: 8 standard deviations
OUTLIER_SHARE = 0.5  # of the largest residual nearby, of what is left out together with it  [1]
OUTLIER_PERIODS = 3.0  # over which the magnitude nearby is taken
MIN_WHOLE_PERIOD = 0.5  # of the median number of samples of a period, for a period that counts  [1]


def in_period_noise(one: Oscillation) -> np.ndarray:
    """Complex amplitude (period,) of the residual at the motion's own phase, period by period  [unit].

    Each is scaled so that all have the variance of a period of median length.
    """
    residual = one.residual[one.used]
    phase = (one.basis.matrix(one.time) @ one.phase)[one.used]
    turns = np.floor((phase - phase.min()) / (2.0 * np.pi)).astype(int)
    count = np.bincount(turns)
    sums = np.bincount(turns, np.cos(phase) * residual) - 1j * np.bincount(turns, np.sin(phase) * residual)
    usual = float(np.median(count[count > 0]))
    whole = count >= MIN_WHOLE_PERIOD * usual
    return np.asarray(2.0 * sums[whole] / np.sqrt(count[whole] * usual))


def noise_std(one: Oscillation) -> float:
    """Standard deviation of white noise of a sample as strong as the residual about the motion's frequency  [unit].

    White noise of variance s^2 gives each part of the complex amplitude of a period of n samples 2 s^2 / n. The
    residual over all frequencies counts as some periods more, which few periods alone would tell badly.
    """
    noise, residual = in_period_noise(one), one.residual[one.used]
    unknowns = one.basis.size * (one.linear_terms + 2)
    everywhere = float(residual @ residual) / max(residual.size - unknowns, 1)
    near = 0.5 * residual.size / noise.size * float(np.sum(np.abs(noise) ** 2))
    free = max(2.0 * noise.size - 2.0 * one.basis.size, 0.0)
    return float(np.sqrt((near + 2.0 * PRIOR_NOISE_PERIODS * everywhere) / (free + 2.0 * PRIOR_NOISE_PERIODS)))


def outlying(one: Oscillation) -> np.ndarray:
    """Whether the residual (n,) of a sample is far beyond those nearby.

    Where several are, only those of at least half the largest: an outlier bends the fit away from its neighbours.

    Source: Hampel's identifier; Pearson, IEEE Transactions on Control Systems Technology 10 (2002) 55.
    """
    size = np.abs(one.residual)
    turns = np.ptp(one.basis.matrix(one.time) @ one.phase) / (2.0 * np.pi)
    window = 2 * int(0.5 * OUTLIER_PERIODS * size.size / turns) + 1
    limit = OUTLIER_MEDIANS * scipy.ndimage.median_filter(size, window, mode="nearest")
    largest = scipy.ndimage.maximum_filter(np.where(one.used, size, 0.0), window, mode="nearest")
    return np.asarray((size > limit) & (size > OUTLIER_SHARE * largest))


def other_mode(one: Oscillation, largest: float) -> float | None:
    """Frequency of a mode that stands out of the residual, away from multiples of the one that is fitted  [Hz].

    largest : amplitude of the one that is fitted  [unit]
    """
    time, residual = one.time[one.used], one.residual[one.used]
    uniform = np.linspace(time[0], time[-1], time.size)
    length = time[-1] - time[0]
    values = np.interp(uniform, time, residual)
    frequency, power = scipy.signal.periodogram(values, (time.size - 1) / length, "hann", scaling="spectrum")
    own = one.basis.matrix(uniform, 1) @ one.phase / (2.0 * np.pi)
    low, high = float(own.min()), float(own.max())
    margin = max(MIN_MODE_DISTANCE * high, MIN_MODE_BEATS / length)
    order = np.maximum(np.round(2.0 * frequency / (low + high)), 1.0)
    apart = (frequency < order * low - margin) | (frequency > order * high + margin)
    apart &= frequency > MIN_MODE_FREQUENCY * low
    if not apart.any():
        return None
    top = int(np.argmax(np.where(apart, power, 0.0)))
    stands_out = power[top] > MODE_POWER * float(np.median(power[1:]))
    return float(frequency[top]) if stands_out and np.sqrt(2.0 * power[top]) > MODE_SHARE * largest else None
