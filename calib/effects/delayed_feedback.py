"""A control loop that acts on where the body was a delay ago."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force(states=4)
def controller(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2]: -k x(t - T) - c v(t - T), by the Pade approximant [3/4] of exp(-s T).

    With s T = q: (840 - 360 q + 60 q^2 - 4 q^3) / (840 + 480 q + 120 q^2 + 16 q^3 + q^4), z the states of its
    controllable canonical form; within 0.5 % up to the angular frequency 3 / T. The body was at zero before the run.
    Without delay the approximant is 1, and z stays as it is.
    """
    if p[2] == 0.0:
        dz[:4] = 0.0
        return -p[0] * x - p[1] * v
    rate = 1.0 / p[2]
    for k in range(3):
        dz[k] = rate * z[k + 1]
    dz[3] = rate * (x - 840.0 * z[0] - 480.0 * z[1] - 120.0 * z[2] - 16.0 * z[3])
    place = 840.0 * z[0] - 360.0 * z[1] + 60.0 * z[2] - 4.0 * z[3]
    speed = 840.0 * dz[0] - 360.0 * dz[1] + 60.0 * dz[2] - 4.0 * dz[3]
    return -p[0] * place - p[1] * speed


EFFECT = Effect(
    name="delayed_feedback",
    site="force",
    law=controller,
    parameters=(
        Parameter("feedback_stiffness", "1/s^2", 0.0, "gain on the displacement, over mass", null=0.0),
        Parameter("feedback_damping", "1/s", 0.0, "gain on the velocity, over mass", null=0.0),
        Parameter("feedback_delay", "s", 1e-3, "delay T; at 0 the controller answers at once", low=0.0),
    ),
    meaning="an actuator, a servo or a cutting tool that answers late: damping of either sign, by the frequency",
    equation="-feedback_stiffness x(t - T) - feedback_damping v(t - T), T = feedback_delay",
    confused=("linear_drag", "fractional_damping", "channel_lag"),
    generalises=("linear_drag",),
    requires="a controller or a cutting tool that acts on the body",
    natural={"feedback_delay": (1.0,)},
    cite="Hu & Wang, Dynamics of Controlled Mechanical Systems with Delayed Feedback (2002)",
)
