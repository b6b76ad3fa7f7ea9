"""Air that is squeezed out of a closing gap."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter

MIN_CLEARANCE_RATIO = 0.02  # of the gap at rest; without a floor the gap never closes


@force
def film(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the clearance x [m] that opens at v [m/s]; p[1] the gap at rest [m]."""
    gap = abs(p[1])  # no sign of it gives the film energy
    ratio = gap / max(x, MIN_CLEARANCE_RATIO * gap)
    return -p[0] * v * ratio * ratio * ratio


EFFECT = Effect(
    name="squeeze_film",
    site="force",
    law=film,
    parameters=(Parameter("squeeze", "1/s", 0.0, "damping of the open gap over mass", null=0.0, low=0.0),),
    meaning="a cushion of air in the closing gap: loss just before contact, softened impacts",
    equation="-squeeze v (gap / max(x, 0.02 gap))^3 between layer and beam, x the clearance",
    group="contact",
    confused=("interface_shift", "linear_drag", "adhesion"),
    place="interface",
    borrowed=("gap",),
    positive=("gap",),
    natural={"squeeze": (1e-4, 1e-3, 1e-2)},
    cite="Bao & Yang, Squeeze film air damping in MEMS, Sensors and Actuators A 136 (2007) 3",
)
