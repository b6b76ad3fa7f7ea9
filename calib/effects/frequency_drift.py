"""A drive whose frequency drifts."""

import math

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import excitation
from calib.modelling.parameter import Parameter


@excitation
def chirp(t: float, phase: float, amplitude: float, x: float, p: np.ndarray) -> float:
    """Return the change of a harmonic drive [its unit] whose frequency moves by p[0] [Hz/s] from the start on."""
    return amplitude * (math.cos(phase + math.pi * p[0] * t * t) - math.cos(phase))


EFFECT = Effect(
    name="frequency_drift",
    site="excitation",
    law=chirp,
    parameters=(Parameter("chirp", "Hz/s", 0.0, "rise of the drive's frequency per time", null=0.0),),
    meaning="the generator's clock drifts: the phase of the drive creeps",
    equation="+amplitude (cos(phase + pi chirp t^2) - cos phase)",
    drive="harmonic",
    confused=("detuning_drift", "drive_modulation", "phase_jitter"),
    transient=True,
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
