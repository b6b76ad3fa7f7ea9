"""Quadratic air drag on a moving body."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def drag(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the drag per unit mass [m/s^2] at the velocity v [m/s]: -c2 v |v|."""
    return -p[0] * v * abs(v)


EFFECT = Effect(
    name="quadratic_drag",
    site="force",
    law=drag,
    parameters=(Parameter("c2", "1/m", 0.0, "quadratic drag, 1/2 rho C_d A / m", null=0.0, low=0.0),),
    meaning="resistance of the air, growing with the velocity squared: loss per cycle ~ amplitude^3, odd harmonics",
    equation="-c2 v |v|",
    group="damping",
    confused=("linear_drag", "coulomb_friction", "power_law_damping"),
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001), section 2.3.4",
)
