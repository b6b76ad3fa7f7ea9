"""A mode of the structure that the model does not have."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter


@force(states=2)
def resonator(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] of an attached resonator whose displacement and velocity are z.

    u'' = -w^2 (u - x) - 2 d w (u' - v) with w = 2 pi mode_frequency; mode_mass times the reaction acts on the body.
    """
    w = 2.0 * math.pi * p[1]
    pull = w * w * (z[0] - x) + 2.0 * p[2] * w * (z[1] - v)
    dz[0] = z[1]
    dz[1] = -pull
    return p[0] * pull


EFFECT = Effect(
    name="extra_mode",
    site="force",
    law=resonator,
    parameters=(
        Parameter("mode_mass", "1", 0.0, "mass of the resonator over that of the body", null=0.0, low=0.0),
        Parameter("mode_frequency", "Hz", 100.0, "its own frequency on a body that stands still", low=ABOVE_ZERO),
        Parameter("mode_damping", "1", 0.02, "its damping ratio", low=0.0),
    ),
    meaning="one more mode, as a resonator on the body: ringing after impacts, a dip and a peak over frequency",
    equation="+mode_mass (w^2 (u - x) + 2 mode_damping w (u' - v)), u'' = -w^2 (u - x) - 2 mode_damping w (u' - v)",
    group="structure",
    confused=("channel_lag", "velocity_lowpass", "backlash", "fractional_damping"),
    natural={"mode_frequency": (0.3, 0.8, 1.6)},
    cite="Den Hartog, Mechanical Vibrations (1956), chapter 3: the damped vibration absorber",
)
