"""A drive whose amplitude grows or falls in time."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import excitation
from calib.modelling.parameter import Parameter


@excitation
def modulation(t: float, phase: float, amplitude: float, x: float, p: np.ndarray) -> float:
    """Return the change of the drive [its unit] at the time t [s], x the drive undisturbed: m t x."""
    return p[0] * t * x


EFFECT = Effect(
    name="drive_modulation",
    site="excitation",
    law=modulation,
    parameters=(Parameter("modulation", "1/s", 0.0, "relative growth of the drive per time", null=0.0),),
    meaning="the level of the drive drifts: the amplitude creeps, sidebands",
    equation="+modulation t x",
    drive="any",
    confused=("channel_drift", "detuning_drift", "damping_drift"),
    transient=True,
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
