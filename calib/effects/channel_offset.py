"""A channel whose zero is not zero."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def offset(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with a constant added to each channel."""
    for channel in ("displacement", "velocity"):
        size = p[f"offset_{channel}"]
        if channel in record and size != 0.0:
            values = record[channel].values
            record = with_channels(record, {channel: values + size})
    return record


EFFECT = Effect(
    name="channel_offset",
    site="sensor",
    law=offset,
    parameters=(
        Parameter("offset_displacement", "m", 0.0, "zero of the displacement", null=0.0),
        Parameter("offset_velocity", "m/s", 0.0, "zero of the velocity", null=0.0),
    ),
    meaning="the zero of a sensor is off: the phase curve is moved along one axis",
    equation="channel + offset",
    confused=("preload", "gap_offset", "quadratic_stiffness"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
