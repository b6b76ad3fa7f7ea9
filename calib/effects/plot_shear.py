"""A plot whose axes are not at right angles."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def sheared(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with its displacement moved in proportion to its velocity: x + k v."""
    if "velocity" not in record or "displacement" not in record:
        return record
    x, v = record["displacement"].values, record["velocity"].values
    return with_channels(record, {"displacement": x + p["shear"] * v})


EFFECT = Effect(
    name="plot_shear",
    site="sensor",
    law=sheared,
    parameters=(Parameter("shear", "s", 0.0, "displacement per velocity", null=0.0),),
    meaning="a phase curve read off a picture that stands askew: it leans to one side",
    equation="x + shear v",
    confused=("channel_lag", "axis_tilt"),
    cite="Rohatgi, WebPlotDigitizer, user manual: calibration of axes",
)
