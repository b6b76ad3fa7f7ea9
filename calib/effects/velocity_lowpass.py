"""A velocity channel behind a low-pass of first order."""

import math

import numpy as np
from numba import njit

from calib.effect import Effect
from calib.laws import sensor
from calib.parameter import Parameter
from calib.record import fills_periods


@sensor
def smoothed(record, p):
    """Return the record with its velocity behind 1 / (1 + s tau), tau = lowpass [s].

    A stationary motion that fills whole periods has been on for ever; any other record starts from its first sample.
    """
    if "velocity" not in record:
        return record
    time = np.array(record.time.values)  # of its own, since xarray's cannot be written
    velocity = np.ascontiguousarray(record["velocity"].values, dtype=float)
    step = (time[-1] - time[0]) / (time.size - 1)
    if fills_periods(record):
        spectrum = np.fft.rfft(velocity, axis=1)
        frequency = np.fft.rfftfreq(time.size, step)
        seen = np.fft.irfft(spectrum / (1.0 + 2j * np.pi * frequency * p["lowpass"]), time.size, axis=1)
    else:
        seen = np.array([_follow(time, row, p["lowpass"]) for row in velocity])
    return record.assign(velocity=record["velocity"].copy(data=seen))


@njit("f8[::1](f8[::1], f8[::1], f8)", cache=True)
def _follow(time, values, lag):
    """Return what follows `values` (n,) at `time` (n,) [s], linear between samples, by the time constant `lag` [s]."""
    seen = values.copy()
    for k in range(1, time.size):
        step = time[k] - time[k - 1]
        left = math.exp(-step / lag)
        slope = (values[k] - values[k - 1]) / step
        seen[k] = values[k] - lag * slope + (seen[k - 1] - values[k - 1] + lag * slope) * left
    return seen


EFFECT = Effect(
    name="velocity_lowpass",
    site="sensor",
    law=smoothed,
    parameters=(Parameter("lowpass", "s", 0.0, "time constant of the velocity channel", null=0.0, low=0.0),),
    meaning="the velocity channel has a bandwidth: its jumps at impacts are rounded, and it comes late",
    equation="lowpass v' + v = the velocity",
    confused=("channel_lag", "velocity_differencing", "contact_compliance"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
