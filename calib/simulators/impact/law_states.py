"""Internal states of force laws along a periodic motion, for harmonic balance.

The states z' = g(t, x, v, z) of a law at a place are marched over the period by the trapezoidal rule, which is stable
for any rate, until they repeat; small changes of the motion are carried along by the same rule, differentiated. That is
the time half of the alternating frequency/time method (Cameron & Griffin, J. Appl. Mech. 56 (1989) 149) for forces that
remember.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from calib.modelling.laws import STATES
from calib.modelling.modal_system import InnerStates
from calib.simulators.compilation import COMPILED
from calib.simulators.law_calls import force

STATE_DIFFERENCE = 1e-6  # of the size of a state, for the derivatives by it
MAX_MARCHED_PERIODS = 40  # over which states are marched until they repeat
PLAIN_PERIODS = 2  # of these without Newton's method: friction forgets its start within one
REPEATED = 1e-10  # change over a period over the size of a state
STILL_CHANGING = 1e-6  # the same, above which states have no periodic path after all these periods: slip that adds up
STEP_CORRECTIONS = 12  # of Newton's method in one step
QUICK_CORRECTIONS = 3  # of these with the derivative of an earlier step, before it is taken anew
STEP_CORRECTED = 1e-11  # correction over the size of a state
START_PERTURBATION, MAX_MISSED = 1e-5, 0.2  # of the start, in sizes of the states; of what it does over a period  [1]
NEUTRAL = 1e-9  # singular value of I - M below which a state keeps its start: a slider that does not slide


class LawAtPlace(NamedTuple):
    """A law with states at a place: its number, that of the place, and how many states it has."""

    law: int
    place: int
    states: int


def at_places(law_states: Sequence[tuple[int, int, int]], columns: Sequence[int]) -> list[LawAtPlace]:
    """Laws with states at places.

    Parameters
    ----------
    law_states : (law, coordinate or port, index) of each state, in their order in the state of the period map
    columns : coordinate or port of each place
    """
    found: dict[tuple[int, int], int] = {}
    for law, column, _ in law_states:
        found[law, column] = found.get((law, column), 0) + 1
    return [LawAtPlace(law, columns.index(column), count) for (law, column), count in found.items()]


class StatePath(NamedTuple):
    """States (count, m) of one law at a place along a periodic motion, and derivatives of their rates and of the force.

    rate, by_position, by_rate (count, m) and by_state (count, count, m) of g; force_by_state (count, m)
    """

    value: np.ndarray
    rate: np.ndarray
    by_position: np.ndarray
    by_rate: np.ndarray
    by_state: np.ndarray
    force_by_state: np.ndarray


def state_path(
    law: int, parameters: np.ndarray, count: int, times: np.ndarray, position: np.ndarray, rate: np.ndarray,
    steps: tuple[float, float],
) -> StatePath:  # fmt: skip
    """Path of the states of a law that repeat over a period.

    NaN where the states do not repeat, and where the steps do not resolve how a state comes to slide: then a start
    beside it is not carried over the period as the derivatives have it.

    Parameters
    ----------
    law : its address, with its parameters
    times, position, rate : (m,) instants, evenly over one period, and motion at the place
    steps : differences of position [m] and rate [m/s]
    """
    m = times.size
    step = float(times[1] - times[0])
    size = _sizes(law, parameters, count, times, position, rate, step * m)
    value, rates, by_position, by_rate, force_by_state = np.zeros((5, count, m))
    path = StatePath(value, rates, by_position, by_rate, np.zeros((count, count, m)), force_by_state)
    start = np.zeros(count)
    for period in range(MAX_MARCHED_PERIODS):
        begun = start
        end = _marched(law, parameters, times, position, rate, step, begun, size, path.value)
        change = end - begun
        if (np.abs(change) <= REPEATED * size).all():
            break
        if period < PLAIN_PERIODS:
            start = end
            continue
        _differentiate_by_state(law, parameters, times, position, rate, size, path.value, path.by_state, force_by_state)
        start = begun + np.linalg.pinv(np.eye(count) - _once(path.by_state, step), rcond=NEUTRAL) @ change
    _differentiate_by_state(law, parameters, times, position, rate, size, path.value, path.by_state, force_by_state)
    _differentiate_by_motion(law, parameters, times, position, rate, steps, value, rates, by_position, by_rate)
    moved, beside = START_PERTURBATION * size, np.empty((count, m))
    end_beside = _marched(law, parameters, times, position, rate, step, begun + moved, size, beside)
    missed = np.abs(end_beside - end - _once(path.by_state, step) @ moved) > MAX_MISSED * moved.max()
    if missed.any() or (np.abs(change) > STILL_CHANGING * size).any():
        path.value[:] = np.nan
    return path


def inner_states(laws: Sequence[LawAtPlace], paths: Sequence[StatePath], step: float) -> InnerStates:
    """Put the states of all laws together; `step` between instants  [s]."""
    sizes = [law.states for law in laws]
    place = np.repeat([law.place for law in laws], sizes)
    by_state = np.zeros((len(place), len(place), paths[0].value.shape[1]))
    first = 0
    for size, path in zip(sizes, paths, strict=True):
        by_state[first : first + size, first : first + size] = path.by_state
        first += size

    def changed(position: np.ndarray, rate: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        forces = np.zeros_like(position)
        for law, path in zip(laws, paths, strict=True):
            load = path.by_position[:, :, None] * position[law.place] + path.by_rate[:, :, None] * rate[law.place]
            load += path.rate[:, :, None] * stretch
            forces[law.place] += np.einsum("sm,smk->mk", path.force_by_state, _carried(path.by_state, step, load))
        return forces

    return InnerStates(
        place,
        np.concatenate([path.value for path in paths]),
        np.concatenate([path.force_by_state for path in paths]),
        np.concatenate([path.by_position for path in paths]),
        np.concatenate([path.by_rate for path in paths]),
        by_state,
        changed,
    )


@njit(**COMPILED)
def _sizes(
    law: int, p: np.ndarray, count: int, times: np.ndarray, x: np.ndarray, v: np.ndarray, period: float
) -> np.ndarray:
    """Sizes (count,) of states: their largest change over a radian from zero; 1 where they do not change."""
    z, dz, size = np.zeros(STATES), np.zeros(STATES), np.zeros(count)
    for j in range(times.size):
        dz[:] = 0.0
        force(law, times[j], x[j], v[j], p, z, dz)
        size = np.maximum(size, np.abs(dz[:count]) * period / (2.0 * np.pi))
    return np.where(size > 0.0, size, 1.0)


@njit(**COMPILED)
def _rates_by_state(
    law: int, p: np.ndarray, t: float, x: float, v: float, size: np.ndarray, z: np.ndarray, dz: np.ndarray,
    slope: np.ndarray, of_force: np.ndarray,
) -> None:  # fmt: skip
    """Derivatives of the rates (count, count) and of the force (count,) by the states z, which are left as they are."""
    count = size.size
    for k in range(count):
        own, h = z[k], STATE_DIFFERENCE * size[k]
        z[k] = own + h
        ahead = force(law, t, x, v, p, z, dz)
        slope[:, k] = dz[:count]
        z[k] = own - h
        of_force[k] = (ahead - force(law, t, x, v, p, z, dz)) / (2.0 * h)
        slope[:, k] = (slope[:, k] - dz[:count]) / (2.0 * h)
        z[k] = own


@njit(**COMPILED)
def _marched(
    law: int, p: np.ndarray, times: np.ndarray, x: np.ndarray, v: np.ndarray, step: float, start: np.ndarray,
    size: np.ndarray, path: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """March the states over one period from `start` (count,), write their path (count, m), and return their end."""
    count, m, half = size.size, times.size, 0.5 * step
    z, dz = np.zeros(STATES), np.zeros(STATES)
    slope, of_force, known, inverse = np.zeros((count, count)), np.zeros(count), np.zeros(count), np.eye(count)
    z[:count] = start
    force(law, times[0], x[0], v[0], p, z, dz)
    for j in range(m):
        k = (j + 1) % m
        for i in range(count):
            path[i, j] = z[i]
            known[i] = z[i] + half * dz[i]
        for number in range(STEP_CORRECTIONS):
            if number == QUICK_CORRECTIONS or (j == 0 and number == 0):
                _rates_by_state(law, p, times[k], x[k], v[k], size, z, dz, slope, of_force)
                _invert(slope, half, inverse)
            force(law, times[k], x[k], v[k], p, z, dz)
            largest = 0.0
            for i in range(count):
                of_force[i] = known[i] + half * dz[i] - z[i]
            for i in range(count):
                correction = 0.0
                for s in range(count):
                    correction += inverse[i, s] * of_force[s]
                z[i] += correction
                largest = max(largest, abs(correction) / size[i])
            if largest <= STEP_CORRECTED:
                for i in range(count):  # the rule itself tells the rates there
                    dz[i] = (z[i] - known[i]) / half
                break
        else:
            force(law, times[k], x[k], v[k], p, z, dz)
    return z[:count].copy()


@njit(**COMPILED)
def _differentiate_by_state(
    law: int, p: np.ndarray, times: np.ndarray, x: np.ndarray, v: np.ndarray, size: np.ndarray, path: np.ndarray,
    by_state: np.ndarray, force_by_state: np.ndarray,
) -> None:  # fmt: skip
    """Write the derivatives of the rates of the states and of the force by the states, along their path."""
    count = size.size
    z, dz = np.zeros(STATES), np.zeros(STATES)
    slope, of_force = np.zeros((count, count)), np.zeros(count)
    for j in range(times.size):
        z[:count] = path[:, j]
        _rates_by_state(law, p, times[j], x[j], v[j], size, z, dz, slope, of_force)
        by_state[:, :, j] = slope
        force_by_state[:, j] = of_force


@njit(**COMPILED)
def _differentiate_by_motion(
    law: int, p: np.ndarray, times: np.ndarray, x: np.ndarray, v: np.ndarray, steps: tuple[float, float],
    path: np.ndarray, rate: np.ndarray, by_position: np.ndarray, by_rate: np.ndarray,
) -> None:  # fmt: skip
    """Write the rates of the states along their path, and their derivatives by position and rate of the place."""
    count = path.shape[0]
    z, dz = np.zeros(STATES), np.zeros(STATES)
    for j in range(times.size):
        t = times[j]
        z[:count] = path[:, j]
        force(law, t, x[j], v[j], p, z, dz)
        rate[:, j] = dz[:count]
        force(law, t, x[j] + steps[0], v[j], p, z, dz)
        by_position[:, j] = dz[:count]
        force(law, t, x[j] - steps[0], v[j], p, z, dz)
        by_position[:, j] = (by_position[:, j] - dz[:count]) / (2.0 * steps[0])
        force(law, t, x[j], v[j] + steps[1], p, z, dz)
        by_rate[:, j] = dz[:count]
        force(law, t, x[j], v[j] - steps[1], p, z, dz)
        by_rate[:, j] = (by_rate[:, j] - dz[:count]) / (2.0 * steps[1])


@njit(**COMPILED)
def _invert(slope: np.ndarray, step: float, inverse: np.ndarray) -> None:
    """Write the inverse of I - step slope (count, count), by Gauss and Jordan: for so few states LAPACK is slower.

    Without pivoting: rates of states hardly depend on other states, so that the diagonal dominates.
    """
    count = slope.shape[0]
    for i in range(count):
        for k in range(count):
            inverse[i, k] = (1.0 if i == k else 0.0) - step * slope[i, k]
    for i in range(count):
        pivot = 1.0 / inverse[i, i]
        inverse[i, i] = 1.0
        for k in range(count):
            inverse[i, k] *= pivot
        for j in range(count):
            if j != i:
                factor = inverse[j, i]
                inverse[j, i] = 0.0
                for k in range(count):
                    inverse[j, k] -= factor * inverse[i, k]


@njit(**COMPILED)
def _advanced(
    by_state: np.ndarray,
    step: float,
    j: int,
    inverse: np.ndarray,
    load: np.ndarray,
    now: np.ndarray,
    explicit: np.ndarray,
) -> None:
    """Take changes `now` (count, k) of the states from instant j to j + 1 under loads (count, m, k)."""
    count, m, columns = load.shape
    k, half = (j + 1) % m, 0.5 * step
    _invert(by_state[:, :, k], half, inverse)
    for c in range(columns):
        for i in range(count):
            explicit[i] = now[i, c] + half * (load[i, j, c] + load[i, k, c])
            for s in range(count):
                explicit[i] += half * by_state[i, s, j] * now[s, c]
        for i in range(count):
            total = 0.0
            for s in range(count):
                total += inverse[i, s] * explicit[s]
            now[i, c] = total


@njit(**COMPILED)
def _forced(by_state: np.ndarray, step: float, load: np.ndarray, start: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Carry changes (count, k) of the states over a period; write their path (count, m, k), and return their end."""
    count, m, _ = load.shape
    now, inverse, explicit = start.copy(), np.eye(count), np.zeros(count)
    for j in range(m):
        path[:, j] = now
        _advanced(by_state, step, j, inverse, load, now, explicit)
    return now


def _once(by_state: np.ndarray, step: float) -> np.ndarray:
    """Change (count, count) of the states over one period with those at its start."""
    count, _, m = by_state.shape
    return _forced(by_state, step, np.zeros((count, m, count)), np.eye(count), np.empty((count, m, count)))


def _carried(by_state: np.ndarray, step: float, load: np.ndarray) -> np.ndarray:
    """Periodic change (count, m, k) of the states under k loads (count, m, k) on their rates."""
    count, _, columns = load.shape
    path = np.empty(load.shape)
    end = _forced(by_state, step, load, np.zeros((count, columns)), path)
    start = np.linalg.lstsq(np.eye(count) - _once(by_state, step), end, NEUTRAL)[0]
    _forced(by_state, step, load, start, path)
    return path
