"""Drag in proportion to the velocity of a body."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def drag(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the drag per unit mass [m/s^2] at the velocity v [m/s]: -c1 v."""
    return -p[0] * v


EFFECT = Effect(
    name="linear_drag",
    site="force",
    law=drag,
    parameters=(Parameter("c1", "1/s", 0.0, "linear drag, c / m", null=0.0, low=0.0),),
    meaning="a damper between a body and its surroundings: loss per cycle ~ amplitude^2, also without contact",
    equation="-c1 v",
    group="damping",
    confused=("quadratic_drag", "coulomb_friction", "squeeze_film", "fractional_damping", "delayed_feedback"),
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001), chapter 1",
)
