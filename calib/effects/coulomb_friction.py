"""Dry friction that turns about with the velocity."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter


@force
def friction(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the friction per unit mass [m/s^2] at the velocity v [m/s]: -F tanh(v / v_s)."""
    return -p[0] * math.tanh(v / p[1])


EFFECT = Effect(
    name="coulomb_friction",
    site="force",
    law=friction,
    parameters=(
        Parameter("friction", "m/s^2", 0.0, "friction per unit mass", null=0.0, low=0.0),
        Parameter("friction_slip", "m/s", 1e-3, "velocity over which it turns about", low=ABOVE_ZERO),
    ),
    meaning="dry friction on a body: decay is linear in time and stops off zero, odd harmonics",
    equation="-friction tanh(v / friction_slip)",
    group="friction",
    confused=("linear_drag", "presliding", "stribeck"),
    natural={"friction_slip": (0.01, 0.05)},
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001), section 2.3.5",
)
