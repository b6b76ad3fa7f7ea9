"""Surfaces that stick together when they part."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import restitution
from calib.modelling.parameter import Parameter


@restitution
def held_back(e: float, speed: float, p: np.ndarray) -> float:
    """Return the change [1] of the coefficient e at a closing speed [m/s]: the work of parting is lost."""
    if speed <= 0.0:
        return -e
    return math.sqrt(max(0.0, e * e - p[0] / (speed * speed))) - e


EFFECT = Effect(
    name="adhesion",
    site="restitution",
    law=held_back,
    parameters=(Parameter("adhesion", "m^2/s^2", 0.0, "work of parting per half unit mass", null=0.0, low=0.0),),
    meaning="glue or moisture between the surfaces: slow impacts do not rebound, release is late",
    equation="e = sqrt(max(0, e0^2 - adhesion / v^2))",
    confused=("rate_restitution", "squeeze_film"),
    natural={"adhesion": (1e-4, 1e-3, 1e-2)},
    cite="Johnson, Contact Mechanics (1985), sections 5.5 and 11.5",
)
