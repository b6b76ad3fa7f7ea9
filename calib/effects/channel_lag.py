"""A velocity channel that comes later than the displacement channel."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import fills_periods, with_channels


@sensor
def delayed(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with its velocity delayed by the lag [s]: v(t - lag).

    A stationary motion that fills whole periods goes on before its first sample as it ended; any other record goes on
    beyond its ends as straight as it begins and ends.
    """
    if "velocity" not in record:
        return record
    time, velocity = record.time.values, record["velocity"].values
    span = time.size * (time[-1] - time[0]) / (time.size - 1)
    if fills_periods(record):
        delayed_rows = [np.interp(time - p["lag"], time, row, period=span) for row in velocity]
    else:
        ends = np.array([time[0] - span, *time, time[-1] + span])
        rise = span * np.diff(velocity[:, [0, 1, -2, -1]], axis=1)[:, ::2] / np.diff(time[[0, 1, -2, -1]])[::2]
        beyond = velocity[:, [0, -1]] + rise * [-1.0, 1.0]
        delayed_rows = [
            np.interp(time - p["lag"], ends, [b[0], *row, b[1]]) for row, b in zip(velocity, beyond, strict=True)
        ]
    return with_channels(record, {"velocity": np.array(delayed_rows)})


EFFECT = Effect(
    name="channel_lag",
    site="sensor",
    law=delayed,
    parameters=(Parameter("lag", "s", 0.0, "delay of the velocity channel against displacement", null=0.0),),
    meaning="the two channels of an instrument are not simultaneous: the phase curve is sheared near its tips",
    equation="v(t - lag)",
    confused=("velocity_lowpass", "velocity_differencing", "plot_shear"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
