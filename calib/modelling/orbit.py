"""A motion seen once per period of its excitation, and how its neighbours depart from it."""

from typing import NamedTuple

import numpy as np

from calib.records import OK


class Orbit(NamedTuple):
    """States that a period map runs through.

    Attributes
    ----------
    states : (n, dimension) at the ends of the periods, each in the unit of its component; fewer rows than asked for
        where `status` is not "ok"
    displacement, velocity : (body, n) of every body at the same instants  [m], [m/s]
    impacts : (k, 3) period in which it happens, counted from 0; phase in [0, 1) since that period's start [1, in
        periods]; closing speed [m/s]
    contact : share of the time spent in permanent contact  [1]
    status, reason : "ok", or "diverged", "step budget", ... and why
    """

    states: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    impacts: np.ndarray
    contact: float = 0.0
    status: str = OK
    reason: str = ""


class Tangent(NamedTuple):
    """Small differences carried along an orbit, made orthonormal after each period.

    All vectors are in units of the map's scale, so that displacements and velocities can be compared. With V_0 the
    vectors given, made orthonormal, and J_k the Jacobian of period k, J_k V_(k-1) = V_k R_k.

    Attributes
    ----------
    states : (n, dimension) at the ends of the periods; fewer rows than asked for where the motion fails
    vectors : (dimension, m) V_n
    growth : (n, m, m) upper triangular R_k, its diagonal not negative; a direction that a phase of contact wipes out
        has a zero there
    """

    states: np.ndarray
    vectors: np.ndarray
    growth: np.ndarray
