"""Constants, state and results of a run of the reduced kernel."""

from typing import NamedTuple

import numpy as np


class Drift(NamedTuple):
    """Exact motion of n damped modes over a time h, under an acceleration of the drive that is linear in time.

    q+ = qq q + qv v + q0 f(0) + q1 f(h),  v+ = vq q + vv v + v0 f(0) + v1 f(h), arrays (n,); f = X'' + alpha X'.

    Attributes
    ----------
    kick : (n,) mean effect on v of a steady force over h, sin(omega h / 2) / (omega h / 2)  [1]
    """

    qq: np.ndarray
    qv: np.ndarray
    q0: np.ndarray
    q1: np.ndarray
    vq: np.ndarray
    vv: np.ndarray
    v0: np.ndarray
    v1: np.ndarray
    kick: np.ndarray


class ReducedPlan(NamedTuple):
    """Constants of a run: n modes, m contact pairs, k pairs that are checked in flight.

    Attributes
    ----------
    step, parts : of a flight step [s], and how many parts it has where contact is near
    flight, near : over a step, over a part
    along : (n,) displacement that goes with a change of rate by contact, see `reduction`  [s]
    quadratic : (n + 1, n + 1), tension : (n + 1,), kappa : see `modes`
    stretch : (n,) tension in the kicks, see `reduction`
    opening : (m, n + 1) of the pairs, per modal coordinate and per displacement of the driven node
    watched : (k,) pairs that are checked in flight
    clearance, stiffness, damping : (m,)  [m], [N/m], [N s/m]
    mobility : (m, m) W  [1/kg]
    compliance : (m, m) C  [m/N]
    clipped : whether contact cannot pull
    area, place : (m,) [m^2], [1]
    centre : number of the pair in the middle
    layer : (n + 1,) displacement of the layer in the middle
    guard : (m,) clearance that counts as near  [m]
    limit : displacement beyond which the motion diverges  [m]
    merged : time without contact that separates two impacts  [s]
    force, force_p, acts : laws, as in `explicit.ExplicitPlan`
    columns, masses, bodies : (j, n + 1) displacement of the points at which force laws act, their masses [kg], bodies
    contact, contact_p : laws of the contact
    counts : (2,) laws at force and contact
    """

    step: float
    parts: int
    flight: Drift
    near: Drift
    along: np.ndarray
    quadratic: np.ndarray
    tension: np.ndarray
    stretch: np.ndarray
    kappa: float
    opening: np.ndarray
    watched: np.ndarray
    clearance: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    mobility: np.ndarray
    compliance: np.ndarray
    clipped: bool
    area: np.ndarray
    place: np.ndarray
    centre: int
    layer: np.ndarray
    guard: np.ndarray
    limit: float
    merged: float
    force: np.ndarray
    force_p: np.ndarray
    acts: np.ndarray
    columns: np.ndarray
    masses: np.ndarray
    bodies: np.ndarray
    contact: np.ndarray
    contact_p: np.ndarray
    counts: np.ndarray


class ReducedState(NamedTuple):
    """State of a run, written by the kernel.

    Attributes
    ----------
    q, v : (n + 1,) coordinates, the last that of the drive  [m kg^1/2], their rates
    push : (m,) contact forces of the last part  [N]
    kick : (n,) membrane force  [N kg^-1/2]
    near : (m,) pairs near contact
    last : (2,) times of the last contact, anywhere and in the middle  [s]
    counters : (1,) steps and parts done
    """

    q: np.ndarray
    v: np.ndarray
    push: np.ndarray
    kick: np.ndarray
    near: np.ndarray
    last: np.ndarray
    counters: np.ndarray


class ReducedTrace(NamedTuple):
    """What is recorded while stepping.

    Attributes
    ----------
    times : (s,) of the samples, since the beginning of the call  [s]
    samples : (s, 5) see `explicit.ExplicitTrace`
    impacts, central : (k, 2) time [s] and closing speed [m/s] at which contact begins
    closed : (m,) time for which each pair was closed  [s]
    total : (5,) impacts, central impacts, time with contact [s], largest force [N], deepest penetration [m]
    nearest : (k,) local minima of the clearance while nothing is closed; only where it is not empty
    passes : (3,) smallest clearance one and two steps back, number of minima
    """

    times: np.ndarray
    samples: np.ndarray
    impacts: np.ndarray
    central: np.ndarray
    closed: np.ndarray
    total: np.ndarray
    nearest: np.ndarray
    passes: np.ndarray
