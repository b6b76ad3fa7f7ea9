"""Implicit contact forces on the modes.

The closed pairs' forces F over a part of length h obey

    (1 / e + C / h + h W) F = (kappa p + (c / h) C F_before) / e + p',      e = c + kappa h,    W = B M^-1 B^T

with p the penetrations, p' their rates, C the compliance that no mode carries; pairs that would pull are left out and
the rest is solved again. They change the rates by h M^-1 B^T F, and the coordinates by `along` times that, half a part
for slow modes: the forces are steady over a part, not blows at its end. With blows a closed pair would fall for a part
before it is caught, and creep ahead by half of that, as if its damper gave way by h W / 2 more. No part is too long for
any stiffness, damping or mode.
"""

import numpy as np
from numba import njit

from calib.simulators import law_calls
from calib.simulators.compilation import INLINED
from calib.simulators.delaminated_beam.impacts import (
    CENTRAL_IMPACTS,
    CONTACT_TIME,
    IMPACTS,
    MAX_FORCE,
    MAX_PENETRATION,
    record_impact,
)
from calib.simulators.delaminated_beam.reduced.linear_algebra import VECTOR, cholesky_factorise, cholesky_solve, dot
from calib.simulators.delaminated_beam.reduced.plan import ReducedPlan, ReducedState, ReducedTrace


@njit(**INLINED)
def find_near_pairs(plan: ReducedPlan, state: ReducedState, ahead: float) -> tuple[int, float]:
    """List the pairs that may close within a time `ahead` [s]; return their number and the smallest clearance [m]."""
    nearest, soon = np.inf, False
    for k in range(len(plan.watched)):
        i = plan.watched[k]
        gap = plan.clearance[i] + dot(plan.opening, i, state.q)
        nearest = min(nearest, gap)
        if gap < plan.guard[i] + 2.0 * ahead * max(0.0, -dot(plan.opening, i, state.v)):
            soon = True
    if not soon and plan.counts[1] == 0:
        return 0, nearest
    count = 0
    for i in range(len(plan.clearance) - 1, -1, -1):  # from the tip, so that the factors change at their end
        if plan.stiffness[i] == 0.0:
            continue
        gap = plan.clearance[i] + dot(plan.opening, i, state.q)
        nearest = min(nearest, gap)
        close = gap < plan.guard[i] + 2.0 * ahead * max(0.0, -dot(plan.opening, i, state.v))
        if close or plan.counts[1] > 0:
            state.near[count] = i
            count += 1
        else:
            state.push[i] = 0.0
    return count, nearest


@njit(**INLINED)
def update_factor(
    plan: ReducedPlan, part: float, active: np.ndarray, count: int, factor: np.ndarray, pairs: np.ndarray
) -> None:
    """Bring a Cholesky factor up to date with the first `count` of the active pairs.

    pairs : (m + 1,) those of the factor, their number last; written
    """
    first, last = 0, len(pairs) - 1
    while first < min(count, pairs[last]) and pairs[first] == active[first]:
        first += 1
    pairs[last] = count
    for a in range(first, count):
        i = active[a]
        pairs[a] = i
        for b in range(a + 1):
            j = active[b]
            factor[a, b] = plan.compliance[i, j] / part + part * plan.mobility[i, j]
        factor[a, a] += 1.0 / (plan.damping[i] + plan.stiffness[i] * part)
    cholesky_factorise(factor, first, count)


@njit(**VECTOR)
def apply_contact_forces(
    plan: ReducedPlan,
    state: ReducedState,
    near: int,
    part: float,
    gap: np.ndarray,
    rate: np.ndarray,
    static_opening: np.ndarray,
    active: np.ndarray,
    factors: np.ndarray,
    factor_pairs: np.ndarray,
    push: np.ndarray,
    change: np.ndarray,
) -> int:
    """Move the modes by the contact forces over a part  [s]; return the number of closed pairs.

    Parameters
    ----------
    near : number of pairs near contact
    gap, rate : (m,) clearance [m] and its rate [m/s], written where a pair is near, or closed
    static_opening, active, push : (m,) work space
    factors, factor_pairs : (2, m, m), (2, m + 1) of all closed pairs, and of those that do not pull; see
        `update_factor`. They last from part to part, since few pairs change
    change : (n,) work space, zero before and after
    """
    closed = 0
    for k in range(near):
        i = state.near[k]
        gap[i] = plan.clearance[i] + dot(plan.opening, i, state.q)
        if gap[i] < 0.0:
            rate[i] = dot(plan.opening, i, state.v)
            active[closed] = i
            closed += 1
    if closed == 0:
        for k in range(near):
            state.push[state.near[k]] = 0.0
        return 0
    for a in range(closed):
        static_opening[active[a]] = dot(plan.compliance, active[a], state.push)
    count, which = closed, 0
    while count:
        update_factor(plan, part, active, count, factors[which], factor_pairs[which])
        for a in range(count):
            i = active[a]
            e = plan.damping[i] + plan.stiffness[i] * part
            push[a] = static_opening[i] / part - plan.stiffness[i] * (gap[i] + static_opening[i]) / e - rate[i]
        cholesky_solve(factors[which], push, count)
        left = 0
        if plan.clipped:
            for a in range(count):
                if push[a] > 0.0:
                    active[left] = active[a]
                    left += 1
        else:
            left = count
        if left == count:
            break
        count, which = left, 1
    for k in range(near):
        state.push[state.near[k]] = 0.0
    for a in range(count):
        i = active[a]
        state.push[i] = push[a]
        for k in range(len(change)):
            change[k] += part * push[a] * plan.opening[i, k]
    for k in range(len(change)):
        state.v[k] += change[k]
        state.q[k] += plan.along[k] * change[k]
        change[k] = 0.0
    return closed


@njit(**INLINED)
def apply_contact_laws(
    plan: ReducedPlan, state: ReducedState, near: int, part: float, gap: np.ndarray, rate: np.ndarray
) -> None:
    """Kick the modes by the laws of the contact over a part  [s]."""
    for k in range(near):
        i = state.near[k]
        gap[i] = plan.clearance[i] + dot(plan.opening, i, state.q)
        rate[i] = dot(plan.opening, i, state.v)
    for k in range(near):
        i = state.near[k]
        pressure, more = state.push[i] / plan.area[i], 0.0
        for law in range(plan.counts[1]):
            more += law_calls.contact(plan.contact[law], plan.place[i], gap[i], rate[i], pressure, plan.contact_p[law])
        for j in range(len(state.kick)):
            state.v[j] += part * more * plan.area[i] * plan.opening[i, j]


@njit(**INLINED)
def record_contact(
    plan: ReducedPlan,
    state: ReducedState,
    near: int,
    time: float,
    part: float,
    gap: np.ndarray,
    rate: np.ndarray,
    trace: ReducedTrace,
) -> float:
    """Record what the contact forces of a part did; return their sum  [N]."""
    force, anywhere = 0.0, False
    for k in range(near):
        i = state.near[k]
        force += state.push[i]
        if gap[i] >= 0.0:
            continue
        trace.closed[i] += part
        trace.total[MAX_PENETRATION] = max(trace.total[MAX_PENETRATION], -gap[i])
        if not anywhere and time - state.last[0] > plan.merged:
            record_impact(time, -rate[i], trace.impacts, trace.total, IMPACTS)
        anywhere = True
        if i == plan.centre:
            if time - state.last[1] > plan.merged:
                record_impact(time, -rate[i], trace.central, trace.total, CENTRAL_IMPACTS)
            state.last[1] = time
    if anywhere:
        state.last[0] = time
        trace.total[CONTACT_TIME] += part
    trace.total[MAX_FORCE] = max(trace.total[MAX_FORCE], force)
    return force
