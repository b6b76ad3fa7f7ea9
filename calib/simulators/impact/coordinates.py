"""From modal motion to the coordinates of the structure, and back."""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import INLINED, WITHIN
from calib.simulators.impact.problem import CONTACT, FREE, Regimes


@njit(**INLINED)
def modal_row(r: int) -> int:
    """Row of `Regimes` in whose modes the motion of regime `r` is given: a compliant contact has those out of it."""
    return CONTACT if r == CONTACT else FREE


@njit(**WITHIN)
def to_coordinates(
    regimes: Regimes,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    omega: float,
    time: float,
    u: float,
    du: float,
    q: np.ndarray,
    dq: np.ndarray,
) -> None:
    """Write q, dq (n,) [m], [m/s] of the modal motion y, v in regime `r` at `time`, under the input u, du."""
    c, s = math.cos(omega * time), math.sin(omega * time)
    for j in range(q.size):
        qc, qs = regimes.motion[r, j, 0], regimes.motion[r, j, 1]
        q[j] = qc * c + qs * s + regimes.motion[r, j, 2] + regimes.motion_input[r, j] * u
        dq[j] = omega * (qs * c - qc * s) + regimes.motion_input[r, j] * du
        for i in range(y.size):
            q[j] += regimes.shape[r, j, i] * y[i]
            dq[j] += regimes.shape[r, j, i] * v[i]


@njit(**WITHIN)
def to_modes(
    regimes: Regimes,
    r: int,
    q: np.ndarray,
    dq: np.ndarray,
    omega: float,
    time: float,
    u: float,
    du: float,
    y: np.ndarray,
    v: np.ndarray,
) -> None:
    """Write the modal motion y, v (n,) of the coordinates q, dq (n,): the inverse of `to_coordinates`."""
    c, s = math.cos(omega * time), math.sin(omega * time)
    for i in range(y.size):
        y[i] = 0.0
        v[i] = 0.0
    for j in range(q.size):
        qc, qs = regimes.motion[r, j, 0], regimes.motion[r, j, 1]
        modal = q[j] - (qc * c + qs * s + regimes.motion[r, j, 2] + regimes.motion_input[r, j] * u)
        rate = dq[j] - (omega * (qs * c - qc * s) + regimes.motion_input[r, j] * du)
        for i in range(y.size):
            y[i] += regimes.project[r, i, j] * modal
            v[i] += regimes.project[r, i, j] * rate
