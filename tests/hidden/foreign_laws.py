"""Force laws of many kinds hidden in records that scipy's DOP853 integrates, and the study that seeks them.

A law is -A g(x / L, v / V), its force per unit mass, with shapes g of the order of one: the integration and the model
that is told the law share the function, and nothing else.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden import four_dof, oscillator
from hidden.flight import Laws, Plant
from hidden.hider import study
from hidden.information import Bench
from hidden.motion import Refused
from hidden.motion import repeating as without_law
from hidden.system import Plan, System
from numba import njit
from scipy.integrate import DOP853
from scipy.optimize import brentq

from calib.modelling.effect import Effect
from calib.modelling.laws import SIGNATURES, Law
from calib.modelling.parameter import Parameter
from calib.records import make, write

RTOL, ATOL = 1e-9, 1e-11  # of an integration, the second relative to the sizes of the motion
STEPS_PER_PERIOD = 24  # at least  [count]
SETTLED_PERIODS, NEWTON_STEPS = 40, 8  # before Newton's method on the section; of it  [count]
CLOSED = 1e-7  # change over a period of a motion that repeats, relative to its sizes
DIFFERENCE = 1e-5  # of the derivatives of the section, in sizes of the motion
PUSH = 1e-15  # m, by which a body is taken off the stop after an impact
X, V, XV = ("displacement",), ("velocity",), ("displacement", "velocity")
SIZES = (0.003, 0.01, 0.03)  # of a law, over Omega^2 L: the damping force of the oscillator is 0.04  [1]


class Kind(NamedTuple):
    """A shape of a force law: g(x / L, v / V), and the arguments that it has."""

    shape: Callable[[float, float], float]
    arguments: tuple[str, ...]
    equation: str


KINDS = {
    "square": Kind(lambda x, v: x * x, X, "x^2"),
    "cubic": Kind(lambda x, v: x * x * x, X, "x^3"),
    "quintic": Kind(lambda x, v: x**5, X, "x^5"),
    "odd_square": Kind(lambda x, v: x * abs(x), X, "x |x|"),
    "magnet": Kind(lambda x, v: 1.65 * (x - 0.5) / 0.2 * math.exp(-0.5 * ((x - 0.5) / 0.2) ** 2), X, "u exp(-u^2 / 2)"),
    "exponential": Kind(lambda x, v: math.exp(-(x + 1.0) / 0.4), X, "exp(-x / l)"),
    "cogging": Kind(lambda x, v: math.sin(2.0 * math.pi * x / 0.8), X, "sin(2 pi x / p)"),
    "bilinear": Kind(lambda x, v: max(0.0, x), X, "max(0, x)"),
    "softening": Kind(lambda x, v: -x / (1.0 + abs(x) / 0.5), X, "-x / (1 + |x| / l)"),
    "second_stop": Kind(lambda x, v: -2.0 * max(0.0, -x - 0.4) ** 1.5, X, "-max(0, -x - a)^1.5"),
    "dead_zone": Kind(lambda x, v: max(0.0, x - 0.3) - max(0.0, -x - 0.3), X, "x outside |x| < a"),
    "attraction": Kind(lambda x, v: -0.3 / (1.6 - x) ** 2, X, "-1 / (d - x)^2"),
    "step_spring": Kind(lambda x, v: math.tanh(x / 0.1), X, "tanh(x / l)"),
    "drag": Kind(lambda x, v: v * abs(v), V, "v |v|"),
    "cubic_damping": Kind(lambda x, v: v * v * v, V, "v^3"),
    "power_damping": Kind(lambda x, v: math.copysign(abs(v) ** 1.5, v), V, "|v|^1.5 sgn v"),
    "friction": Kind(lambda x, v: math.tanh(v / 0.1), V, "tanh(v / v0)"),
    "coulomb": Kind(lambda x, v: math.tanh(v / 0.01), V, "sgn v"),
    "stribeck": Kind(lambda x, v: math.tanh(v / 0.02) * (0.6 + 0.6 * math.exp(-((v / 0.2) ** 2))), V, "Stribeck"),
    "asymmetric_damper": Kind(lambda x, v: max(0.0, v), V, "max(0, v)"),
    "one_way_drag": Kind(lambda x, v: max(0.0, v) ** 2, V, "max(0, v)^2"),
    "drag_by_place": Kind(lambda x, v: x * v * v, XV, "x v^2"),
    "van_der_pol": Kind(lambda x, v: x * x * v, XV, "x^2 v"),
    "valve": Kind(lambda x, v: max(0.0, x) * max(0.0, v), XV, "max(0, x) max(0, v)"),
    "cubic_and_drag": Kind(lambda x, v: 0.6 * x * x * x + 0.6 * v * abs(v), XV, "x^3 + v |v|"),
}


def _law(name: str) -> Law:
    """Compile -p0 g(x / p1, v / p2) with the signature of a force law."""
    shape = njit(KINDS[name].shape)

    def function(t, x, v, p, z, dz):
        return -p[0] * shape(x / p[1], v / p[2])

    return Law("force", njit(SIGNATURES["force"], nogil=True)(function), __name__, name)


@dataclass(frozen=True)
class Hidden:
    """A law that is hidden.

    Attributes
    ----------
    kind : one of `KINDS`; "" hides none
    size : over Omega^2 L  [1]
    body : of the plant, on which it acts
    length, speed : L [m] and V [m/s]
    scale : Omega^2 L  [m/s^2]
    """

    kind: str
    size: float
    body: str
    length: float
    speed: float
    scale: float

    @property
    def level(self) -> float:
        """A  [m/s^2]."""
        return self.size * self.scale

    def __call__(self, x: float, v: float) -> float:
        """Force per unit mass  [m/s^2]."""
        return -self.level * KINDS[self.kind].shape(x / self.length, v / self.speed) if self.kind else 0.0

    def at(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Force per unit mass (n,) at states (n,)  [m/s^2]."""
        return np.array([self(*state) for state in zip(x.tolist(), v.tolist(), strict=True)])

    @property
    def effect(self) -> Effect:
        """The law as an effect, absent where its level is zero."""
        level = Parameter("hidden_level", "m/s^2", 0.0, "level of the law", null=0.0)
        held = (Parameter("hidden_length", "m", self.length, "L"), Parameter("hidden_speed", "m/s", self.speed, "V"))
        return Effect(name="hidden", site="force", law=_law(self.kind), parameters=(level, *held),
                      meaning="the law that is hidden", equation=KINDS[self.kind].equation,
                      bodies=(self.body,), cite="the truth")  # fmt: skip


# --- systems ---------------------------------------------------------------------------------------------------------


def _oscillator_plant(values, plan: Plan) -> Plant:
    """The oscillator; another multisine has other phases."""
    plant = oscillator.plant(values, plan)
    if plan.name != "unseen":
        return plant
    tones = plant.tones.copy()
    tones[:, 2] = tones[::-1, 2] + 1.0
    return plant._replace(tones=tones)


def system(name: str, stop: bool = False) -> System:
    """Return the plant that records are made of: two tones, a multisine, a decay, and a multisine held out."""
    if name == "four_dof":
        return four_dof.system()
    base = oscillator.system(stop=stop)
    tones = [plan for plan in base.plans if plan.use == "calibrate"]
    size = next(plan.amplitude for plan in base.plans if plan.kind == "multisine")
    own = Plan("multisine", "name", "multisine", size), Plan("unseen", "holdout", "multisine", size)
    decay = Plan("decay", "name", "decay", -9e-3 if stop else 9e-3)
    return replace(base, plans=(*tones, own[0], decay, own[1]), plant=_oscillator_plant,
                   fixed={**base.fixed, "initial_displacement@decay": decay.amplitude})  # fmt: skip


def hidden(name: str, kind: str, size: float, stop: bool = False) -> Hidden:
    """Return a law of a size in a system, on the scales of its motion; with the stop it is smaller."""
    length, omega, body = {"oscillator": (10e-3, 62.8, "mass"), "four_dof": (1e-3, 165.0, "q3")}[name]
    length *= 0.6 if stop else 1.0
    return Hidden(kind, size, body, length, omega * length, omega**2 * length)


# --- motion ----------------------------------------------------------------------------------------------------------


class Flight(NamedTuple):
    """States (n, 2 d) at the instants, and the instants of impacts."""

    states: np.ndarray
    impacts: list[float]


def flown(plant: Plant, law: Callable[[float, float], float], row: int, state: np.ndarray, times: np.ndarray) -> Flight:
    """Integrate from the state (2 d,) at the first of the times (n,) with scipy's DOP853, impacts located by brentq."""
    n = plant.load.size
    tones, load = plant.tones, plant.load
    size = np.concatenate([np.full(n, plant.length), np.full(n, plant.speed)])

    def rate(t, y):
        x, v = y[:n], y[n:]
        a = load * float(tones[:, 0] @ np.cos(tones[:, 1] * t + tones[:, 2])) - plant.stiffness @ x - plant.damping @ v
        a[row] += law(float(x[row]), float(v[row]))
        return np.concatenate([v, a])

    def clearance(y):
        return plant.gap + plant.normal @ y[:n]

    longest = 1.0 / STEPS_PER_PERIOD / (max(tones[:, 1].max(), 60.0) / (2.0 * np.pi))
    t, end, y = float(times[0]), float(times[-1]), np.array(state, dtype=float)
    out, at, impacts, taken = np.zeros((times.size, y.size)), 0, [], None
    while at < times.size and times[at] <= t:
        out[at], at = y, at + 1
    while t < end:
        first = {} if taken is None else {"first_step": min(taken, end - t)}
        solver = DOP853(rate, t, y, end, rtol=RTOL, atol=ATOL * size, max_step=longest, **first)
        hit = None
        while solver.status == "running" and hit is None:
            solver.step()
            if solver.status == "failed":
                raise Refused("the integration fails")
            taken = solver.step_size
            dense = solver.dense_output()
            reached = solver.t
            if clearance(solver.y) < 0.0:
                hit = reached = float(brentq(lambda s, dense=dense: clearance(dense(s)), solver.t_old, solver.t))
            while at < times.size and times[at] <= reached:
                out[at], at = dense(times[at]), at + 1
        t, y = (end, solver.y) if hit is None else (hit, dense(hit))
        if hit is not None:
            speed = -float(plant.normal @ y[n:])
            y[:n] += plant.hit * (PUSH - clearance(y))
            y[n:] += plant.hit * max((1.0 + plant.restitution) * speed, speed + 1e-3)
            impacts.append(hit)
            if len(impacts) > 2000:
                raise Refused("the motion chatters")
    return Flight(out, impacts)


def repeating(plant: Plant, law: Callable[[float, float], float], row: int, period: float) -> np.ndarray:
    """State (2 d,) at time zero of the motion that repeats after one period: settled, then Newton's method.

    Several bodies with a stop begin in their motion without the law: from rest they chatter.

    Raises
    ------
    Refused : it is not found
    """
    n = plant.load.size
    size = np.concatenate([np.full(n, plant.length), np.full(n, plant.speed)])
    linear = n == 1 and not np.isfinite(plant.gap)
    of_several = n > 1 and np.isfinite(plant.gap)
    y = without_law(plant, Laws(), period).state if of_several else np.zeros(2 * n)

    def after(state, count=1):
        return flown(plant, law, row, state, np.array([0.0, count * period])).states[-1]

    y = after(y, SETTLED_PERIODS // 2 if linear else SETTLED_PERIODS)
    for _ in range(NEWTON_STEPS):
        end = after(y)
        if np.abs((end - y) / size).max() < CLOSED:
            return y
        columns = [(after(y + DIFFERENCE * s * np.eye(2 * n)[i]) - end) / (DIFFERENCE * s) for i, s in enumerate(size)]
        scaled = np.column_stack(columns) * size / size[:, None]
        move = np.linalg.lstsq(np.eye(2 * n) - scaled, (end - y) / size, rcond=1e-10)[0]
        y = y + size * move if np.abs(move).max() < 1.0 else after(y, 10)
    if np.abs((after(y) - y) / size).max() < 100.0 * CLOSED:
        return y
    raise Refused("the motion that repeats is not found")


def motion(at: System, plan: Plan, law: Hidden) -> Flight:
    """States of a record without noise."""
    plant, times = at.plant(at.truth, plan), at.times(plan)
    row = at.measured[law.body]
    if plan.kind != "harmonic":
        state = np.zeros(2 * plant.load.size)
        state[0] = plan.amplitude if plan.kind == "decay" else 0.0
        return flown(plant, law, row, state, times)
    state = repeating(plant, law, row, 1.0 / plan.frequency)
    one = flown(plant, law, row, state, times[: at.samples + 1])
    whole = np.tile(one.states[:-1], (at.periods, 1))
    return Flight(whole, [t + k / plan.frequency for k in range(at.periods) for t in one.impacts])


class Written(NamedTuple):
    """A study in a folder, with what its seeker must not see: states, true rows (2 b, n) and noise of its records."""

    folder: Path
    bodies: tuple[str, ...]
    flights: dict[str, Flight]
    rows: dict[str, np.ndarray]
    sigma: dict[str, np.ndarray]


def written(at: System, law: Hidden, noise: float, seed: int, folder: Path) -> Written:
    """Write the records with noise, relative to the rms of each channel, and the study that calibrates without the law.

    Raises
    ------
    Refused : there is no motion that a record can be made of
    """
    folder.mkdir(parents=True, exist_ok=True)
    index = list(at.measured.values())
    flights, clean, sigmas = {}, {}, {}
    for k, plan in enumerate(at.plans):
        flight = motion(at, plan, law)
        n = flight.states.shape[1] // 2
        rows = np.concatenate([flight.states[:, index].T, flight.states[:, [n + i for i in index]].T])
        sigma = noise * np.sqrt((rows**2).mean(axis=1, keepdims=True))
        noisy = rows + sigma * np.random.default_rng([seed, k]).standard_normal(rows.shape)
        flights[plan.name], clean[plan.name], sigmas[plan.name] = flight, rows, sigma
        write(_record(at, plan, noisy), folder / f"{plan.name}.nc")
    (folder / "study.toml").write_text(study(Bench(at, folder / "cache")))
    return Written(folder, tuple(at.measured), flights, clean, sigmas)


def _record(at: System, plan: Plan, rows: np.ndarray):
    displacement, velocity = np.split(rows, 2)
    attrs = {"place": at.place, "quantity": at.quantity, "source": "measured"}
    if plan.kind == "harmonic":
        attrs |= {"frequency": plan.frequency, "amplitude": plan.amplitude, "phase": 0.0}
    elif plan.kind == "decay":
        attrs["quantity"] = "free decay"
    channels = {"displacement": displacement, "velocity": velocity}
    record = make(at.times(plan), list(at.measured), channels, **attrs)
    if plan.kind != "multisine":
        return record
    return record.assign(excitation=("time", load(at, plan), {"units": "N"}))


def load(at: System, plan: Plan) -> np.ndarray:
    """Excitation of a record (n,) at the nominal amplitude  [its unit]."""
    tones = at.plant({**at.truth, "amplitude": 1.0}, plan).tones
    return (tones[:, :1] * np.cos(tones[:, 1:2] * at.times(plan) + tones[:, 2:])).sum(axis=0)
