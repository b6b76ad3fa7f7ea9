"""Motions that can be looked at whenever one likes: the one that repeats every period, and the one that starts."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from hidden.flight import DONE, IMPACTS, LIFT, Laws, Plant, fly

CLOSED = 1e-11  # change over a period of a motion that repeats, relative to its sizes
SETTLE, NEAR = 40, 2  # periods between two of Newton's steps, from rest and from a motion that is nearly it
LOOSE = 1e-8  # the same where that is not reached: a law with a corner is not integrated better
TRIES, PATIENCE = 10, 5
LEAP = 1.0  # in sizes of the motion; Newton's step is not trusted with a longer one
STEP = 1e-7  # of derivatives, in sizes of the motion

Seen = tuple[np.ndarray, np.ndarray]  # displacement and velocity, (body, time) each
Look = Callable[[np.ndarray], Seen]


class Refused(Exception):
    """The motion is none that a record can be made of."""


class Motion(NamedTuple):
    """A motion with what it met.

    Attributes
    ----------
    look : times (m,) [s] -> displacement and velocity, (n, m) each
    impacts : (k,) instants, in the first period where it repeats  [s]
    state, memory : at time zero
    """

    look: Look
    impacts: np.ndarray
    state: np.ndarray
    memory: np.ndarray


def at_rest(plant: Plant, laws: Laws) -> tuple[np.ndarray, np.ndarray]:
    """State and sliders at rest."""
    n = plant.load.size
    return np.zeros(6 * n if laws.stateful else 2 * n), np.zeros(n)


def _sizes(plant: Plant, dim: int) -> np.ndarray:
    n = plant.load.size
    own = np.tile([1.0, plant.length, plant.speed, plant.speed], n)
    return np.concatenate([np.full(n, plant.length), np.full(n, plant.speed), own])[:dim]


def _flown(plant, laws, y, memory, end, times=None):
    """State and sliders at the end, samples and impacts of a flight from time zero."""
    times = np.zeros(0) if times is None else times
    y, memory = y.copy(), memory.copy()
    samples, impacts = np.zeros((times.size, y.size)), np.zeros((IMPACTS, 3))
    outcome, met = fly(plant, laws, y, memory, 0.0, end, times, samples, impacts)
    if outcome != DONE:
        raise Refused("the motion chatters without end or is not finite")
    return y, memory, samples, impacts[:met]


def _rows(samples: np.ndarray, plant: Plant, laws: Laws) -> Seen:
    n = plant.load.size
    velocity = samples[:, 2 * n + 3 :: 4] if laws.lowpass != 0.0 else samples[:, n : 2 * n]
    return samples[:, :n].T, velocity.T


def _checked(impacts: np.ndarray) -> np.ndarray:
    """Instants of impacts that are all impacts, and no chatter."""
    if len(impacts) == IMPACTS or (impacts[:, 2] < LIFT).any():
        raise Refused("the motion chatters, or stays in contact")
    return impacts[:, 0]


def repeating(plant: Plant, laws: Laws, period: float, state: np.ndarray | None = None) -> Motion:
    """Motion that repeats after one period [s]: settled, then Newton's method on the section at time zero.

    Parameters
    ----------
    state : (q, q') to start from; rest where it is None

    Raises
    ------
    Refused : there is none, or it is unstable
    """
    y, memory = at_rest(plant, laws)
    if state is not None:
        y[: state.size] = state[: y.size]
    sizes = _sizes(plant, y.size)
    settle, radius = SETTLE if state is None else NEAR, 0.0
    for attempt in range(TRIES):
        closed = CLOSED if attempt < PATIENCE else LOOSE
        for _ in range(settle):
            y, memory = _flown(plant, laws, y, memory, period)[:2]
        after, kept, _, impacts = _flown(plant, laws, y, memory, period)
        if np.abs((after - y) / sizes).max() < closed and np.abs(kept - memory).max() < closed * plant.length:
            if radius > 1.0:
                raise Refused("the motion that repeats is unstable")
            return Motion(_periodic(plant, laws, y, memory, period), _checked(impacts), y, memory)
        jacobian = _jacobian(plant, laws, y, memory, period, sizes, after)
        radius = np.abs(np.linalg.eigvals(jacobian)).max()
        move = np.linalg.lstsq(np.eye(y.size) - jacobian, (after - y) / sizes, rcond=1e-10)[0]
        near = np.abs(move[: 2 * plant.load.size]).max() < LEAP
        y = y + sizes * move if near else after
        settle = NEAR if near else SETTLE
    raise Refused("the motion does not repeat after one period")


def _jacobian(plant, laws, y, memory, period, sizes, after):
    """Derivative of the state after a period by the state, both in their sizes."""
    jacobian = np.empty((y.size, y.size))
    for i, size in enumerate(sizes):
        moved = y.copy()
        moved[i] += STEP * size
        jacobian[:, i] = (_flown(plant, laws, moved, memory, period)[0] - after) / (STEP * sizes)
    return jacobian


def _periodic(plant, laws, y, memory, period) -> Look:
    def look(times):
        places, back = np.unique(np.mod(times, period), return_inverse=True)
        samples = _flown(plant, laws, y, memory, period, places)[2]
        return _rows(samples[back], plant, laws)

    return look


def starting(plant: Plant, laws: Laws, end: float, state: np.ndarray) -> Motion:
    """Motion from (q, q') at time zero on; before that, it is held as it begins."""
    y, memory = at_rest(plant, laws)
    y[: state.size] = state
    impacts = _flown(plant, laws, y, memory, end)[3]

    def look(times):
        places, back = np.unique(np.clip(times, 0.0, None), return_inverse=True)
        samples = _flown(plant, laws, y, memory, places[-1], places)[2]
        return _rows(samples[back], plant, laws)

    return Motion(look, _checked(impacts), y, memory)
