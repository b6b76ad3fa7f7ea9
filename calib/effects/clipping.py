"""A channel that does not go beyond a level."""

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels

LEVEL_QUANTILES = (1.0, 0.995, 0.98, 0.95)  # of the magnitudes: noise reaches beyond the level


@sensor
def clipped(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with each channel cut off at plus and minus its level."""
    for channel in ("displacement", "velocity"):
        size = p[f"clip_{channel}"]
        if channel in record and size != math.inf:
            values = record[channel].values
            record = with_channels(record, {channel: np.clip(values, -size, size)})
    return record


def guess(record: xr.Dataset) -> dict[str, tuple[float, ...]]:
    """Return high quantiles of each channel's magnitude: the highest is the level, where the record is cut off."""
    present = [channel for channel in ("displacement", "velocity") if channel in record]
    return {f"clip_{c}": tuple(np.nanquantile(np.abs(record[c].values), LEVEL_QUANTILES)) for c in present}


EFFECT = Effect(
    name="clipping",
    site="sensor",
    law=clipped,
    parameters=(
        Parameter("clip_displacement", "m", math.inf, "largest displacement", null=math.inf, low=0.0),
        Parameter("clip_velocity", "m/s", math.inf, "largest velocity", null=math.inf, low=0.0),
    ),
    meaning="a sensor or an amplifier saturates: the phase curve is cut off straight",
    equation="min(max(channel, -clip), clip)",
    confused=("gap_offset", "channel_gain", "channel_nonlinearity"),
    differentiable=False,
    natural={"clip_displacement": (0.9, 0.7), "clip_velocity": (0.9, 0.7)},
    guess=guess,
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
