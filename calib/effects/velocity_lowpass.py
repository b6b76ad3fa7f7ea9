"""A velocity channel behind a low-pass of first order."""

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr
from numba import njit

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import fills_periods, with_channels


@sensor
def smoothed(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with its velocity behind 1 / (1 + s tau), tau = lowpass [s].

    A stationary motion that fills whole periods has been on for ever; any other record starts from its first sample.
    """
    if "velocity" not in record:
        return record
    time = np.array(record.time.values)  # of its own, since xarray's cannot be written
    velocity = np.ascontiguousarray(record["velocity"].values, dtype=float)
    if fills_periods(record):
        filtered = np.array([_follow_for_ever(time, row, p["lowpass"]) for row in velocity])
    else:
        filtered = np.array([_follow(time, row, p["lowpass"]) for row in velocity])
    return with_channels(record, {"velocity": filtered})


@njit("f8[::1](f8[::1], f8[::1], f8)", cache=True)
def _follow(time: np.ndarray, values: np.ndarray, lag: float) -> np.ndarray:
    """Return what follows `values` (n,) at `time` (n,) [s], linear between samples, by the time constant `lag` [s]."""
    filtered = values.copy()
    for k in range(1, time.size):
        step = time[k] - time[k - 1]
        left = math.exp(-step / lag)
        slope = (values[k] - values[k - 1]) / step
        filtered[k] = values[k] - lag * slope + (filtered[k - 1] - values[k - 1] + lag * slope) * left
    return filtered


def _follow_for_ever(time: np.ndarray, values: np.ndarray, lag: float) -> np.ndarray:
    """Return what follows `values` (n,), which go round after the last sample, as `_follow` has it."""
    span = time.size * (time[-1] - time[0]) / (time.size - 1)
    filtered = _follow(np.append(time, time[0] + span), np.append(values, values[0]), lag)
    left = math.exp(-span / lag)
    begin = (filtered[-1] - values[0] * left) / (1.0 - left)  # returns to itself after the span
    return filtered[:-1] + (begin - values[0]) * np.exp((time[0] - time) / lag)


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
