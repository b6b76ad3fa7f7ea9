"""An effect by a third party: viscous friction that differs between forward and backward motion."""

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def drag(t, x, v, p, z, dz):
    """Return the force per unit mass [m/s^2] at the velocity v [m/s]: -p[0] |v|."""
    return -p[0] * abs(v)


DIRECTIONAL_DRAG = Effect(
    name="directional_drag",
    site="force",
    law=drag,
    parameters=(
        Parameter("drag_difference", "1/s", 0.0, "half of forward less backward viscous damping over mass", null=0.0),
    ),
    meaning="viscous friction that differs between the two directions of motion",
    equation="-drag_difference |v|",
    confused=("preload", "quadratic_stiffness"),
    cite="Armstrong-Helouvry, Dupont & Canudas de Wit, A survey of models for the control of machines with friction, "
    "Automatica 30 (1994)",
)
