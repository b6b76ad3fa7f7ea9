"""Friction that is higher at rest than in motion (LuGre)."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter


@force(states=1)
def friction(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the friction per unit mass [m/s^2]: -F z, z' = (v - z |v| / g) / x_s, g = 1 + r exp(-(v / v_s)^2)."""
    speed = v / p[3]
    dz[0] = (v - z[0] * abs(v) / (1.0 + p[2] * math.exp(-speed * speed))) / p[1]
    return -p[0] * z[0]


EFFECT = Effect(
    name="stribeck",
    site="force",
    law=friction,
    parameters=(
        Parameter("stribeck_force", "m/s^2", 0.0, "friction per unit mass in fast sliding", null=0.0, low=0.0),
        Parameter("stribeck_distance", "m", 1e-5, "displacement over which it comes to slip", low=ABOVE_ZERO),
        Parameter("stribeck_rise", "1", 0.5, "by which it is higher at rest; without it, it is Dahl's", low=0.0),
        Parameter("stribeck_speed", "m/s", 1e-2, "velocity over which it falls", low=ABOVE_ZERO),
    ),
    meaning="friction that falls as sliding sets in: sticking at reversals, stick-slip, self-excitation at low speed",
    equation="-stribeck_force z, z' = (v - z |v| / g) / stribeck_distance, "
    "g = 1 + stribeck_rise exp(-(v / stribeck_speed)^2)",
    group="friction",
    confused=("coulomb_friction", "presliding"),
    generalises=("presliding",),
    special_cases={
        "presliding": {"stribeck_force": "dahl_force", "stribeck_distance": "dahl_distance", "stribeck_rise": 0.0}
    },
    natural={"stribeck_distance": (0.05,), "stribeck_rise": (0.5,), "stribeck_speed": (0.1,)},
    cite="Canudas de Wit, Olsson, Astrom & Lischinsky, A New Model for Control of Systems with Friction, "
    "IEEE Transactions on Automatic Control 40 (1995) 419",
)
