"""A drive whose phase is modulated by a tone."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import excitation
from calib.modelling.parameter import ABOVE_ZERO, Parameter


@excitation
def modulated(t: float, phase: float, amplitude: float, x: float, p: np.ndarray) -> float:
    """Return the change of a harmonic drive [its unit] whose phase is late by a sin(w t) + b (cos(w t) - 1) [rad]."""
    turn = 2.0 * math.pi * p[2] * t
    late = p[0] * math.sin(turn) + p[1] * (math.cos(turn) - 1.0)
    return amplitude * (math.cos(phase - late) - math.cos(phase))


EFFECT = Effect(
    name="phase_jitter",
    site="excitation",
    law=modulated,
    parameters=(
        Parameter("jitter_sin", "rad", 0.0, "amplitude a of the phase, as a sine of the time", null=0.0),
        Parameter("jitter_cos", "rad", 0.0, "amplitude b of the phase, as a cosine of the time", null=0.0),
        Parameter("jitter_frequency", "Hz", 50.0, "frequency of the modulation, such as hum", low=ABOVE_ZERO),
    ),
    meaning="one tone of the generator's jitter, as hum makes it: sidebands at its frequency about the drive's",
    equation="+amplitude (cos(phase - jitter_sin sin(w t) - jitter_cos (cos(w t) - 1)) - cos phase), "
    "w = 2 pi jitter_frequency",
    drive="harmonic",
    confused=("frequency_drift", "drive_modulation"),
    transient=True,
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
