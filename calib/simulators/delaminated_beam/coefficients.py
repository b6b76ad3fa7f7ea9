"""Coefficients of damping and contact of a run, which both kernels take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.modelling.laws import BoundLaw


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients of damping and contact; arrays are (m,) of the contact pairs.

    Attributes
    ----------
    alpha, beta : Rayleigh damping  [1/s], [s]
    clearance, stiffness, damping : [m], [N/m], [N s/m]
    impact_separation : time without contact that separates two impacts  [s]
    lagged : whether contact damping sees the velocity before a step, instead of the mean; the full kernel only
    clipped : whether the contact force cannot pull
    laws : that act on the motion
    """

    alpha: float
    beta: float
    clearance: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    impact_separation: float
    lagged: bool = False
    clipped: bool = True
    laws: Sequence[BoundLaw] = ()
