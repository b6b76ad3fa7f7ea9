"""A gap that is wider or narrower than stated."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import gap
from calib.modelling.parameter import Parameter


@gap
def offset(place: float, p: np.ndarray) -> float:
    """Return the change of the gap [m], the same at every place of the contact line."""
    return p[0]


EFFECT = Effect(
    name="gap_offset",
    site="gap",
    law=offset,
    parameters=(Parameter("dg", "m", 0.0, "change of the gap, positive where it is wider", null=0.0),),
    meaning="contact at another distance than stated: impact phase and the place of the impact on the phase curve move",
    equation="contact at g + dg + r < 0",
    confused=("preload", "channel_offset", "interface_shift"),
)
