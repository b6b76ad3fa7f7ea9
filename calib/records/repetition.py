"""At which frequency a record repeats itself, whatever its excitation is said to be."""

import numpy as np
import xarray as xr

from calib.records import channels, stated_period

MAX_SAMPLES = 20_000  # from the beginning of a record, by which it is judged  [count]
MIN_STATED_PERIODS = 4.0  # of a record at least, in which two frequencies are told apart  [1]
MAX_STATED_PERIODS = 5  # stated periods after which a motion repeats, at most, within half of the record  [count]
REPETITION_ORDERS = 12  # harmonics of a repeating motion  [count]
MAX_OTHER_SHARE = 0.1  # of the variance, that the record's own frequency leaves  [1]
MIN_STATED_SHARE = 0.5  # of the variance, that the stated frequency leaves  [1]
LINE_SHIFTS = np.linspace(-1.0, 1.0, 41)  # about the largest line of the spectrum, over the resolution  [1]


def other_frequency(record: xr.Dataset) -> float | None:
    """Frequency [Hz] at which a record repeats itself, where it is another than the stated one; else None.

    It is the largest line of the displacement, or of the first channel. It is another one if it and its harmonics
    explain nearly all of the variance, while those of the stated frequency, and of its fractions down to a fifth,
    leave more than half of it.

    Parameters
    ----------
    record : with the dimensions body and time
    """
    period = stated_period(record)
    time = record.time.values[:MAX_SAMPLES] - record.time.values[0]
    if period is None or time[-1] < MIN_STATED_PERIODS * period:
        return None
    name = "displacement" if "displacement" in record else channels(record)[0]
    rows = record[name].transpose("body", "time").values[:, :MAX_SAMPLES]
    rows = (rows - rows.mean(axis=1, keepdims=True)).T
    if not rows.any():
        return None
    most = min(MAX_STATED_PERIODS, int(time[-1] / (2.0 * period)))
    left = (_left(rows, time, 1.0 / (n * period), n * REPETITION_ORDERS) for n in range(1, most + 1))
    if any(share < MIN_STATED_SHARE for share in left):  # nearly always of the first, the least costly
        return None
    found = _largest_line(rows, time)
    return found if _left(rows, time, found, REPETITION_ORDERS) < MAX_OTHER_SHARE else None


def _left(rows: np.ndarray, time: np.ndarray, frequency: float, orders: int) -> float:
    """Share of the variance of `rows` (time, body) that a Fourier series of this frequency leaves."""
    orders = max(1, min(orders, int(0.5 * (time.size - 1) / (time[-1] * frequency))))
    angles = 2.0 * np.pi * frequency * np.outer(time, np.arange(orders + 1))
    design = np.hstack([np.cos(angles), np.sin(angles[:, 1:])])
    fitted = design @ np.linalg.lstsq(design, rows, rcond=None)[0]
    return float(((rows - fitted) ** 2).sum() / (rows**2).sum())


def _largest_line(rows: np.ndarray, time: np.ndarray) -> float:
    """Frequency [Hz] of the largest line, refined by least squares within the resolution of the spectrum."""
    even = np.linspace(0.0, time[-1], time.size)
    window = np.hanning(time.size)
    spectra = np.fft.rfft([window * np.interp(even, time, row) for row in rows.T], axis=1)
    power = (np.abs(spectra) ** 2).sum(axis=0)
    at = 1 + int(np.argmax(power[1:]))
    near = [(at + shift) / time[-1] for shift in LINE_SHIFTS if at + shift > 0.0]
    return min(near, key=lambda frequency: _left(rows, time, frequency, 1))
