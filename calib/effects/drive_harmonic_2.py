"""A second harmonic in a drive that is thought to be harmonic."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import excitation
from calib.modelling.parameter import Parameter


@excitation
def harmonic(t: float, phase: float, amplitude: float, x: float, p: np.ndarray) -> float:
    """Return the second harmonic [unit of the drive] at the phase of the drive [rad]."""
    return amplitude * (p[0] * math.cos(2.0 * phase) + p[1] * math.sin(2.0 * phase))


EFFECT = Effect(
    name="drive_harmonic_2",
    site="excitation",
    law=harmonic,
    parameters=(
        Parameter("h2_cos", "1", 0.0, "its part in phase with the drive, over the drive's amplitude", null=0.0),
        Parameter("h2_sin", "1", 0.0, "its part a quarter of its period later, as a share of the same", null=0.0),
    ),
    meaning="the shaker distorts: a second harmonic at all levels, also without contact",
    equation="+amplitude (h2_cos cos 2 phase + h2_sin sin 2 phase)",
    drive="harmonic",
    confused=("quadratic_stiffness",),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
