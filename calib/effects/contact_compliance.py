"""Loss within a compliant contact (Hunt and Crossley)."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import contact
from calib.modelling.parameter import Parameter


@contact
def lossy(place: float, clearance: float, rate: float, pressure: float, p: np.ndarray) -> float:
    """Return the change of the pressure [Pa] where the clearance opens at `rate` [m/s]: pressure mu (-rate)."""
    return -p[0] * rate * pressure


EFFECT = Effect(
    name="contact_compliance",
    site="contact",
    law=lossy,
    parameters=(Parameter("hunt_crossley", "s/m", 0.0, "loss factor mu of the contact", null=0.0, low=0.0),),
    meaning="a contact that yields and loses with the speed of penetration: duration and loss of an impact",
    equation="pressure (1 + hunt_crossley d'), d' the speed of penetration",
    confused=("velocity_lowpass", "rate_restitution", "interface_shift"),
    natural={"hunt_crossley": (0.1, 0.3, 1.0)},
    cite="Hunt & Crossley, Journal of Applied Mechanics 42 (1975) 440",
)
