"""A magnet that attracts the body the more the nearer it comes."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter

MIN_DISTANCE_RATIO = 0.1  # of the distance at rest; nearer than that the force does not grow


@force
def magnet(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m] towards a magnet at -d: -A sgn d / (d + x)^2."""
    side = math.copysign(1.0, p[1])
    distance = max(side * (p[1] + x), MIN_DISTANCE_RATIO * abs(p[1]))
    return -p[0] * side / (distance * distance)


EFFECT = Effect(
    name="magnetic_attraction",
    site="force",
    law=magnet,
    parameters=(
        Parameter(
            "magnet_strength", "m^3/s^2", 0.0, "attraction per unit mass times squared distance", null=0.0, low=0.0
        ),
        Parameter("magnet_distance", "m", 1e-2, "d: from the magnet to the body at rest, negative where it lies above"),
    ),
    meaning="a magnet or an electrode beside the body: it rests nearer to it and is softer; even harmonics",
    equation="-magnet_strength sgn d / (d + x)^2, d = magnet_distance, |d + x| >= 0.1 |d| on the magnet's side",
    confused=("quadratic_stiffness", "preload", "cubic_stiffness"),
    generalises=("preload",),  # far away
    natural={"magnet_distance": (2.0, -2.0)},
    cite="Schweitzer & Maslen (eds.), Magnetic Bearings (2009)",
)
