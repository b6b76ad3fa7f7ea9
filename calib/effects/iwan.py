"""Microslip of a lap joint: sliders in parallel that slip one after the other (Iwan, in Segalman's four parameters)."""

import numpy as np

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import ABOVE_ZERO, Parameter

FIRST_CELL_EDGE, CELL_RATIO = 1.0 / 16.0, 4.0  # of slip displacements, over the largest; of an edge over the last  [1]
POWER_LAW_SLIDERS = 3  # sliders that stand for the power law; a fourth is the last to slip


@force(states=4)
def joint(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] of four sliders: -F sum f z, z the force of each over its slip force.

    Their slip displacements are distributed with the density R phi^chi, 0 < phi < phi_max, beside a share at phi_max
    that makes beta = S / (R phi_max^(chi + 1) / (chi + 1)); each of three cells is one slider of its stiffness and slip
    force. z' = (v / phi) (1 - z^2) while it is loaded, v / phi while it is unloaded.
    """
    stiff, slip = p[2] + 1.0, p[2] + 2.0
    total = 1.0 / slip + p[3] / stiff
    pull, low, high = 0.0, 0.0, FIRST_CELL_EDGE
    below, up_to, ratio = 0.0, FIRST_CELL_EDGE**stiff, CELL_RATIO**stiff  # the edges' powers chi + 1
    for k in range(POWER_LAW_SLIDERS + 1):
        share, distance = p[3] / stiff, 1.0  # the last slider
        if k < POWER_LAW_SLIDERS:
            share = (high * up_to - low * below) / slip
            distance = share * stiff / (up_to - below)
            low, high = high, CELL_RATIO * high
            below, up_to = up_to, ratio * up_to
        pull += share / total * z[k]
        dz[k] = v / (distance * p[1]) * (1.0 - z[k] * z[k] if v * z[k] > 0.0 else 1.0)
    return -p[0] * pull


EFFECT = Effect(
    name="iwan",
    site="force",
    law=joint,
    parameters=(
        Parameter("iwan_force", "m/s^2", 0.0, "F_S: force per unit mass at which all of it slips", null=0.0, low=0.0),
        Parameter("iwan_distance", "m", 1e-4, "phi_max: displacement at which all of it slips", low=ABOVE_ZERO),
        Parameter("iwan_exponent", "1", -0.5, "chi: loss per cycle ~ amplitude^(3 + chi)", low=-0.95, high=0.0),
        Parameter("iwan_ratio", "1", 0.5, "beta: stiffness lost at the last slip over that lost before", low=0.0),
    ),
    meaning="a bolted joint that slips from its edge inwards: loss per cycle follows a power of the amplitude",
    equation="-iwan_force sum_k f_k z_k, four sliders of a power-law density, "
    "z_k' = (v / phi_k) (1 - z_k^2 where v z_k > 0)",
    group="friction",
    confused=("bouc_wen", "presliding", "cubic_stiffness"),
    generalises=("bouc_wen",),
    natural={"iwan_distance": (0.5,)},
    cite="Segalman, A Four-Parameter Iwan Model for Lap-Type Joints, J. Applied Mechanics 72 (2005) 752",
)
