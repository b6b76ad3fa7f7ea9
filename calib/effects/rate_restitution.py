"""Restitution that falls with the speed of the impact."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import restitution
from calib.modelling.parameter import ABOVE_ZERO, Parameter

MIN_SPEED_RATIO = 1e-3  # of rate_speed; slower impacts count as that fast, or the last of them would never come to rest


@restitution
def falling(e: float, speed: float, p: np.ndarray) -> float:
    """Return the change [1] of the coefficient e at a closing speed [m/s]: e ((v / v0)^-n - 1)."""
    return e * (max(speed / p[1], MIN_SPEED_RATIO) ** -p[0] - 1.0)


EFFECT = Effect(
    name="rate_restitution",
    site="restitution",
    law=falling,
    parameters=(
        Parameter("rate_exponent", "1", 0.0, "exponent n of the speed", null=0.0),
        Parameter("rate_speed", "m/s", 1.0, "speed at which the coefficient is the simulator's own", low=ABOVE_ZERO),
    ),
    meaning="faster impacts lose more of their speed: the loss depends on the amplitude",
    equation="e = e0 (v / rate_speed)^-rate_exponent",
    confused=("adhesion", "quadratic_drag", "contact_compliance"),
    cite="Goldsmith, Impact (1960); Johnson, Contact Mechanics (1985), section 11.5",
)
