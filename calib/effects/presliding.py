"""Friction that is a spring before it slips (Dahl)."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter


@force(states=1)
def friction(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return Dahl's friction per unit mass [m/s^2]: -F z, z' = (v / x_s) (1 - z sgn v)."""
    dz[0] = (v - z[0] * abs(v)) / p[1]
    return -p[0] * z[0]


EFFECT = Effect(
    name="presliding",
    site="force",
    law=friction,
    parameters=(
        Parameter("dahl_force", "m/s^2", 0.0, "friction per unit mass when it slips", null=0.0, low=0.0),
        Parameter("dahl_distance", "m", 1e-4, "displacement over which it comes to slip", low=ABOVE_ZERO),
    ),
    meaning="friction with a stiffness before it slips: the frequency rises at small amplitudes, hysteresis at any",
    equation="-dahl_force z, z' = (v / dahl_distance) (1 - z sgn v)",
    group="friction",
    confused=("coulomb_friction", "cubic_stiffness", "backlash", "bouc_wen", "stribeck"),
    natural={"dahl_distance": (0.02, 0.1, 0.5)},
    cite="Dahl, A Solid Friction Model, Aerospace Corporation TOR-0158 (1968)",
)
