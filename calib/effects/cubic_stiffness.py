"""A spring that hardens with the square of the displacement."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def spring(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m]: -k3 x^3."""
    return -p[0] * x * x * x


EFFECT = Effect(
    name="cubic_stiffness",
    site="force",
    law=spring,
    parameters=(Parameter("k3", "1/(m^2 s^2)", 0.0, "cubic stiffness over mass; hardening where positive", null=0.0),),
    meaning="stretching of a bent body: the frequency rises with the amplitude squared, third harmonic",
    equation="-k3 x^3",
    group="stiffness",
    confused=("softening", "detuning_drift", "presliding"),
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001), section 2.3.1 and chapter 3",
)
