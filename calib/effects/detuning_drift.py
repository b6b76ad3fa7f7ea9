"""A natural frequency that drifts in time."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def drift(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the time t [s] and the displacement x [m]: -b t x."""
    return -p[0] * t * x


EFFECT = Effect(
    name="detuning_drift",
    site="force",
    law=drift,
    parameters=(Parameter("detuning", "1/s^3", 0.0, "rise of the stiffness over mass per time", null=0.0),),
    meaning="warming or settling during the record: the frequency moves with time, not with the amplitude",
    equation="-detuning t x",
    group="stiffness",
    confused=("softening", "cubic_stiffness", "frequency_drift"),
    transient=True,
)
