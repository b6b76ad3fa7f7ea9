"""A velocity that was made from displacements by differences."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import INTERVAL, fills_periods, mean_interval, with_channels


@sensor
def differenced(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with a share of its velocity replaced by backward differences of the displacement.

    Where a stationary motion fills whole periods, the interval is that of the instruments, and the displacement between
    the samples the cubic that has its values and velocities. Any other record has its own interval, and first the
    difference that the next two make when they go on in a straight line.
    """
    if "velocity" not in record or "displacement" not in record:
        return record
    time, x, v = record.time.values, record["displacement"].values, record["velocity"].values
    if fills_periods(record):
        interval, length = record.attrs.get(INTERVAL) or mean_interval(record), time.size * mean_interval(record)
        closed = [np.append(channel, channel[:, :1], axis=1) for channel in (x, v)]
        course = CubicHermiteSpline(np.append(time, time[0] + length), *closed, axis=1)
        slope = (x - course(time[0] + (time - time[0] - interval) % length)) / interval
    else:
        slope = np.empty_like(v)
        slope[:, 1:] = np.diff(x, axis=1) / np.diff(time)
        slope[:, 0] = 2.0 * slope[:, 1] - slope[:, 2]
    return with_channels(record, {"velocity": v + p["differencing"] * (slope - v)})


EFFECT = Effect(
    name="velocity_differencing",
    site="sensor",
    law=differenced,
    parameters=(Parameter("differencing", "1", 0.0, "share of differences", null=0.0, low=0.0, high=1.0),),
    meaning="the velocity is a difference of samples: half a step late, its jumps rounded",
    equation="v + differencing ((x_k - x_(k-1)) / dt - v)",
    confused=("channel_lag", "velocity_lowpass"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
