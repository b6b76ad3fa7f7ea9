"""Springs and dampers at the supports."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def spring_and_damper(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] of a support at x [m], v [m/s]: -ks x - cs v."""
    return -p[0] * x - p[1] * v


EFFECT = Effect(
    name="support",
    site="force",
    law=spring_and_damper,
    parameters=(
        Parameter("support_stiffness", "1/s^2", 0.0, "stiffness of each support over mass", null=0.0),
        Parameter("support_damping", "1/s", 0.0, "damping of each support over mass", null=0.0, low=0.0),
    ),
    meaning="what holds the structure has a stiffness and a damping of its own: rigid motion, frequencies shift",
    equation="-support_stiffness x - support_damping v at the supports",
    group="structure",
    confused=("linear_drag", "added_mass"),
    place="support",
    cite="Ewins, Modal Testing (2000)",
)
