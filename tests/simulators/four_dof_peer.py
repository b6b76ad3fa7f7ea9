"""The minimal model once more, with scipy's DOP853 and its events, sharing only the matrices with the simulator."""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import eigh
from scipy.optimize import brentq

from calib.simulators.four_dof.lumped import lumped

NORMAL = np.array([0.0, -1.0, 1.0, 0.0])  # r = g + q3 - q2
HOLD = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 1.0, 0], [0, 0, 1.0]])  # q = HOLD p - (0, 0, g, 0)
RTOL, ATOL = 3e-14, 1e-15  # the second relative to 1 mm and 0.1 m/s
STEPS = 64  # per period at least
PUSH = 1e-18  # m, by which the layer is taken off the surface after an event


class Peer(NamedTuple):
    """Impacts; `contacts` counts the phases of permanent contact."""

    times: np.ndarray  # (n,) s
    speeds: np.ndarray  # (n,) m/s
    contacts: int


def damping_matrix(mass, stiffness, ratio):
    """Return the matrix C (n, n) [kg/s] of one damping ratio for all modes."""
    eigenvalues, modes = eigh(stiffness, mass)
    return mass @ modes @ np.diag(2.0 * ratio * np.sqrt(np.maximum(eigenvalues, 0.0))) @ modes.T @ mass


def spring_drive(values, amplitude):
    """Mass, stiffness, damping (4, 4) and load amplitude [N] of drive `spring`."""
    body = lumped(values)
    stiffness = body.stiffness.copy()
    stiffness[0, 0] += body.spring
    damping = damping_matrix(body.mass, stiffness, values["damping"])
    w = 2.0 * np.pi * values["reference_frequency"]
    answer = np.linalg.solve(stiffness - w**2 * body.mass + 1j * w * damping, [body.spring, 0, 0, 0])
    return body.mass, stiffness, damping, body.spring * amplitude * values["amplitude"] / abs(answer[0])


def _along(event, dense, t):
    return event(t, dense(t))


def dop853(values, frequency, amplitude, stop_after, faster=1e-3, end=np.inf, law=None, inner=0, rtol=RTOL):
    """Integrate from rest until `stop_after` impacts faster than `faster` [m/s], or until `end` [s].

    law(t, q, dq) -> (4,) accelerations [m/s^2]; with `inner` states of its own, law(t, q, dq, z) -> accelerations and
    their rates (inner,).
    """
    mass, stiffness, damping, load = spring_drive(values, amplitude)
    gap, e = values["gap"], values["restitution"]
    w = 2.0 * np.pi * frequency
    inverse = np.linalg.inv(mass)
    mass_c, stiffness_c = HOLD.T @ mass @ HOLD, HOLD.T @ stiffness @ HOLD
    damping_c, inverse_c = damping_matrix(mass_c, stiffness_c, values["damping"]), np.linalg.inv(mass_c)
    hung = np.array([0.0, 0.0, -gap, 0.0])
    pull = np.array([load, 0.0, 0.0, 0.0])

    def given(t, q, dq, z):
        if law is None:
            return 0.0, z
        accelerations, rates = law(t, q, dq, z) if inner else (law(t, q, dq), z)
        return mass @ accelerations, rates

    def acceleration(t, q, dq, z):
        force, rates = given(t, q, dq, z)
        return inverse @ (pull * np.cos(w * t) + force - stiffness @ q - damping @ dq), rates

    def free(t, x):
        return np.concatenate([x[4:8], *acceleration(t, x[:4], x[4:8], x[8:])])

    def held(t, x):
        p, dp = x[:3], x[3:6]
        q, dq = HOLD @ p + hung, HOLD @ dp
        load, rates = given(t, q, dq, x[6:])
        force = HOLD.T @ (pull * np.cos(w * t) + load - stiffness @ hung)
        return np.concatenate([dp, inverse_c @ (force - stiffness_c @ p - damping_c @ dp), rates])

    def clearance(t, x):
        return gap + NORMAL @ x[:4]

    def pressing(t, x):
        return -NORMAL @ acceleration(t, HOLD @ x[:3] + hung, HOLD @ x[3:6], x[6:])[0]

    t, x, contact = 0.0, np.zeros(8 + inner), False
    times, speeds, contacts = [], [], 0
    scale = ATOL * np.concatenate([np.repeat([1e-3, 0.1], 4), np.full(inner, 1e-3)])
    while sum(s > faster for s in speeds) < stop_after and t < end:
        fun, event = (held, pressing) if contact else (free, clearance)
        tolerance = np.delete(scale, [2, 6]) if contact else scale
        solver = DOP853(fun, t, x, end, rtol=rtol, atol=tolerance, max_step=1.0 / (frequency * STEPS))
        before = event(t, x)
        while True:
            solver.step()
            after = event(solver.t, solver.y)
            if after <= 0.0 or solver.status != "running":
                break
            before = after
        t, x = solver.t, solver.y
        if after > 0.0:
            break
        dense = solver.dense_output()
        if before > 0.0:
            t = brentq(partial(_along, event, dense), solver.t_old, solver.t, xtol=1e-16, rtol=1e-15)
        else:
            t = solver.t_old
        x = dense(t)
        if contact:
            contact = False
            x = np.concatenate([HOLD @ x[:3] + hung, HOLD @ x[3:6], x[6:]])
            x[2] += PUSH
            continue
        rate = NORMAL @ x[4:8]
        times.append(t)
        speeds.append(-rate)
        x[6] -= (1.0 + e) * rate
        rate = -e * rate
        pressing_now = -NORMAL @ acceleration(t, x[:4], x[4:8], x[8:])[0]
        if pressing_now > 0.0 and rate**2 / (2.0 * pressing_now) < 1e-12 * gap:
            contact, contacts = True, contacts + 1
            x = np.delete(x, [2, 6])
        else:
            x[2] = x[1] - gap + PUSH
    return Peer(np.array(times), np.array(speeds), contacts)
