"""The witness of a regime: positive while it lasts; its first zero is found with a certificate, not by sampling.

A bound B on |W''| over the flight makes W(t) >= W + W' t - B t^2 / 2, so the first zero of that parabola can be jumped
to without passing a zero of W. Far from the surface the jumps are long, at a crossing they are Newton's steps taken
from the safe side, and a grazing touch is passed or met, never overlooked.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import WITHIN
from calib.simulators.impact.flow import flow
from calib.simulators.impact.problem import CONTACT, RELEASED, Regimes

NO_EVENT, EVENT, FAILED = 0, 1, 2  # how the search for the end of a regime ends
MAX_JUMPS = 100_000  # jumps per flight before it is given up


@njit(**WITHIN)
def _largest(value: float, slope: float, stiffness: float, rate: float, horizon: float) -> float:
    """Bound |x| over the horizon, where x'' + 2 rate x' + stiffness x = 0 starts from value, slope."""
    if rate >= 0.0 and stiffness > rate * rate:
        return math.sqrt(value * value + slope * slope / stiffness)
    if rate >= 0.0 and stiffness >= 0.0:
        return abs(value) + abs(slope) * (min(horizon, 0.5 / rate) if rate > 0.0 else horizon)
    growth = math.exp((math.sqrt(max(0.0, -stiffness)) + 2.0 * max(0.0, -rate)) * horizon)
    return (abs(value) + abs(slope) * horizon) * growth


@njit(**WITHIN)
def witness(
    regimes: Regimes,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    omega: float,
    time: float,
    loaded: bool,
    load: np.ndarray,
    added: np.ndarray,
    step: float,
    tau: float,
    horizon: float,
) -> tuple[float, float, float, float]:
    """Value, first and second rate of the witness, and a bound on the second over the horizon.

    Parameters
    ----------
    y, v : (n,) modal motion at the instant, in regime `r`
    time : since the whole period  [s]
    load : (n, 5) modal load over the step as a polynomial in tau / step, where `loaded`
    added : (5,) polynomial in tau / step that inputs and laws add to the witness, where `loaded`
    tau : since the step began  [s]
    """
    c, s = math.cos(omega * time), math.sin(omega * time)
    wc, ws, w0 = regimes.witness[r, 0], regimes.witness[r, 1], regimes.witness[r, 2]
    value = wc * c + ws * s + w0
    first = omega * (ws * c - wc * s)
    second = -omega * omega * (wc * c + ws * s)
    bound = omega * omega * math.sqrt(wc * wc + ws * ws)
    x = tau / step
    if loaded:
        value += added[0] + x * (added[1] + x * (added[2] + x * (added[3] + x * added[4])))
        first += (added[1] + x * (2.0 * added[2] + x * (3.0 * added[3] + x * 4.0 * added[4]))) / step
        second += (2.0 * added[2] + x * (6.0 * added[3] + x * 12.0 * added[4])) / (step * step)
        bound += (2.0 * abs(added[2]) + 6.0 * abs(added[3]) + 12.0 * abs(added[4])) / (step * step)
    for i in range(y.size):
        stiffness, rate = regimes.stiffness[r, i], regimes.rate[r, i]
        wy, wv = regimes.witness_y[r, i], regimes.witness_v[r, i]
        acceleration = -2.0 * rate * v[i] - stiffness * y[i]
        if loaded:
            f = load[i]
            acceleration += f[0] + x * (f[1] + x * (f[2] + x * (f[3] + x * f[4])))
        jerk = -2.0 * rate * acceleration - stiffness * v[i]
        if loaded:
            jerk += (f[1] + x * (2.0 * f[2] + x * (3.0 * f[3] + x * 4.0 * f[4]))) / step
        snap = -2.0 * rate * jerk - stiffness * acceleration
        if loaded:
            snap += (2.0 * f[2] + x * (6.0 * f[3] + x * 12.0 * f[4])) / (step * step)
            # what the curvature of the load may still add, by Duhamel's integral with |S(t)| <= t
            bound += abs(wy) * (abs(f[2]) + abs(f[3]) + abs(f[4]))
            bound += abs(wv) * (3.0 * abs(f[3]) + 4.0 * abs(f[4])) / step
        value += wy * y[i] + wv * v[i]
        first += wy * v[i] + wv * acceleration
        second += wy * acceleration + wv * jerk
        bound += _largest(wy * acceleration + wv * jerk, wy * jerk + wv * snap, stiffness, rate, horizon)
    return value, first, second, bound


@njit(**WITHIN)
def first_zero(
    regimes: Regimes,
    r: int,
    touch: int,
    y: np.ndarray,
    v: np.ndarray,
    omega: float,
    time: float,
    loaded: bool,
    load: np.ndarray,
    added: np.ndarray,
    step: float,
    reach: float,
    resolution: float,
    lift: float,
    ye: np.ndarray,
    ve: np.ndarray,
) -> tuple[int, float, int]:
    """Find the first end of the regime within `reach` [s] of now.

    Parameters
    ----------
    r : FREE or CONTACT; the contact ends at once where its witness starts below zero
    touch : HIT where the flight starts on the surface, RELEASED where it also starts without speed
    ye, ve : (n,) scratch

    Returns
    -------
    outcome : NO_EVENT, EVENT or FAILED (not finite, or more than `MAX_JUMPS`)
    tau : when  [s]
    jumps : how many were made
    """
    tau = 0.0
    contact = r == CONTACT
    for jump in range(MAX_JUMPS):
        if jump == 0:
            for i in range(y.size):
                ye[i], ve[i] = y[i], v[i]
        else:
            flow(regimes, r, y, v, loaded, load, step, tau, ye, ve)
        value, first, _, bound = witness(
            regimes, r, ye, ve, omega, time + tau, loaded, load, added, step, tau, reach - tau
        )
        if not (math.isfinite(value) and math.isfinite(bound)):
            return FAILED, tau, jump + 1
        on_surface = jump == 0 and touch != 0 and not contact
        if on_surface:
            value = 0.0
        if value <= 0.0 and not on_surface and (contact or first < 0.0):
            return EVENT, tau, jump + 1
        value = max(value, 0.0)
        root = math.sqrt(first * first + 2.0 * bound * value)
        if first < 0.0:
            ahead = 2.0 * value / (root - first)
            if ahead < resolution and not on_surface:
                return (EVENT if tau + ahead <= reach else NO_EVENT), tau + ahead, jump + 1
        else:
            ahead = (first + root) / bound if bound > 0.0 else math.inf
        ahead = max(ahead, resolution)
        if on_surface and (touch == RELEASED or first <= 0.0):
            ahead = max(ahead, lift)
        tau += ahead
        if tau >= reach:
            return NO_EVENT, reach, jump + 1
    return FAILED, tau, MAX_JUMPS
