"""A constant force on a body."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def push(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2]: F0."""
    return p[0]


EFFECT = Effect(
    name="preload",
    site="force",
    law=push,
    parameters=(Parameter("preload", "m/s^2", 0.0, "constant force per unit mass", null=0.0),),
    meaning="weight, a pretensioned mount or glue: the body rests beside where it is thought to",
    equation="+preload",
    confused=("gap_offset", "channel_offset", "quadratic_stiffness", "magnetic_attraction"),
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001)",
)
