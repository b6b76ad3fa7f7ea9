"""A damping that drifts in time."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def drift(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the time t [s] and the velocity v [m/s]: -b t v."""
    return -p[0] * t * v


EFFECT = Effect(
    name="damping_drift",
    site="force",
    law=drift,
    parameters=(Parameter("damping_rise", "1/s^2", 0.0, "rise of the damping over mass per time", null=0.0),),
    meaning="oil, rubber or glue that warms during the record: the decay changes with time, not with the amplitude",
    equation="-damping_rise t v",
    group="damping",
    confused=("quadratic_drag", "coulomb_friction", "drive_modulation"),
    transient=True,
    cite="Nashif, Jones & Henderson, Vibration Damping (1985)",
)
