"""A mount with play: a dead zone, a spring beyond it, a slider behind both."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter

# share of the slider's force over which it comes to slide  [1]; a jump would cost the integrator its order
SLIDING_RANGE = 0.01


@force(states=1)
def play(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2]: -k d, d the part of u = x - z beyond the dead zone |u| <= b.

    The slider z moves along with the body, z' = v, where k |d| exceeds its force and |d| would grow.
    """
    u = x - z[0]
    d = max(0.0, abs(u) - p[1])
    if u < 0.0:
        d = -d
    dz[0] = 0.0
    if d * v > 0.0:
        over = p[0] * abs(d) - p[2]
        if over > 0.0:
            limit = SLIDING_RANGE * p[2]
            dz[0] = v if over >= limit else v * over / limit
    return -p[0] * d


EFFECT = Effect(
    name="backlash",
    site="force",
    law=play,
    parameters=(
        Parameter("backlash_stiffness", "1/s^2", 0.0, "stiffness beyond the play, over mass", null=0.0, low=0.0),
        Parameter("backlash_width", "m", 1e-4, "half the width of the play", low=0.0),
        Parameter("backlash_force", "m/s^2", 100.0, "force per unit mass at which the mount slides along", low=0.0),
    ),
    meaning="play in the mount: a plateau after each reversal, ringing after impacts",
    equation="-backlash_stiffness d, d = dead zone of x - z; z' = v where the spring's force reaches backlash_force",
    group="contact",
    confused=("gap_offset", "presliding"),
    natural={"backlash_width": (0.1, 0.3, 0.6), "backlash_force": (10.0,)},
    cite="Worden & Tomlinson, Nonlinearity in Structural Dynamics (2001), section 2.3.3",
)
