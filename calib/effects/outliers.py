"""Samples that have nothing to do with the motion."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter


@sensor
def unchanged(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the record as it is: outliers are part of its noise, not of its mean."""
    return record


EFFECT = Effect(
    name="outliers",
    site="sensor",
    law=unchanged,
    parameters=(Parameter("outlier_share", "1", 0.0, "share of the samples", null=0.0, low=0.0, high=1.0),),
    meaning="a few samples are wrong altogether: spikes, drop-outs, misread points",
    equation="noise of a mixture: a share of the samples has a much larger spread",
    confused=("quantisation",),
    differentiable=False,
    noise=True,
    cite="Huber, Robust Statistics (1981)",
)
