"""Modes beyond those of the model, as they show in a frequency response near a resonance."""

from collections.abc import Mapping

import xarray as xr

from calib.modelling.effect import Effect
from calib.modelling.laws import response
from calib.modelling.parameter import Parameter
from calib.records.response import complex_amplitude, with_amplitude


@response
def residual(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return the response to a force with the residual compliance times the force added at the driven body.

    At all bodies where the force acts on none of them alone. Responses to another excitation stay as they are, and so
    do higher harmonics: the level is the amplitude of a force that is a sine.
    """
    if record.attrs["quantity"] != "force":
        return record
    bodies = record.variables["body"].values
    driven = bodies == record.attrs["place"]
    rows = driven if driven.any() else ~driven
    added = p["residual_compliance"] * rows[:, None] * record["level"].values
    return with_amplitude(record, complex_amplitude(record) + added)


EFFECT = Effect(
    name="residual_compliance",
    site="response",
    law=residual,
    parameters=(
        Parameter(
            "residual_compliance", "m/N", 0.0, "displacement per force by all other modes: below 0 of lower ones and "
            "of the body as a whole, above 0 of higher ones", null=0.0,
        ),
    ),
    meaning="the modes that the model lacks move the driven point too: damping seems to differ between the two sides "
    "of a resonance, and there is an antiresonance",
    equation="H + residual_compliance * force",
    group="structure",
    quantity="force",
    confused=("response_lag", "added_mass", "extra_mode"),
    cite="Ewins, Modal Testing (2000): residual terms of a frequency response",
)  # fmt: skip
