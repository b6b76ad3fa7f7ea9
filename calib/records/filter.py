"""The zero-phase low-pass of sampled values."""

import numpy as np
import scipy

from calib.errors import CalibError
from calib.records.rounded_time import rounding_hint

FILTER_ORDER = 4  # of the Butterworth low-pass, run forwards and backwards
UNIFORMITY_TOLERANCE = 1e-3  # of a step: largest deviation of a sample from the uniform grid  [1]


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
    filter_ = scipy.signal.butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    padding = min(values.shape[-1] - 1, int(3.0 * rate / cutoff))  # three periods of the cutoff
    return scipy.signal.sosfiltfilt(filter_, values, axis=-1, padlen=padding)
