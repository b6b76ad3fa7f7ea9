"""A channel whose sensitivity depends on what it reads."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def bent(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with each channel y as y + k y^3."""
    for channel in ("displacement", "velocity"):
        size = p[f"cubic_{channel}"]
        if channel in record and size != 0.0:
            values = record[channel].values
            record = with_channels(record, {channel: values + size * values**3})
    return record


EFFECT = Effect(
    name="channel_nonlinearity",
    site="sensor",
    law=bent,
    parameters=(
        Parameter(
            "cubic_displacement", "1/m^2", 0.0, "relative change of sensitivity per squared displacement", null=0.0
        ),
        Parameter("cubic_velocity", "s^2/m^2", 0.0, "relative change of sensitivity per squared velocity", null=0.0),
    ),
    meaning="a sensor near the end of its range: third harmonic in one channel, none in the motion",
    equation="channel + cubic channel^3",
    confused=("channel_gain", "clipping", "cubic_stiffness"),
    cite="Doebelin, Measurement Systems (2003), chapter 3",
)
