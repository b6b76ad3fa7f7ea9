"""A plot that is read too large or too small."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def scaled(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with both channels times 1 + a."""
    present = [channel for channel in ("displacement", "velocity") if channel in record]
    return with_channels(record, {channel: record[channel].values * (1.0 + p["plot_scale"]) for channel in present})


EFFECT = Effect(
    name="plot_scale",
    site="sensor",
    law=scaled,
    parameters=(Parameter("plot_scale", "1", 0.0, "relative error of the scale", null=0.0),),
    meaning="the scale of a picture is misread for both axes: the phase curve is larger, its shape the same",
    equation="x (1 + plot_scale), v (1 + plot_scale)",
    confused=("channel_gain",),
    cite="Rohatgi, WebPlotDigitizer, user manual: calibration of axes",
)
