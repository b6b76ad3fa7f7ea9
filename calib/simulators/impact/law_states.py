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
MAX_CHANGE_REDUCTION = 0.1  # of the change over a period by a step, above which the derivative is taken anew  [1]
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
    """States (m, count) of one law at a place along a periodic motion, and derivatives of their rates and of the force.

    rate, by_position, by_rate (m, count) and by_state (m, count, count) of g; force_by_state (m, count)
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
    m, step = times.size, float(times[1] - times[0])
    value, size, begun, end = _repeated(law, parameters, count, times, position, rate)
    rates, by_position, by_rate, force_by_state = np.zeros((4, m, count))
    path = StatePath(value, rates, by_position, by_rate, np.zeros((m, count, count)), force_by_state)
    _differentiate_by_state(law, parameters, times, position, rate, size, value, path.by_state, force_by_state)
    _differentiate_by_motion(law, parameters, times, position, rate, steps, value, rates, by_position, by_rate)
    moved, beside = START_PERTURBATION * size, np.empty((m, count))
    end_beside = _marched(law, parameters, times, position, rate, step, begun + moved, size, beside)
    carried = _forced(path.by_state, step, np.zeros((m, count, 0)), moved[:, None], np.empty((m, count, 1)))[:, 0]
    missed = np.abs(end_beside - end - carried) > MAX_MISSED * moved.max()
    if missed.any():
        value[:] = np.nan
    return path


def periodic_states(
    law: int, parameters: np.ndarray, count: int, times: np.ndarray, position: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """States (m, count) as `state_path`, whether the steps resolve them or not; NaN where they do not repeat."""
    return _repeated(law, parameters, count, times, position, rate).value


class _Repeated(NamedTuple):
    """States that repeat over a period: path (m, count), NaN where they do not, their size, start and end (count,)."""

    value: np.ndarray
    size: np.ndarray
    begun: np.ndarray
    end: np.ndarray


def _repeated(
    law: int, parameters: np.ndarray, count: int, times: np.ndarray, position: np.ndarray, rate: np.ndarray
) -> _Repeated:
    """March the states from zero until they repeat: friction forgets its start, other states by Newton's method.

    With the derivative of an earlier period as long as that serves.
    """
    m, step = times.size, float(times[1] - times[0])
    size = _sizes(law, parameters, count, times, position, rate, step * m)
    value, by_state, force_by_state = np.empty((m, count)), np.empty((m, count, count)), np.empty((m, count))
    start, inverse, largest = np.zeros(count), np.zeros((0, 0)), np.inf
    for period in range(MAX_MARCHED_PERIODS):
        begun = start
        end = _marched(law, parameters, times, position, rate, step, begun, size, value)
        change = end - begun
        before, largest = largest, float((np.abs(change) / size).max())
        if largest <= REPEATED:
            break
        if period < PLAIN_PERIODS:
            start = end
            continue
        if not inverse.size or not largest <= MAX_CHANGE_REDUCTION * before:
            _differentiate_by_state(law, parameters, times, position, rate, size, value, by_state, force_by_state)
            inverse = np.linalg.pinv(np.eye(count) - _once(by_state, step), rcond=NEUTRAL)
        start = begun + inverse @ change
    if not largest <= STILL_CHANGING:
        value[:] = np.nan
    return _Repeated(value, size, begun, end)


def inner_states(laws: Sequence[LawAtPlace], paths: Sequence[StatePath], step: float) -> InnerStates:
    """Put the states of all laws together; `step` between instants  [s]."""
    sizes = [law.states for law in laws]
    place = np.repeat([law.place for law in laws], sizes)
    by_state = np.zeros((len(place), len(place), len(paths[0].value)))
    first = 0
    for size, path in zip(sizes, paths, strict=True):
        by_state[first : first + size, first : first + size] = np.moveaxis(path.by_state, 0, 2)
        first += size

    def changed(position: np.ndarray, rate: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        forces = np.zeros_like(position)
        for law, path in zip(laws, paths, strict=True):
            load = path.by_position[:, :, None] * position[law.place][:, None]
            load += path.by_rate[:, :, None] * rate[law.place][:, None]
            load += path.rate[:, :, None] * stretch
            forces[law.place] += np.einsum("ms,msk->mk", path.force_by_state, _carried(path.by_state, step, load))
        return forces

    return InnerStates(
        place,
        np.concatenate([path.value.T for path in paths]),
        np.concatenate([path.force_by_state.T for path in paths]),
        np.concatenate([path.by_position.T for path in paths]),
        np.concatenate([path.by_rate.T for path in paths]),
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
        for i in range(count):
            size[i] = max(size[i], abs(dz[i]) * period / (2.0 * np.pi))
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
        for i in range(count):
            slope[i, k] = dz[i]
        z[k] = own - h
        of_force[k] = (ahead - force(law, t, x, v, p, z, dz)) / (2.0 * h)
        for i in range(count):
            slope[i, k] = (slope[i, k] - dz[i]) / (2.0 * h)
        z[k] = own


@njit(**COMPILED)
def _marched(
    law: int, p: np.ndarray, times: np.ndarray, x: np.ndarray, v: np.ndarray, step: float, start: np.ndarray,
    size: np.ndarray, path: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """March the states over one period from `start` (count,), write their path (m, count), and return their end."""
    count, m, half = size.size, times.size, 0.5 * step
    z, dz = np.zeros(STATES), np.zeros(STATES)
    slope, of_force, known, inverse = np.zeros((count, count)), np.zeros(count), np.zeros(count), np.eye(count)
    z[:count] = start
    force(law, times[0], x[0], v[0], p, z, dz)
    for j in range(m):
        k = (j + 1) % m
        for i in range(count):
            path[j, i] = z[i]
            known[i] = z[i] + half * dz[i]
            z[i] = known[i] + half * dz[i]
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
    for j in range(times.size):
        for i in range(count):
            z[i] = path[j, i]
        _rates_by_state(law, p, times[j], x[j], v[j], size, z, dz, by_state[j], force_by_state[j])


@njit(**COMPILED)
def _differentiate_by_motion(
    law: int, p: np.ndarray, times: np.ndarray, x: np.ndarray, v: np.ndarray, steps: tuple[float, float],
    path: np.ndarray, rate: np.ndarray, by_position: np.ndarray, by_rate: np.ndarray,
) -> None:  # fmt: skip
    """Write the rates of the states along their path, and their derivatives by position and rate of the place."""
    count = path.shape[1]
    z, dz = np.zeros(STATES), np.zeros(STATES)
    for j in range(times.size):
        t = times[j]
        for i in range(count):
            z[i] = path[j, i]
        force(law, t, x[j], v[j], p, z, dz)
        for i in range(count):
            rate[j, i] = dz[i]
        force(law, t, x[j] + steps[0], v[j], p, z, dz)
        for i in range(count):
            by_position[j, i] = dz[i]
        force(law, t, x[j] - steps[0], v[j], p, z, dz)
        for i in range(count):
            by_position[j, i] = (by_position[j, i] - dz[i]) / (2.0 * steps[0])
        force(law, t, x[j], v[j] + steps[1], p, z, dz)
        for i in range(count):
            by_rate[j, i] = dz[i]
        force(law, t, x[j], v[j] - steps[1], p, z, dz)
        for i in range(count):
            by_rate[j, i] = (by_rate[j, i] - dz[i]) / (2.0 * steps[1])


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
def _forced(by_state: np.ndarray, step: float, load: np.ndarray, start: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Carry changes (count, n) of the states over a period; write their path (m, count, n), and return their end.

    load : (m, count, k) on the rates of the last k of the changes
    """
    m, count, loads = load.shape
    columns, half = start.shape[1], 0.5 * step
    free = columns - loads
    now, inverse, explicit = start.copy(), np.eye(count), np.zeros((count, columns))
    for j in range(m):
        k = (j + 1) % m
        _invert(by_state[k], half, inverse)
        for i in range(count):
            for c in range(columns):
                path[j, i, c] = explicit[i, c] = now[i, c]
            for c in range(loads):
                explicit[i, free + c] += half * (load[j, i, c] + load[k, i, c])
            for s in range(count):
                factor = half * by_state[j, i, s]
                for c in range(columns):
                    explicit[i, c] += factor * now[s, c]
        now[:] = 0.0
        for i in range(count):
            for s in range(count):
                factor = inverse[i, s]
                for c in range(columns):
                    now[i, c] += factor * explicit[s, c]
    return now


def _once(by_state: np.ndarray, step: float) -> np.ndarray:
    """Change (count, count) of the states over one period with those at its start."""
    m, count, _ = by_state.shape
    return _forced(by_state, step, np.zeros((m, count, 0)), np.eye(count), np.empty((m, count, count)))


def _carried(by_state: np.ndarray, step: float, load: np.ndarray) -> np.ndarray:
    """Periodic change (m, count, k) of the states under k loads (m, count, k) on their rates."""
    m, count, columns = load.shape
    path = np.empty((m, count, count + columns))  # of each start without load, then of each load from zero
    end = _forced(by_state, step, load, np.eye(count, count + columns), path)
    start = np.linalg.lstsq(np.eye(count) - end[:, :count], end[:, count:], NEUTRAL)[0]
    return path[:, :, count:] + path[:, :, :count] @ start
