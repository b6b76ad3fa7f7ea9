"""Hysteresis whose loops are rounded or sharp as its exponent has it (Bouc and Wen)."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter


@force(states=1)
def hysteresis(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the restoring force per unit mass [m/s^2]: -F z, z' = (v / x_y) (1 - |z|^n (b sgn(v z) + 1 - b))."""
    share = p[3] if v * z[0] >= 0.0 else -p[3]
    dz[0] = v / p[1] * (1.0 - abs(z[0]) ** p[2] * (share + 1.0 - p[3]))
    return -p[0] * z[0]


EFFECT = Effect(
    name="bouc_wen",
    site="force",
    law=hysteresis,
    parameters=(
        Parameter("hysteresis_force", "m/s^2", 0.0, "yield force per unit mass", null=0.0, low=0.0),
        Parameter("hysteresis_distance", "m", 1e-4, "yield displacement", low=ABOVE_ZERO),
        Parameter("hysteresis_exponent", "1", 2.0, "sharpness n of yielding", low=1.0),
        Parameter(
            "hysteresis_shape", "1", 0.5, "b: 0.5 unloads elastically, at 1 and n = 1 it is Dahl's", low=0.5, high=1.0
        ),
    ),
    meaning="a joint or a rope that yields: stiff at small amplitudes, loops that widen with the amplitude",
    equation="-hysteresis_force z, z' = (v / hysteresis_distance) (1 - |z|^hysteresis_exponent (b sgn(v z) + 1 - b))",
    group="friction",
    confused=("presliding", "iwan", "cubic_stiffness"),
    generalises=("presliding",),
    special_cases={
        "presliding": {
            "hysteresis_force": "dahl_force",
            "hysteresis_distance": "dahl_distance",
            "hysteresis_exponent": 1.0,
            "hysteresis_shape": 1.0,
        }
    },
    natural={"hysteresis_distance": (0.1, 0.6)},
    cite="Wen, Method for Random Vibration of Hysteretic Systems, J. Engineering Mechanics Division ASCE 102 (1976) "
    "249",
)
