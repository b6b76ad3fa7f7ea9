"""A spring that differs for the two directions."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def spring(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m]: -k2 x^2."""
    return -p[0] * x * x


EFFECT = Effect(
    name="quadratic_stiffness",
    site="force",
    law=spring,
    parameters=(Parameter("k2", "1/(m s^2)", 0.0, "quadratic stiffness over mass", null=0.0),),
    meaning="curvature or a one-sided mount: even harmonics, and the mean moves with the amplitude squared",
    equation="-k2 x^2",
    group="stiffness",
    confused=("preload", "drive_harmonic_2", "channel_offset", "magnetic_attraction"),
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001), chapter 3",
)
