"""A plot that is turned."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels

MIN_STROKE = 1e-300  # a body that stands still is not turned


@sensor
def turned(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with the phase curve of each body turned by the tilt [rad] about zero.

    Lengths on the plot are shares of the largest magnitude of each channel.
    """
    if "velocity" not in record or "displacement" not in record:
        return record
    x, v = record["displacement"].values, record["velocity"].values
    length, speed = (np.maximum(np.abs(row).max(axis=1, keepdims=True), MIN_STROKE) for row in (x, v))
    turned_rows = {"displacement": x - p["tilt"] * v * length / speed, "velocity": v + p["tilt"] * x * speed / length}
    return with_channels(record, turned_rows)


EFFECT = Effect(
    name="axis_tilt",
    site="sensor",
    law=turned,
    parameters=(Parameter("tilt", "rad", 0.0, "angle by which the plot is turned, from x to v", null=0.0),),
    meaning="a phase curve read off a picture that was scanned at an angle",
    equation="x - tilt v Lx / Lv, v + tilt x Lv / Lx, L the largest magnitudes",
    confused=("plot_shear", "channel_lag"),
    cite="Rohatgi, WebPlotDigitizer, user manual: calibration of axes",
)
