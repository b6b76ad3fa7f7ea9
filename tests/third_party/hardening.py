"""A spring that hardens: an effect by a third party, known to no entry point."""

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def _spring(t, x, v, p, z, dz):
    """Return the force per unit mass [m/s^2] at the displacement x [m]: -k x^3."""
    return -p[0] * x * x * x


HARDENING = Effect(
    name="stiffer_when_bent",
    site="force",
    law=_spring,
    parameters=(Parameter("bend_stiffness", "1/(m^2 s^2)", 0.0, "cubic stiffness over mass", null=0.0, low=0.0),),
    meaning="a spring that hardens with the square of the displacement",
    equation="-k x^3",
)
