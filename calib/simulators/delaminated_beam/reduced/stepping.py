"""Exact drifts of the modes, with kicks between them."""

import numpy as np
from numba import njit

from calib.simulators import law_calls
from calib.simulators.compilation import COMPILED, INLINED
from calib.simulators.delaminated_beam.impacts import record_near_miss
from calib.simulators.delaminated_beam.reduced.contact import (
    apply_contact_forces,
    apply_contact_laws,
    find_near_pairs,
    record_contact,
)
from calib.simulators.delaminated_beam.reduced.linear_algebra import VECTOR, dot, dot_row
from calib.simulators.delaminated_beam.reduced.plan import Drift, ReducedPlan, ReducedState, ReducedTrace

DONE, DIVERGED = 0, 1  # codes of `advance`


@njit(**VECTOR)
def membrane_force(plan: ReducedPlan, state: ReducedState) -> None:
    """Compute the force of the stretched layer on the modes."""
    n = len(state.kick)
    q, kick = state.q, state.kick
    quadratic_stretch, tension = 0.0, 0.0
    for k in range(n):
        kick[k] = dot(plan.quadratic, k, q)
        quadratic_stretch += 0.5 * q[k] * kick[k]
        tension += plan.tension[k] * q[k]
    quadratic_stretch += 0.5 * q[n] * dot(plan.quadratic, n, q)
    tension += plan.tension[n] * q[n]
    pull = tension + plan.kappa * quadratic_stretch
    for k in range(n):
        kick[k] = -pull * kick[k] - quadratic_stretch * plan.stretch[k]


@njit(**VECTOR)
def apply_membrane_force(state: ReducedState, filter: np.ndarray, span: float) -> None:
    """Change the rates of the modes by the membrane force over a time `span` [s]; `filter` as `Drift.kick`."""
    for k in range(len(state.kick)):
        state.v[k] += span * filter[k] * state.kick[k]


@njit(**VECTOR)
def drift_modes(drift: Drift, q: np.ndarray, v: np.ndarray, before: float, after: float) -> None:
    """Move the modes by a drift, under the drive's X'' + alpha X' before and after it."""
    for k in range(len(drift.qq)):
        x, y = q[k], v[k]
        q[k] = drift.qq[k] * x + drift.qv[k] * y + drift.q0[k] * before + drift.q1[k] * after
        v[k] = drift.vq[k] * x + drift.vv[k] * y + drift.v0[k] * before + drift.v1[k] * after


@njit(**COMPILED)
def apply_force_laws(plan: ReducedPlan, state: ReducedState, time: float, span: float) -> None:
    """Kick the modes by the force laws over a time `span` [s]."""
    none, kick = np.zeros(1), np.zeros(len(state.kick))
    for j in range(len(plan.masses)):
        x, v, acceleration = dot(plan.columns, j, state.q), dot(plan.columns, j, state.v), 0.0
        for law in range(plan.counts[0]):
            if plan.acts[law, plan.bodies[j]]:
                acceleration += law_calls.force(plan.force[law], time, x, v, plan.force_p[law], none, none)
        for k in range(len(kick)):
            kick[k] += span * plan.masses[j] * acceleration * plan.columns[j, k]
    state.v[: len(kick)] += kick


@njit(**INLINED)
def record_samples(
    plan: ReducedPlan,
    old: np.ndarray,
    state: ReducedState,
    begin: float,
    length: float,
    impulse: np.ndarray,
    number: int,
    trace: ReducedTrace,
) -> int:
    """Record the samples within a step that began at `begin` and lasts `length` [s]; return how many there are now."""
    n = len(state.kick)
    while number < len(trace.times) and trace.times[number] < begin + length:
        s = (trace.times[number] - begin) / length
        for body in range(2):
            if body == 0:
                x0, v0, x1, v1 = old[0], old[1], state.q[n], state.v[n]
            else:
                x0, v0, x1, v1 = old[2], old[3], dot_row(plan.layer, state.q), dot_row(plan.layer, state.v)
            rise = x1 - x0 - length * v0
            bend = length * (v1 - v0)
            # cubic through both ends with their rates
            trace.samples[number, body] = x0 + s * length * v0 + s * s * ((3.0 * rise - bend) + s * (bend - 2.0 * rise))
            slope = s * (2.0 * (3.0 * rise - bend) + 3.0 * s * (bend - 2.0 * rise))
            trace.samples[number, 2 + body] = v0 + slope / length
        trace.samples[number, 4] = impulse[0]
        impulse[0] = 0.0
        number += 1
    return number


@njit(**INLINED)
def store_middle(plan: ReducedPlan, old: np.ndarray, state: ReducedState) -> None:
    """Write displacement [m] and velocity [m/s] of beam and layer in the middle to `old` (4,)."""
    n = len(state.kick)
    old[0], old[1] = state.q[n], state.v[n]
    old[2], old[3] = dot_row(plan.layer, state.q), dot_row(plan.layer, state.v)


@njit(**COMPILED)
def advance(plan: ReducedPlan, state: ReducedState, time: float, drive: np.ndarray, trace: ReducedTrace) -> int:
    """Go on by len(drive) - 1 steps.

    Parameters
    ----------
    time : at the first step  [s]
    drive : (steps * parts + 1, 3) X [m], X' [m/s], X'' + alpha X' [m/s^2] at the ends of all parts

    Returns
    -------
    code : DONE or DIVERGED
    """
    n, parts = len(state.kick), plan.parts
    m = len(plan.clearance)
    part = plan.step / parts
    gap, rate, static_opening = np.zeros(m), np.zeros(m), np.zeros(m)
    push, change = np.zeros(m), np.zeros(n)
    active, factors = np.zeros(m, dtype=np.int64), np.empty((2, m, m))
    factor_pairs = np.zeros((2, m + 1), dtype=np.int64)
    old, impulse, sample = np.zeros(4), np.zeros(1), 0
    state.q[n], state.v[n] = drive[0, 0], drive[0, 1]
    membrane_force(plan, state)
    for step in range((len(drive) - 1) // parts):
        at, begin = step * parts, step * plan.step
        near, nearest = find_near_pairs(plan, state, plan.step)
        closed = 0
        store_middle(plan, old, state)
        apply_membrane_force(state, plan.flight.kick, 0.5 * plan.step)
        if plan.counts[0] > 0:
            apply_force_laws(plan, state, time + begin, 0.5 * plan.step)
        if near == 0:
            drift_modes(plan.flight, state.q, state.v, drive[at, 2], drive[at + parts, 2])
            state.q[n], state.v[n] = drive[at + parts, 0], drive[at + parts, 1]
            state.counters[0] += 1
        else:
            for k in range(parts):
                if k:
                    store_middle(plan, old, state)
                drift_modes(plan.near, state.q, state.v, drive[at + k, 2], drive[at + k + 1, 2])
                state.q[n], state.v[n] = drive[at + k + 1, 0], drive[at + k + 1, 1]
                closed = apply_contact_forces(
                    plan, state, near, part, gap, rate, static_opening, active, factors, factor_pairs, push, change
                )
                if plan.counts[1] > 0:
                    apply_contact_laws(plan, state, near, part, gap, rate)
                if closed:
                    now = time + begin + (k + 1) * part
                    impulse[0] += part * record_contact(plan, state, near, now, part, gap, rate, trace)
                if k < parts - 1:
                    sample = record_samples(plan, old, state, begin + k * part, part, impulse, sample, trace)
            state.counters[0] += parts
        membrane_force(plan, state)
        apply_membrane_force(state, plan.flight.kick, 0.5 * plan.step)
        if plan.counts[0] > 0:
            apply_force_laws(plan, state, time + begin + plan.step, 0.5 * plan.step)
        if near:
            sample = record_samples(plan, old, state, begin + (parts - 1) * part, part, impulse, sample, trace)
        else:
            sample = record_samples(plan, old, state, begin, plan.step, impulse, sample, trace)
        if len(trace.nearest):
            record_near_miss(closed, nearest, trace)
        if not abs(dot_row(plan.layer, state.q)) < plan.limit:
            return DIVERGED
    return DONE
