"""A channel that is read off in steps."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter
from calib.records import with_channels


@sensor
def stepped(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record with each channel rounded to multiples of its quantum."""
    for channel in ("displacement", "velocity"):
        size = p[f"quantum_{channel}"]
        if channel in record and size != 0.0:
            values = record[channel].values
            record = with_channels(record, {channel: np.round(values / size) * size})
    return record


def guess(record: xr.Dataset) -> dict[str, tuple[float, ...]]:
    """Return the usual distance of neighbouring values where many samples share theirs."""
    quanta: dict[str, tuple[float, ...]] = {}
    for channel in ("displacement", "velocity"):
        if channel in record:
            values = record[channel].values
            levels = np.unique(values[np.isfinite(values)])
            if 1 < levels.size < values.size / 2:
                quanta[f"quantum_{channel}"] = (float(np.median(np.diff(levels))),)
    return quanta


EFFECT = Effect(
    name="quantisation",
    site="sensor",
    law=stepped,
    parameters=(
        Parameter("quantum_displacement", "m", 0.0, "smallest step of the displacement", null=0.0, low=0.0),
        Parameter("quantum_velocity", "m/s", 0.0, "smallest step of the velocity", null=0.0, low=0.0),
    ),
    meaning="few bits of a converter or of a digitised picture: the phase curve has steps",
    equation="quantum round(channel / quantum)",
    confused=("time_step", "outliers"),
    differentiable=False,
    guess=guess,
    cite="Widrow & Kollar, Quantization Noise (2008)",
)
