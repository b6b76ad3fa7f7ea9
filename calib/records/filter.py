"""The zero-phase low-pass of sampled values."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from calib.errors import CalibError
from calib.units import plain_number

FILTER_ORDER = 4  # of the Butterworth low-pass, run forwards and backwards
UNIFORMITY_TOLERANCE = 1e-3  # of a step: largest deviation of a sample from the uniform grid  [1]
ROUNDING_TOLERANCE = 1e-6  # of the resolution of rounded instants: what doubles add to it  [1]


def low_pass(values: np.ndarray, time: np.ndarray, cutoff: float) -> np.ndarray:
    """Zero-phase low-pass of uniformly sampled values: a Butterworth filter, run forwards and backwards.

    Parameters
    ----------
    values : (..., n)
    time : (n,)  [s]
    cutoff : where the two passes together halve the amplitude  [Hz]
    """
    steps = np.diff(time)
    if steps.size == 0 or (steps <= 0.0).any():
        hint = rounding_hint(time)
        increasing = "a time that increases from one to the next"
        raise CalibError(f"a low-pass needs at least two samples, and {increasing}{hint and f'; {hint}'}")
    rate = steps.size / (time[-1] - time[0])
    if np.abs((time - time[0]) * rate - np.arange(time.size)).max() > UNIFORMITY_TOLERANCE:
        hint = rounding_hint(time)
        raise CalibError(
            f"a low-pass needs uniform samples, but the steps vary from {steps.min():.6g} s to {steps.max():.6g} s; "
            f"{hint and f'{hint}; else '}resample them or drop the cutoff"
        )
    if not 0.0 < cutoff < 0.5 * rate:
        raise CalibError(
            f"a cutoff must lie between 0 and half the sampling rate ({0.5 * rate:.6g} Hz), got {cutoff:.6g} Hz"
        )
    filter_ = butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    padding = min(values.shape[-1] - 1, int(3.0 * rate / cutoff))  # three periods of the cutoff
    return sosfiltfilt(filter_, values, axis=-1, padlen=padding)


def rounding_hint(time: np.ndarray) -> str:
    """Advice where uniform sampling and too few digits explain the steps of the instants (n,) [s]; "" elsewhere.

    Instants rounded to the resolution q lie within q of the uniform grid through the first and the last one. Where
    several fall on one, the next step is q, and none is larger; elsewhere two steps differ by q at most, and one
    twice as long as another may be a missing sample.
    """
    steps = np.diff(time)
    if steps.size == 0 or (steps < 0.0).any() or time[-1] <= time[0]:
        return ""
    zero = np.flatnonzero(steps == 0.0)
    if zero.size:
        resolution = steps[np.clip(np.concatenate([zero - 1, zero + 1]), 0, steps.size - 1)].max()
        largest = (1.0 + ROUNDING_TOLERANCE) * resolution
    else:
        resolution = steps.max() - steps.min()
        largest = (2.0 - ROUNDING_TOLERANCE) * steps.min()
    interval = (time[-1] - time[0]) / steps.size
    deviation = np.abs(time - time[0] - interval * np.arange(time.size)).max()
    if steps.max() > largest or deviation > (1.0 + ROUNDING_TOLERANCE) * resolution:
        return ""
    return (
        "where the instants are rounded to too few digits, state the sampling rate in the place of `time`, as in "
        f'rate = "2 kHz" (here about {plain_number(1.0 / interval)} Hz)'
    )
