"""The equations of motion of one mass or of several, with every hidden law, and a compiled Dormand and Prince 8(5, 3).

Physical coordinates, one right-hand side for all: nothing here is shared with the simulators, which go by modes, exact
propagators and collocation. The tableau is scipy's.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853

A, B, C = (np.ascontiguousarray(table) for table in (DOP853.A, DOP853.B, DOP853.C))
E3, E5 = (np.ascontiguousarray(table[: DOP853.n_stages]) for table in (DOP853.E3, DOP853.E5))
STAGES = DOP853.n_stages
IMPACTS = 64  # that a call of `fly` notes
MOST = 100_000  # impacts of a flight before it is given up
PUSH = 1e-18  # m, by which a body is taken off the stop after an impact
LIFT = 1e-3  # m/s, at which a body leaves the stop at least: chatter on the way to a stationary motion comes to an end
TOLERANCE = 1e-12  # of a step, relative to the sizes of the motion
LEAST = 1e-10  # s; a shorter step is taken whatever its error: a law jumps there
FLOOR = 0.02  # of the gap, below which the film of air does not get thinner
DONE, BROKEN = 0, 1
TURN = 2.0 * math.pi


class Plant(NamedTuple):
    """What moves.

    Attributes
    ----------
    stiffness, damping : (n, n) over the mass  [1/s^2], [1/s]
    load : (n,) per unit of the input, over the mass
    tones : (k, 3) of the input: amplitude [its unit], angular frequency [rad/s], phase [rad]
    harmonic : 1 where the input is one tone for ever
    normal, hit : (n,) clearance = gap + normal . q; change of the velocities per unit change of its rate
    port : (n,) accelerations per unit force per unit mass that acts across the clearance
    gap, rest : clearance at rest as it is, and as it is stated  [m]; gap = inf: no stop
    restitution : [1]
    body, support : (n,) 1 where laws on a body, or on a support, act
    length, speed : sizes of the motion  [m], [m/s]
    """

    stiffness: np.ndarray
    damping: np.ndarray
    load: np.ndarray
    tones: np.ndarray
    harmonic: int
    normal: np.ndarray
    hit: np.ndarray
    port: np.ndarray
    gap: float
    rest: float
    restitution: float
    body: np.ndarray
    support: np.ndarray
    length: float
    speed: float


class Laws(NamedTuple):
    """Parameters of the hidden laws, each absent as it stands here; SI."""

    c1: float = 0.0
    c2: float = 0.0
    friction: float = 0.0
    friction_slip: float = 1.0
    dahl_force: float = 0.0
    dahl_distance: float = 1.0
    k3: float = 0.0
    k2: float = 0.0
    kx: float = 0.0
    preload: float = 0.0
    support_stiffness: float = 0.0
    support_damping: float = 0.0
    detuning: float = 0.0
    mode_mass: float = 0.0
    mode_frequency: float = 1.0
    mode_damping: float = 0.02
    h2_cos: float = 0.0
    h2_sin: float = 0.0
    h3_cos: float = 0.0
    h3_sin: float = 0.0
    modulation: float = 0.0
    backlash_stiffness: float = 0.0
    backlash_width: float = 1.0
    backlash_force: float = 1.0
    adhesion: float = 0.0
    rate_exponent: float = 0.0
    rate_speed: float = 1.0
    squeeze: float = 0.0
    lowpass: float = 0.0
    hysteresis_force: float = 0.0
    hysteresis_distance: float = 1.0
    hysteresis_exponent: float = 2.0
    hysteresis_shape: float = 0.5
    stribeck_force: float = 0.0
    stribeck_distance: float = 1.0
    stribeck_rise: float = 0.0
    stribeck_speed: float = 1.0
    power_damping: float = 0.0
    power_exponent: float = 1.0
    magnet_strength: float = 0.0
    magnet_distance: float = 1.0
    damping_rise: float = 0.0
    quintic: float = 0.0
    second_stop: float = 0.0
    stop_place: float = 1.0
    parametric: float = 0.0
    parametric_order: float = 2.0
    coupling: float = 0.0
    magnet: float = 0.0
    magnet_place: float = 0.0
    magnet_width: float = 1.0
    cogging: float = 0.0
    cogging_pitch: float = 1.0
    valve: float = 0.0

    @property
    def stateful(self) -> bool:
        """Whether a law has states of its own: z of one friction, u and u' of an attached mode, low-passed velocity."""
        sliding = self.dahl_force != 0.0, self.hysteresis_force != 0.0, self.stribeck_force != 0.0
        assert sum(sliding) < 2, "a body has one z: hide one of Dahl's friction, Bouc-Wen's and Stribeck's"
        return any(sliding) or self.mode_mass != 0.0 or self.lowpass != 0.0


@njit(cache=True)
def drive(t, plant, p):
    """Input at time t  [its unit]."""
    u = 0.0
    for tone in plant.tones:
        u += tone[0] * math.cos(tone[1] * t + tone[2])
    more = p.modulation * t * u
    if plant.harmonic:
        turn = plant.tones[0, 1] * t + plant.tones[0, 2]
        more += plant.tones[0, 0] * (p.h2_cos * math.cos(2.0 * turn) + p.h2_sin * math.sin(2.0 * turn))
        more += plant.tones[0, 0] * (p.h3_cos * math.cos(3.0 * turn) + p.h3_sin * math.sin(3.0 * turn))
    return u + more


@njit(cache=True)
def slider(x, z, p):
    """Place of the slider [m] that was at z: dragged along where the spring would pull more than its friction."""
    reach = p.backlash_width + p.backlash_force / abs(p.backlash_stiffness)
    return min(max(z, x - reach), x + reach)


@njit(cache=True)
def backlash(x, z, p):
    """Pull of the spring beyond the dead zone [m/s^2]."""
    u = x - slider(x, z, p)
    return -p.backlash_stiffness * (u - min(max(u, -p.backlash_width), p.backlash_width))


@njit(cache=True)
def on_body(t, x, v, z, p):
    """Acceleration by the laws that act on a body and have no state of their own [m/s^2]."""
    a = -p.c1 * v - p.c2 * v * abs(v) - p.k3 * x**3 - p.k2 * x**2 - p.kx * x * abs(x) + p.preload - p.detuning * t * x
    if p.friction != 0.0:
        a -= p.friction * math.tanh(v / p.friction_slip)
    a -= p.damping_rise * t * v
    if p.power_damping != 0.0:
        a -= p.power_damping * math.copysign(abs(v) ** p.power_exponent, v)
    if p.magnet_strength != 0.0:
        a -= p.magnet_strength * math.copysign(1.0, p.magnet_distance) / (p.magnet_distance + x) ** 2
    if p.quintic != 0.0:
        a -= p.quintic * x**5
    if p.second_stop != 0.0:  # as spheres touch
        a += p.second_stop * max(0.0, -p.stop_place - x) ** 1.5
    if p.magnet != 0.0:  # pulled to a place that it passes
        u = (x - p.magnet_place) / p.magnet_width
        a -= p.magnet * u * math.exp(-0.5 * u * u)
    if p.cogging != 0.0:
        a -= p.cogging * math.sin(TURN * x / p.cogging_pitch)
    a -= p.valve * max(0.0, x) * max(0.0, v)  # which throttles one way only, and the more the further out
    if p.backlash_stiffness != 0.0:
        a += backlash(x, z, p)
    return a


@njit(cache=True)
def clearance(y, plant):
    """Clearance [m] and its rate [m/s]."""
    n = plant.load.size
    r, rate = plant.gap, 0.0
    for i in range(n):
        r += plant.normal[i] * y[i]
        rate += plant.normal[i] * y[n + i]
    return r, rate


@njit(cache=True)
def modulated(t, x, stiffness, plant, p):
    """Acceleration [m/s^2] by a stiffness that varies at an order of the drive, or of the body's own motion."""
    turn = plant.tones[0, 1] * t + plant.tones[0, 2] if plant.harmonic else math.sqrt(stiffness) * t
    return -p.parametric * math.cos(p.parametric_order * turn) * x


@njit(cache=True)
def rates(t, y, memory, plant, p, out):
    """Write the rates of the state y = (q, q', and for each body z, u, u', low-passed velocity where laws have them).

    memory : (n,) where the sliders of the backlash were at the start of the step  [m]
    """
    n = plant.load.size
    u = drive(t, plant, p)
    across = 0.0
    if p.squeeze != 0.0:
        r, rate = clearance(y, plant)
        across = -p.squeeze * rate * (plant.rest / max(r, FLOOR * plant.rest)) ** 3
    if p.coupling != 0.0:
        across -= p.coupling * (clearance(y, plant)[0] - plant.gap) ** 3
    for i in range(n):
        x, v = y[i], y[n + i]
        a = plant.load[i] * u + plant.port[i] * across
        for j in range(n):
            a -= plant.stiffness[i, j] * y[j] + plant.damping[i, j] * y[n + j]
        if plant.body[i]:
            a += on_body(t, x, v, memory[i], p)
            if p.parametric != 0.0:
                a += modulated(t, x, plant.stiffness[i, i], plant, p)
        if plant.support[i]:
            a -= p.support_stiffness * x + p.support_damping * v
        if y.size > 2 * n:
            s = 2 * n + 4 * i
            for k in range(4):
                out[s + k] = 0.0
            if p.lowpass != 0.0:
                out[s + 3] = (v - y[s + 3]) / p.lowpass
            if plant.body[i] and p.dahl_force != 0.0:
                a -= p.dahl_force * y[s]
                out[s] = (v - abs(v) * y[s]) / p.dahl_distance
            if plant.body[i] and p.hysteresis_force != 0.0:  # Bouc's three terms, of which A = 1
                a -= p.hysteresis_force * y[s]
                even, odd = abs(y[s]) ** p.hysteresis_exponent, abs(y[s]) ** (p.hysteresis_exponent - 1.0) * y[s]
                turned = p.hysteresis_shape * abs(v) * odd + (1.0 - p.hysteresis_shape) * v * even
                out[s] = (v - turned) / p.hysteresis_distance
            if (
                plant.body[i] and p.stribeck_force != 0.0
            ):  # LuGre, whose bristles have the stiffness force over distance
                bristle = y[s] * p.stribeck_distance
                level = p.stribeck_force * (1.0 + p.stribeck_rise * math.exp(-((v / p.stribeck_speed) ** 2)))
                bent = p.stribeck_force / p.stribeck_distance * bristle
                a -= bent
                out[s] = (v - bent / level * abs(v)) / p.stribeck_distance
            if plant.body[i] and p.mode_mass != 0.0:
                w = 2.0 * math.pi * p.mode_frequency
                pull = w * w * (y[s + 1] - x) + 2.0 * p.mode_damping * w * (y[s + 2] - v)
                a += p.mode_mass * pull
                out[s + 1], out[s + 2] = y[s + 2], -pull
        out[i], out[n + i] = v, a


@njit(cache=True)
def step(t, y, memory, h, plant, p, k, new):
    """Write the state a step h on; return its error in units of the tolerance. k : (STAGES, y.size) scratch."""
    n = plant.load.size
    for s in range(STAGES):
        for i in range(y.size):
            new[i] = y[i]
            for j in range(s):
                new[i] += h * A[s, j] * k[j, i]
        rates(t + C[s] * h, new, memory, plant, p, k[s])
    fifth, third = 0.0, 0.0
    for i in range(y.size):
        moved, e5, e3 = 0.0, 0.0, 0.0
        for s in range(STAGES):
            moved += B[s] * k[s, i]
            e5 += E5[s] * k[s, i]
            e3 += E3[s] * k[s, i]
        new[i] = y[i] + h * moved
        size = plant.length if i < n else plant.speed
        if i >= 2 * n:
            kind = (i - 2 * n) % 4
            size = 1.0 if kind == 0 else plant.length if kind == 1 else plant.speed
        fifth += (e5 / size) ** 2
        third += (e3 / size) ** 2
    if fifth == 0.0:
        return 0.0
    return h * fifth / math.sqrt((fifth + 0.01 * third) * y.size) / TOLERANCE


@njit(cache=True)
def meeting(t, y, memory, h, plant, p, k, new):
    """Return the time into the step h at which the clearance is zero, where it is negative at its end; `new` is then.

    Newton's iteration on the length of the step, within a bracket.
    """
    low, high, tau = 0.0, h, h
    for _ in range(80):
        step(t, y, memory, tau, plant, p, k, new)
        r, rate = clearance(new, plant)
        if r < 0.0:
            high = tau
        else:
            low = tau
        ahead = tau - r / rate if rate != 0.0 else low
        if not low < ahead < high:
            ahead = 0.5 * (low + high)
        if abs(ahead - tau) <= 1e-16 * (1e-3 + t) or high - low <= 1e-17:
            break
        tau = ahead
    return tau


@njit(cache=True)
def rebound(y, plant, p):
    """Turn the velocities by the law of restitution; return the closing speed and that of leaving [m/s]."""
    n = plant.load.size
    r, rate = clearance(y, plant)
    speed, e = -rate, plant.restitution
    change = 0.0
    if speed > 0.0:
        if p.adhesion != 0.0:
            change += math.sqrt(max(0.0, e * e - p.adhesion / speed**2)) - e
        if p.rate_exponent != 0.0:
            change += e * ((speed / p.rate_speed) ** -p.rate_exponent - 1.0)
    away = min(max(e + change, 0.0), 1.0) * speed
    for i in range(n):
        y[i] += plant.hit[i] * (PUSH - r)
        y[n + i] += plant.hit[i] * (speed + max(away, LIFT))
    return speed, away


@njit(cache=True)
def fly(plant, p, y, memory, begin, end, times, samples, impacts):
    """Integrate from `begin` to `end` [s].

    Parameters
    ----------
    y, memory : state and sliders at the beginning; written: at the end
    times : (m,) increasing, in [begin, end]
    samples : (m, y.size) written: the state at `times`
    impacts : (IMPACTS, 3) written: instant [s], closing speed, speed of leaving  [m/s]

    Returns
    -------
    outcome : DONE, or BROKEN where the motion is not finite or chatters without end
    met : how many impacts there were
    """
    n = plant.load.size
    k, new = np.zeros((STAGES, y.size)), np.zeros(y.size)
    t, h, at, met = begin, (end - begin) / 256.0, 0, 0
    while True:
        target = times[at] if at < times.size else end
        if target - t <= 1e-15 * end:
            if at == times.size:
                return DONE, met
            samples[at] = y
            at += 1
            continue
        tried = min(h, target - t)
        error = step(t, y, memory, tried, plant, p, k, new)
        if not math.isfinite(error):
            return BROKEN, met
        if error > 1.0 and tried > LEAST:
            h = tried * max(0.2, 0.9 * error**-0.125)
            continue
        met_stop = clearance(new, plant)[0] < 0.0
        if met_stop:
            tried = meeting(t, y, memory, tried, plant, p, k, new)
        elif tried == h or error > 0.1:
            h = tried * min(5.0, 0.9 * max(error, 1e-8) ** -0.125)
        y[:] = new
        t = target if tried == target - t else t + tried
        if met_stop:
            speed, away = rebound(y, plant, p)
            if met < IMPACTS:
                impacts[met, 0], impacts[met, 1], impacts[met, 2] = t, speed, away
            met += 1
            if met > MOST:
                return BROKEN, met
        if p.backlash_stiffness != 0.0:
            for i in range(n):
                memory[i] = slider(y[i], memory[i], p)
