"""Period maps in closed form, whose dynamics are known: what the rooms of `calib.dynamics` are tried on."""

from collections.abc import Callable

import numpy as np

from calib.modelling.orbit import Orbit, Tangent


class PlainMap:
    """A map x -> f(x) with its Jacobian; `derivative` None stands for a simulator that does not know its own."""

    period = 1.0
    bodies = ("body",)
    impacting = False

    def __init__(self, function: Callable, derivative: Callable | None, initial, limit: float = 1e3):
        self.function, self.derivative, self.limit = function, derivative, limit
        self.initial = np.array(initial, dtype=float)
        self.scale = np.ones(self.initial.size)
        self.names = ("body.displacement", "body.velocity", *(f"x{i}" for i in range(2, self.initial.size)))
        self.names = self.names[: self.initial.size]
        self.units = ("m", "m/s", *("1" for _ in self.names[2:]))[: self.initial.size]

    def orbit(self, state, periods):
        states, x, status, reason = [], np.array(state, dtype=float), "ok", ""
        for _ in range(periods):
            x = np.asarray(self.function(x), dtype=float)
            if not np.abs(x).max() < self.limit:
                status, reason = "diverged", "the map's state grew beyond bounds"
                break
            states.append(x)
        states = np.array(states).reshape(-1, self.initial.size)
        velocity = states[:, 1] if self.initial.size > 1 else np.zeros(len(states))
        return Orbit(states, states[None, :, 0], velocity[None], np.zeros((0, 3)), 0.0, status, reason)

    def tangent(self, state, vectors, periods):
        if self.derivative is None:
            return None
        states, growth, x = [], [], np.array(state, dtype=float)
        vectors = _orthonormal(vectors)[0]
        for _ in range(periods):
            vectors, r = _orthonormal(np.atleast_2d(self.derivative(x)) @ vectors)
            x = np.asarray(self.function(x), dtype=float)
            states.append(x)
            growth.append(r)
        return Tangent(np.array(states), vectors, np.array(growth))

    def near_misses(self, state):
        return np.zeros(0)


def _orthonormal(vectors):
    q, r = np.linalg.qr(vectors)
    sign = np.where(np.diag(r) < 0.0, -1.0, 1.0)
    return q * sign, sign[:, None] * r


def logistic(a):
    """Logistic map x -> a x (1 - x): period 2 from 3, 4 from 1 + sqrt 6, 8 from 3.54409, at 4 exponent ln 2."""
    return PlainMap(lambda x: a * x * (1.0 - x), lambda x: np.diag(a * (1.0 - 2.0 * x)), [0.3])


def henon(a, b=0.3):
    """Map of Henon: a fold of the fixed points at a = -(1 - b)^2 / 4, a flip at 3 (1 - b)^2 / 4."""
    return PlainMap(
        lambda x: np.array([1.0 - a * x[0] ** 2 + x[1], b * x[0]]),
        lambda x: np.array([[-2.0 * a * x[0], 1.0], [b, 0.0]]),
        [0.1, 0.1],
    )


def delayed_logistic(a):
    """x_(n+1) = a x_n (1 - x_(n-1)): a Neimark-Sacker point at a = 2, quasi-periodic motion just above it."""
    return PlainMap(
        lambda x: np.array([a * x[0] * (1.0 - x[1]), x[0]]),
        lambda x: np.array([[a * (1.0 - x[1]), -a * x[0]], [1.0, 0.0]]),
        [0.4, 0.45],
    )


class GrazingMap:
    """Map of Nordmark: u' = alpha u + v + c - kick sqrt(u - gap) where u > gap, v' = -gamma u.

    Where u > gap there is an impact with the closing speed w = sqrt(u - gap), else a miss of gap - u. Without impact
    the cycle is u = c / (1 - alpha + gamma) = 1, whatever the gap: the miss is gap - 1. With an impact it is
    0.9 w^2 + kick w = 0.9 (1 - gap): for kick > 0 the impact goes on where the miss comes to zero, at gap = 1, for
    kick < 0 both end there, and the cycle with impact folds at gap = 1 + (kick / 1.8)^2.
    """

    period, bodies, impacting = 1.0, ("body",), True
    names, units = ("body.displacement", "body.velocity"), ("m", "m/s")
    alpha, gamma = 0.3, 0.2

    def __init__(self, gap, kick=0.1, section=0.5):
        self.gap, self.kick, self.section = gap, kick, section
        self.scale, self.initial = np.ones(2), np.array([0.9, -0.2])

    def orbit(self, state, periods):
        states = [np.array(state, dtype=float)]
        for _ in range(periods):
            u, v = states[-1]
            states.append(np.array([self.alpha * u + v + 0.9 - self.kick * self.speed(u), -self.gamma * u]))
        impacts = [(k, self.section, self.speed(x[0])) for k, x in enumerate(states[:-1]) if x[0] > self.gap]
        states = np.array(states[1:])
        return Orbit(states, states[None, :, 0], states[None, :, 1], np.array(impacts).reshape(-1, 3))

    def tangent(self, state, vectors, periods):
        states, growth, vectors = self.orbit(state, periods).states, [], _orthonormal(vectors)[0]
        for u, _ in (state, *states[:-1]):
            slope = self.alpha - (0.5 * self.kick / self.speed(u) if u > self.gap else 0.0)
            vectors, r = _orthonormal(np.array([[slope, 1.0], [-self.gamma, 0.0]]) @ vectors)
            growth.append(r)
        return Tangent(states, vectors, np.array(growth))

    def near_misses(self, state):
        return np.array([self.gap - state[0]] if state[0] <= self.gap else [])

    def speed(self, u):
        return np.sqrt(max(u - self.gap, 0.0))


FOLDS = 2.0 / np.sqrt(27.0)  # at this load, and at its negative, one of the cycles of `bistable` ends


def bistable(load):
    """Map u' = u + (load + u - u^3) / 2 of u = x + v, with v' = v / 2: from |load| < FOLDS on, two cycles attract.

    At load 0 these are u = -1 and 1; for |u| < sqrt 3 the sign of u says which, and |u| > sqrt 5 diverges.
    """

    def function(x):
        u, v = x.sum(), 0.5 * x[1]
        return np.array([u + 0.5 * (load + u - u**3) - v, v])

    def derivative(x):
        slope = 1.5 - 1.5 * x.sum() ** 2
        return np.array([[slope, slope - 0.5], [0.0, 0.5]])

    return PlainMap(function, derivative, [-1.0, 0.0])
