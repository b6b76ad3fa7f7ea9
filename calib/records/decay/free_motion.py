"""The decay of a record from where its motion is free: behind a rest, clipped crests and a disturbed release."""

from dataclasses import replace

import numpy as np

from calib.errors import CalibError
from calib.records.clipping import clipped_runs
from calib.records.decay.analytic_signal import MIN_DECAY_PERIODS, dominant_frequency
from calib.records.decay.backcast import disturbed_samples, first_periods_stand_out
from calib.records.decay.release import release
from calib.records.decay.smoother import SmoothedDecay, smoothed

MAX_CREST_DISTANCE = 2.0  # periods from one clipped crest to the next, or to the beginning  [1]
BACKCAST_PERIODS = 2.0, 4.0  # from the beginning on, behind which a decay is fitted to be continued to it  [periods]
MIN_DISTURBED_NOISE_RATIO = 1.3  # noise of a decay over that of the fit behind a disturbed beginning  [1]
MAX_DISTURBANCES = 3  # that are left out one behind the other


def smoothed_decay(time: np.ndarray, values: np.ndarray, sigma: float | None = None) -> SmoothedDecay:
    """Smooth a free decay from its release on, or from behind the last crest at the limit of a converter.

    A magnet or a hand that lets go with a jerk, or slips, disturbs the motion for some time. Splines that follow this
    leave a large residual in the first periods. Where they do, the decay is fitted from two periods on, or from four,
    and continued to its beginning (backcast): what lies many standard errors off, before a period that follows, is left
    out, if the noise about the motion is the less for it.

    Parameters
    ----------
    time, values : (n,)  [s], [unit]
    sigma : standard uncertainty of a sample; where it is None, or the residual says more, the residual's  [unit]

    Raises
    ------
    CalibError : too few samples or periods above the noise
    """
    first = _first_free(time, values)
    decay = smoothed(time[first:], values[first:], sigma)
    disturbed = 0
    for _ in range(MAX_DISTURBANCES):
        begin = first + disturbed
        count = _disturbed(decay, time[begin:], values[begin:], sigma)
        if not count:
            break
        disturbed += count
        decay = smoothed(time[begin + count :], values[begin + count :], sigma)
    begin = first + disturbed
    return replace(decay, start=float(time[begin]) if begin else None, disturbed=disturbed)


def _disturbed(decay: SmoothedDecay, time: np.ndarray, values: np.ndarray, sigma: float | None) -> int:
    """Number of samples that a decay begins with before its motion is free."""
    if not first_periods_stand_out(decay.oscillation):
        return 0
    for periods in BACKCAST_PERIODS:
        begin = int(np.searchsorted(time, time[0] + periods / decay.dominant))
        try:
            behind = smoothed(time[begin:], values[begin:], sigma)
        except CalibError:  # too few periods behind
            return 0
        if behind.noise * MIN_DISTURBED_NOISE_RATIO > decay.noise:
            continue
        if count := disturbed_samples(behind, time[:begin], values[:begin]):
            return count
    return 0


def _first_free(time: np.ndarray, values: np.ndarray) -> int:
    """Index of the first sample (n,) from which on the motion is free, its crests below the limit of a converter.

    Raises
    ------
    CalibError : too few periods are below that limit
    """
    first = release(time, values)
    return first + _clipped(time[first:], values[first:])


def _clipped(time: np.ndarray, values: np.ndarray) -> int:
    """Samples up to the end of the clipped crests that values (n,) begin with; other equal values are outliers."""
    runs = clipped_runs(values)
    if not runs.size:
        return 0
    period = 1.0 / dominant_frequency(time, values)
    behind = np.concatenate([[time[0]], time[runs[:-1, 1]]])
    apart = time[runs[:, 0]] - behind > MAX_CREST_DISTANCE * period
    crests = runs[: int(np.argmax(apart))] if apart.any() else runs
    if not len(crests):
        return 0
    end = int(crests[-1, 1])
    if time[-1] - time[end] < MIN_DECAY_PERIODS * period:
        raise CalibError(
            f"the decay is clipped until {time[end]:.4g} s: its largest samples are equal, a converter or an amplifier "
            f"being at its limit; expected {MIN_DECAY_PERIODS:g} periods behind them; record again in a wider range"
        )
    return end
