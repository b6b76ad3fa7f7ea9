"""Central differences, step by step."""

import numpy as np
from numba import njit, uintp

from calib.simulators import law_calls
from calib.simulators.compilation import COMPILED, INLINED
from calib.simulators.delaminated_beam.explicit.contact import apply_contact_forces, find_contact, record_contact
from calib.simulators.delaminated_beam.explicit.elements import VECTOR, elastic
from calib.simulators.delaminated_beam.explicit.plan import (
    FORCE_ROWS,
    NEXT_SEARCH,
    ROW_LENGTH,
    STEPS_DONE,
    ExplicitPlan,
    ExplicitState,
    ExplicitTrace,
)
from calib.simulators.delaminated_beam.impacts import record_near_miss

STEPS_BETWEEN_SEARCHES = 8  # for contact, while no pair can close in between
STEPS_BETWEEN_CHECKS = 64  # of the velocities
DONE, UNSTABLE = 0, 1  # codes of `advance`


@njit(**VECTOR)
def advance_line(
    count: int,
    at: int,
    forces: np.ndarray,
    row: int,
    other: int | None,
    w: np.ndarray,
    v: np.ndarray,
    inverse_mass: np.ndarray,
    keep: float,
    gain: float,
    ahead: float,
    back: float,
) -> None:
    """Step the nodes, from `at` on, of a line between two strips, whose forces begin at `row` and at `other`.

    `other` is None for a line with elements on one side, which is compiled by itself.
    """
    for j in range(count):
        old = v[at + j]
        force = forces[row + j] + forces[row + uintp(ROW_LENGTH) + j]
        if other is not None:
            force = force + forces[other + j] + forces[other + uintp(ROW_LENGTH) + j]
        new = keep * old - gain * inverse_mass[at + j] * force
        v[at + j] = new
        w[at + j] += ahead * new - back * old


@njit(**INLINED)
def advance_nodes(plan: ExplicitPlan, state: ExplicitState) -> None:
    """Step all nodes by the elements' forces and by alpha."""
    half = 0.5 * plan.alpha * plan.step
    keep, gain = (1.0 - half) / (1.0 + half), plan.step / (1.0 + half)
    ahead, back = plan.step + plan.beta, plan.beta
    w, v, mass, forces = state.w, state.v, plan.inverse_mass, state.elastic
    for k in range(len(plan.lines)):
        first, count, below, above = plan.lines[k, 0], plan.lines[k, 1], plan.lines[k, 2], plan.lines[k, 3]
        for component in range(2):
            at = uintp(first + component * plan.size)
            lower = uintp((below * FORCE_ROWS + 4 + 2 * component) * ROW_LENGTH)
            upper = uintp((above * FORCE_ROWS + 2 * component) * ROW_LENGTH)
            if below >= 0 and above >= 0:
                advance_line(uintp(count), at, forces, lower, upper, w, v, mass, keep, gain, ahead, back)
            else:
                row = upper if above >= 0 else lower
                advance_line(uintp(count), at, forces, row, None, w, v, mass, keep, gain, ahead, back)


@njit(**INLINED)
def apply_force_laws(plan: ExplicitPlan, state: ExplicitState, time: float) -> None:
    """Step the nodes by the force laws, each body by those that act on it."""
    gain = plan.step / (1.0 + 0.5 * plan.alpha * plan.step)
    ahead = plan.step + plan.beta
    none = state.push[:0]
    for k in range(len(plan.bodies)):
        first, count, body = plan.bodies[k]
        for j in range(first, first + count):
            if plan.inverse_mass[j] == 0.0:
                continue
            acceleration = 0.0
            for law in range(plan.counts[0]):
                if plan.acts[law, body]:
                    x = state.w[j] - plan.beta * state.v[j]
                    acceleration += law_calls.force(plan.force[law], time, x, state.v[j], plan.force_p[law], none, none)
            state.v[j] += gain * acceleration
            state.w[j] += ahead * gain * acceleration


@njit(**INLINED)
def step(plan: ExplicitPlan, state: ExplicitState, time: float, drive: float) -> tuple[int, float]:
    """Go on by one step, at whose end the driven node stands at `drive` [m].

    Returns
    -------
    closed, nearest : see `find_contact`; nearest is infinite where contact was not searched for
    """
    closed, nearest = 0, np.inf
    if state.counters[STEPS_DONE] >= state.counters[NEXT_SEARCH]:
        closed, nearest = find_contact(plan, state)
        if not closed and nearest > 2.0 * STEPS_BETWEEN_SEARCHES * plan.step * plan.limit:
            state.counters[NEXT_SEARCH] = state.counters[STEPS_DONE] + STEPS_BETWEEN_SEARCHES
    elastic(plan, state.w, state.elastic)
    driven = plan.driven
    before = state.w[driven] - plan.beta * state.v[driven]
    advance_nodes(plan, state)
    if plan.counts[0] > 0:
        apply_force_laws(plan, state, time)
    state.v[driven] = (drive - before) / plan.step
    state.w[driven] = drive + plan.beta * state.v[driven]
    if closed:
        apply_contact_forces(plan, state, closed)
    layer, beam = plan.lines[plan.joint[2], 0], plan.lines[plan.joint[2] - 1, 0]
    for k in range(len(plan.shared)):
        for component in range(2):
            source = component * plan.size + layer + plan.shared[k, 0]
            copy = component * plan.size + beam + plan.shared[k, 1]
            for j in range(plan.shared[k, 2]):
                state.w[copy + j] = state.w[source + j]
                state.v[copy + j] = state.v[source + j]
    state.counters[STEPS_DONE] += 1
    return closed, nearest


@njit(**COMPILED)
def advance(plan: ExplicitPlan, state: ExplicitState, time: float, drive: np.ndarray, trace: ExplicitTrace) -> int:
    """Go on by len(drive) steps, at whose ends the driven node stands at `drive` [m]; `time` is at the first step [s].

    Returns
    -------
    code : DONE or UNSTABLE
    """
    sample, impulse, old = 0, 0.0, np.zeros(4)
    slave, driven = plan.slave[plan.centre], plan.driven
    for n in range(len(drive)):
        old[0], old[1] = state.w[driven] - plan.beta * state.v[driven], state.v[driven]
        old[2], old[3] = state.w[slave] - plan.beta * state.v[slave], state.v[slave]
        closed, nearest = step(plan, state, time + n * plan.step, drive[n])
        if closed:
            impulse += plan.step * record_contact(plan, state, closed, trace)
        if len(trace.nearest):
            state.counters[NEXT_SEARCH] = 0
            record_near_miss(closed, nearest, trace)
        while sample < len(trace.at) and trace.at[sample] == n:
            theta = trace.shift[sample]
            for k, node in enumerate((driven, slave)):
                mean, change = 0.5 * (old[2 * k + 1] + state.v[node]), state.v[node] - old[2 * k + 1]
                trace.samples[sample, k] = old[2 * k] + plan.step * theta * (mean + 0.5 * theta * change)
                trace.samples[sample, 2 + k] = mean + theta * change
            trace.samples[sample, 4] = impulse
            impulse = 0.0
            sample += 1
        if state.counters[STEPS_DONE] % STEPS_BETWEEN_CHECKS == 0 and not np.max(np.abs(state.v)) < plan.limit:
            return UNSTABLE
    return DONE
