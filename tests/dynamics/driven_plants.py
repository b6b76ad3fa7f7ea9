"""Driven oscillators integrated in physical coordinates, apart from the simulators: stepped sweeps and folds."""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853
from scipy.optimize import fsolve

A, B, C = (np.ascontiguousarray(table) for table in (DOP853.A[:12, :12], DOP853.B, DOP853.C[:12]))
STAGES = 12
BISECTIONS = 52  # of a step in which a body meets the stop
SETTLED = 2e-12  # change of the state over a period, over the largest of the motion, at which it is stationary  [1]
MAX_SETTLING = 20_000  # periods
PASSED = 12  # frequencies between two of a sweep, so that no step leaves the basin of a motion
PASSING_PERIODS = 6  # at each of them
DIFFERENCE = 1e-5  # of the components of a state, over their scale, from which the period map is differentiated  [1]


class Plant(NamedTuple):
    """Equations of motion over the masses: q'' = load cos(angle) - stiffness q - damping q' + laws on one body.

    Attributes
    ----------
    stiffness, damping : (n, n)  [1/s^2], [1/s]
    load : (n,)  [m/s^2]
    body : index of the one that the laws act on, and whose first harmonic is taken
    cubic : of the body's displacement  [1/(m^2 s^2)]
    play : (4,) of a mount behind a slider: stiffness [1/s^2], half the play [m], force at which the slider begins to
        move [m/s^2], range of the force over which its speed comes to that of the body  [m/s^2]
    gap, restitution : of a rigid stop at body = gap  [m], [1]; inf: no stop
    phase : of the excitation at time 0  [rad]
    """

    stiffness: np.ndarray
    damping: np.ndarray
    load: np.ndarray
    body: int = 0
    cubic: float = 0.0
    play: np.ndarray = np.array([0.0, 1.0, 1.0, 1.0])
    gap: float = np.inf
    restitution: float = 1.0
    phase: float = 0.0


def one_mass(mass, damping, stiffness, force, **laws):
    """One mass on a spring and a damper, driven by a force  [kg, N s/m, N/m, N]."""
    return Plant(np.array([[stiffness / mass]]), np.array([[damping / mass]]), np.array([force / mass]), **laws)


@njit(cache=True)
def rates(t, y, plant, omega, dy):
    """Time derivative dy of y (2 n + 3,): q, q', slider, integrals of the body's q times cosine and sine."""
    n = plant.load.size
    angle = omega * t + plant.phase
    for i in range(n):
        dy[i] = y[n + i]
        dy[n + i] = plant.load[i] * np.cos(angle)
        for j in range(n):
            dy[n + i] -= plant.stiffness[i, j] * y[j] + plant.damping[i, j] * y[n + j]
    x, v, z = y[plant.body], y[n + plant.body], y[2 * n]
    beyond = np.sign(x - z) * max(0.0, abs(x - z) - plant.play[1])
    excess = plant.play[0] * abs(beyond) - plant.play[2]
    dy[n + plant.body] -= plant.cubic * x**3 + plant.play[0] * beyond
    dy[2 * n] = v * min(1.0, excess / plant.play[3]) if excess > 0.0 and beyond * v > 0.0 else 0.0
    dy[2 * n + 1], dy[2 * n + 2] = x * np.cos(angle), x * np.sin(angle)


@njit(cache=True)
def stepped(t, y, plant, omega, h, slopes, stage, ahead):
    """State `ahead` after one step h of the method of order 8 of Dormand and Prince."""
    for s in range(STAGES):
        for i in range(y.size):
            stage[i] = y[i]
            for r in range(s):
                stage[i] += h * A[s, r] * slopes[r, i]
        rates(t + C[s] * h, stage, plant, omega, slopes[s])
    for i in range(y.size):
        ahead[i] = y[i]
        for s in range(STAGES):
            ahead[i] += h * B[s] * slopes[s, i]


@njit(cache=True)
def after_period(y, plant, frequency, steps):
    """State and integrals after one period of equal steps, which impacts cut, and the number of impacts."""
    now, omega, impacts = y.copy(), 2.0 * np.pi * frequency, 0
    now[-2:] = 0.0
    slopes, stage, ahead = np.empty((STAGES, y.size)), np.empty(y.size), np.empty(y.size)
    for i in range(steps):
        t, left = i / (frequency * steps), 1.0 / (frequency * steps)
        stepped(t, now, plant, omega, left, slopes, stage, ahead)
        while ahead[plant.body] > plant.gap:
            low, high = 0.0, left
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                stepped(t, now, plant, omega, middle, slopes, stage, ahead)
                if ahead[plant.body] > plant.gap:
                    high = middle
                else:
                    low = middle
            stepped(t, now, plant, omega, low, slopes, stage, ahead)
            now[:] = ahead
            now[plant.load.size + plant.body] *= -plant.restitution
            impacts += 1
            t += low
            left -= low
            stepped(t, now, plant, omega, left, slopes, stage, ahead)
        now[:] = ahead
    return now, impacts


@njit(cache=True)
def settled(y, plant, frequency, steps):
    """State and integrals of the stationary motion that y settles to; not a number where it settles to none."""
    n = plant.load.size
    largest = np.zeros(2 * n)
    for _ in range(MAX_SETTLING):
        ahead = after_period(y, plant, frequency, steps)[0]
        change = 0.0
        for i in range(2 * n):
            largest[i] = max(abs(ahead[i]), 0.9 * largest[i])
            size = largest[:n].max() if i < n else largest[n:].max()
            change = max(change, abs(ahead[i] - y[i]) / size)
        y = ahead
        if change < SETTLED:
            return y
    return np.full(y.size, np.nan)


def sweep(plant, frequencies, steps):
    """Complex first harmonics (m,) of the body [m], settled at one frequency [Hz] after the other."""
    y, harmonics, before = np.zeros(2 * plant.load.size + 3), [], frequencies[0]
    for frequency in frequencies:
        for between in np.linspace(before, frequency, PASSED + 2)[1:-1]:
            for _ in range(PASSING_PERIODS):
                y = after_period(y, plant, between, steps)[0]
        y = settled(y, plant, frequency, steps)
        harmonics.append(2.0 * frequency * (y[-2] - 1j * y[-1]))
        before = frequency
    return np.array(harmonics)


def fold(plant, state, frequency, steps):
    """Frequency [Hz] near which a periodic motion near `state` (2 n,) has a multiplier of 1, by Newton's method."""
    scale = np.repeat(np.abs(state).reshape(2, -1).max(axis=1), state.size // 2)

    def mapped(x, f):
        return after_period(np.concatenate([x * scale, np.zeros(3)]), plant, f, steps)[0][: x.size] / scale

    def defining(unknown):
        x, f = unknown[:-1], unknown[-1] * frequency
        sides = [mapped(x + h, f) - mapped(x - h, f) for h in DIFFERENCE * np.eye(x.size)]
        return [*(mapped(x, f) - x), np.linalg.det(np.array(sides) / (2.0 * DIFFERENCE) - np.eye(x.size))]

    root, _, status, message = fsolve(defining, [*(state / scale), 1.0], xtol=1e-11, full_output=True)
    assert status == 1, message
    return root[-1] * frequency
