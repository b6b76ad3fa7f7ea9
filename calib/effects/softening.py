"""A spring that changes in proportion to the amplitude."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def spring(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m]: -kx x |x|."""
    return -p[0] * x * abs(x)


EFFECT = Effect(
    name="softening",
    site="force",
    law=spring,
    parameters=(Parameter("kx", "1/(m s^2)", 0.0, "stiffness over mass per displacement", null=0.0),),
    meaning="joints that loosen or harden: the frequency moves in proportion to the amplitude, odd harmonics",
    equation="-kx x |x|",
    group="stiffness",
    confused=("cubic_stiffness", "detuning_drift"),
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001)",
)
