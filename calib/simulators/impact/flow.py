"""Motion of linear modes in closed form, under no load or one that is a polynomial in time."""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import WITHIN
from calib.simulators.impact.problem import Regimes

SERIES_TERMS = 26  # of the series for polynomial loads; reaches rounding for max(sqrt(stiffness), 2 rate) tau <= 2
MAX_SERIES_ARGUMENT = 2.0  # that limit
_INVERSE_FACTORIAL = np.array([1.0 / math.factorial(i) for i in range(SERIES_TERMS + 6)])


@njit(**WITHIN)
def impulse_response(stiffness: float, rate: float, tau: float) -> tuple[float, float]:
    """Response S(tau) [s] and its rate S'(tau) [1] to a unit impulse of y'' + 2 rate y' + stiffness y.

    stiffness [1/s^2] of any sign, rate [1/s], tau [s]; under-, over- or critically damped.
    """
    square = stiffness - rate * rate
    x = square * tau * tau
    if x > 1e-3:
        decay = math.exp(-rate * tau)
        w = math.sqrt(square)
        s = decay * math.sin(w * tau) / w
        c = decay * math.cos(w * tau)
    elif x > -1e-3:  # sin and cos of a small angle, real or imaginary
        decay = math.exp(-rate * tau)
        s = decay * tau * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0)))
        c = decay * (1.0 - x / 2.0 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0))))
    else:
        w = math.sqrt(-square)
        # w - rate, without cancellation where both are large
        slow = math.exp((-stiffness / (rate + w) if rate > 0.0 else w - rate) * tau)
        fast = math.exp(-(rate + w) * tau)
        s = 0.5 * (slow - fast) / w
        c = 0.5 * (slow + fast)
    return s, c - rate * s


@njit(**WITHIN)
def load_responses(stiffness: float, rate: float, tau: float) -> tuple[float, float, float, float, float, float]:
    """Return Q_4, Q_3, ..., Q_-1, where tau^(k+2) Q_k is the response at tau to the load t^k / k! from rest.

    Q_k = sum_j s_j / (j+k+2)!,  s_j = a s_(j-1) + b s_(j-2),  a = -2 rate tau,  b = -stiffness tau^2
    for the two highest, and Q_(k-2) = 1/k! + a Q_(k-1) + b Q_k downwards. Q_-1 belongs to the impulse.
    """
    a = -2.0 * rate * tau
    b = -stiffness * tau * tau
    before, now = 0.0, 1.0
    q4, q3 = 0.0, 0.0
    for j in range(SERIES_TERMS):
        q4 += now * _INVERSE_FACTORIAL[j + 6]
        q3 += now * _INVERSE_FACTORIAL[j + 5]
        before, now = now, a * now + b * before
        if abs(now) + abs(before) < 1e-12:  # their share is below 1e-12 / 7! / Q_3
            break
    q2 = 1.0 / 24.0 + a * q3 + b * q4
    q1 = 1.0 / 6.0 + a * q2 + b * q3
    q0 = 0.5 + a * q1 + b * q2
    return q4, q3, q2, q1, q0, 1.0 + a * q0 + b * q1


@njit(**WITHIN)
def load_motion(stiffness: float, rate: float, tau: float, load: np.ndarray, step: float) -> tuple[float, float]:
    """Displacement and velocity at tau that the load sum_k load[k] (t / step)^k, k = 0..4, makes from rest."""
    q4, q3, q2, q1, q0, impulse = load_responses(stiffness, rate, tau)
    x = tau / step
    f0, f1, f2, f3, f4 = load[0], load[1] * x, load[2] * x**2 * 2.0, load[3] * x**3 * 6.0, load[4] * x**4 * 24.0
    y = tau * tau * (f0 * q0 + f1 * q1 + f2 * q2 + f3 * q3 + f4 * q4)
    v = tau * (f0 * impulse + f1 * q0 + f2 * q1 + f3 * q2 + f4 * q3)
    return y, v


@njit(**WITHIN)
def flow(
    regimes: Regimes,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    loaded: bool,
    load: np.ndarray,
    step: float,
    tau: float,
    y_end: np.ndarray,
    v_end: np.ndarray,
) -> None:
    """Write the modal motion in regime `r` at `tau` after (y, v) into y_end, v_end (n,).

    load (n, 5) over `step` [s] as in `load_motion`, where `loaded`.
    """
    for i in range(y.size):
        stiffness, rate = regimes.stiffness[r, i], regimes.rate[r, i]
        s, c = impulse_response(stiffness, rate, tau)
        y_end[i] = (c + 2.0 * rate * s) * y[i] + s * v[i]
        v_end[i] = c * v[i] - stiffness * s * y[i]
        if loaded:
            dy, dv = load_motion(stiffness, rate, tau, load[i], step)
            y_end[i] += dy
            v_end[i] += dv
