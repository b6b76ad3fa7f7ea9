"""Terms of higher order of a sloshing liquid, in its displacement x and velocity v, for study.higher_order.toml.

Beside x^3 there are at third order x v^2, as the inertia of the liquid has it in multimodal theory (Faltinsen &
Timokha, Sloshing, 2009), and x^2 v, from whose damping a decay cannot tell that of v^3; of fifth order is the spring's.
"""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter


@force
def fifth_power(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m]: -k5 x^5."""
    return -p[0] * x * x * x * x * x


@force
def amplitude_damping(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m] and the velocity v [m/s]: -cx x^2 v."""
    return -p[0] * x * x * v


@force
def inertia(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m] and the velocity v [m/s]: -kv x v^2."""
    return -p[0] * x * v * v


FIFTH_POWER = Effect(
    name="fifth_power",
    site="force",
    law=fifth_power,
    parameters=(Parameter("k5", "1/(m^4 s^2)", 0.0, "stiffness of fifth order per unit mass", null=0.0),),
    meaning="a spring of fifth order: the backbone bends with the amplitude's fourth power",
    equation="-k5 x^5",
)
AMPLITUDE_DAMPING = Effect(
    name="amplitude_damping",
    site="force",
    law=amplitude_damping,
    parameters=(Parameter("cx", "1/(m^2 s)", 0.0, "damping per mass and squared displacement", null=0.0),),
    meaning="damping that grows with the displacement: the damping ratio rises with the amplitude squared",
    equation="-cx x^2 v",
)
INERTIA = Effect(
    name="inertia",
    site="force",
    law=inertia,
    parameters=(Parameter("kv", "1/m^2", 0.0, "inertia that changes with the displacement", null=0.0),),
    meaning="the moving liquid's inertia changes with the displacement: the frequency moves with the amplitude squared",
    equation="-kv x v^2",
)
