"""A response that is read later than its excitation."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import response
from calib.modelling.parameter import Parameter
from calib.records.response import complex_amplitude, with_amplitude


@response
def late(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the response with its phase behind by the lag [s] times the angular frequency."""
    turned = np.exp(-2j * np.pi * p["response_lag"] * record["frequency"].values)
    return with_amplitude(record, turned * complex_amplitude(record))


EFFECT = Effect(
    name="response_lag",
    site="response",
    law=late,
    parameters=(
        Parameter("response_lag", "s", 0.0, "delay of the response channels against that of the excitation", null=0.0),
    ),
    meaning="filters or a multiplexer delay the response against the excitation: resonance is not where the phase is "
    "90 degrees",
    equation="H exp(-2 pi i f response_lag)",
    confused=("residual_compliance", "linear_drag"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
