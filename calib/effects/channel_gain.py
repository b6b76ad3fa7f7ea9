"""A channel that reads too much or too little."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def scaled(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with each channel times 1 + its gain."""
    for channel in ("displacement", "velocity"):
        size = p[f"gain_{channel}"]
        if channel in record and size != 0.0:
            values = record[channel].values
            record = with_channels(record, {channel: values * (1.0 + size)})
    return record


EFFECT = Effect(
    name="channel_gain",
    site="sensor",
    law=scaled,
    parameters=(
        Parameter("gain_displacement", "1", 0.0, "relative error of the displacement", null=0.0),
        Parameter("gain_velocity", "1", 0.0, "relative error of the velocity", null=0.0),
    ),
    meaning="a sensor's sensitivity is not what was thought: the phase curve is stretched along one axis",
    equation="channel (1 + gain)",
    confused=("plot_scale", "axis_tilt", "channel_nonlinearity"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
