"""A channel whose zero moves in time."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def drifting(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with each channel rising since its first sample."""
    since = record.time.values - record.time.values[0]
    for channel in ("displacement", "velocity"):
        size = p[f"drift_{channel}"]
        if channel in record and size != 0.0:
            values = record[channel].values
            record = with_channels(record, {channel: values + size * since})
    return record


EFFECT = Effect(
    name="channel_drift",
    site="sensor",
    law=drifting,
    parameters=(
        Parameter("drift_displacement", "m/s", 0.0, "drift of the displacement", null=0.0),
        Parameter("drift_velocity", "m/s^2", 0.0, "drift of the velocity", null=0.0),
    ),
    meaning="the zero of a sensor creeps, by warming or by integration: the phase curve does not close",
    equation="channel + drift (t - t0), t0 the first sample",
    confused=("channel_offset", "drive_modulation"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
