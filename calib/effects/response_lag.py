"""A response that is read later than its excitation."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import response
from calib.modelling.parameter import Parameter
from calib.records.response import complex_harmonics, harmonic_orders, with_harmonics


@response
def late(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the response with the phase of each harmonic behind by the lag [s] times its angular frequency."""
    order = np.array(harmonic_orders(record))[:, None, None]
    turned = np.exp(-2j * np.pi * p["response_lag"] * record["frequency"].values * order)
    return with_harmonics(record, turned * complex_harmonics(record))


EFFECT = Effect(
    name="response_lag",
    site="response",
    law=late,
    parameters=(
        Parameter("response_lag", "s", 0.0, "delay of the response channels against that of the excitation", null=0.0),
    ),
    meaning="filters or a multiplexer delay the response against the excitation: resonance is not where the phase is "
    "90 degrees",
    equation="H_k exp(-2 pi i k f response_lag)",
    confused=("residual_compliance", "linear_drag"),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
