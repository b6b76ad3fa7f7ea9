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

from calib.simulators import slots
from calib.simulators.compilation import INLINED
from calib.simulators.delaminated_beam.impacts import record_impact
from calib.simulators.delaminated_beam.reduced.linear_algebra import VECTOR, dot, factorised, solved
from calib.simulators.delaminated_beam.reduced.plan import ReducedPlan, ReducedState, ReducedTrace


@njit(**INLINED)
def find_near(plan: ReducedPlan, state: ReducedState, ahead: float) -> tuple[int, float]:
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
def prepared(
    plan: ReducedPlan, part: float, active: np.ndarray, count: int, factor: np.ndarray, of: np.ndarray
) -> None:
    """Bring `factor` up to date with the closed pairs; `of` says whose it is, their number last."""
    first, last = 0, len(of) - 1
    while first < min(count, of[last]) and of[first] == active[first]:
        first += 1
    of[last] = count
    for a in range(first, count):
        i = active[a]
        of[a] = i
        for b in range(a + 1):
            j = active[b]
            factor[a, b] = plan.compliance[i, j] / part + part * plan.mobility[i, j]
        factor[a, a] += 1.0 / (plan.damping[i] + plan.stiffness[i] * part)
    factorised(factor, first, count)


@njit(**VECTOR)
def push_apart(
    plan: ReducedPlan,
    state: ReducedState,
    near: int,
    part: float,
    gap: np.ndarray,
    rate: np.ndarray,
    yielded: np.ndarray,
    active: np.ndarray,
    factors: np.ndarray,
    of: np.ndarray,
    push: np.ndarray,
    change: np.ndarray,
) -> int:
    """Move the modes by the contact forces over a part  [s]; return the number of closed pairs.

    Of the factors (2, m, m) the first is that of all closed pairs, the second of those that do not pull; `of`
    (2, m + 1) says whose they are. They are kept from part to part, since few pairs change. `change` (n,) is zero.
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
        yielded[active[a]] = dot(plan.compliance, active[a], state.push)
    count, turn = closed, 0
    while count:
        prepared(plan, part, active, count, factors[turn], of[turn])
        for a in range(count):
            i = active[a]
            e = plan.damping[i] + plan.stiffness[i] * part
            push[a] = yielded[i] / part - plan.stiffness[i] * (gap[i] + yielded[i]) / e - rate[i]
        solved(factors[turn], push, count)
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
        count, turn = left, 1
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
def push_by_contact_laws(
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
            more += slots.contact(plan.contact[law], plan.place[i], gap[i], rate[i], pressure, plan.contact_p[law])
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
        trace.total[4] = max(trace.total[4], -gap[i])
        if not anywhere and time - state.last[0] > plan.merged:
            record_impact(time, -rate[i], trace.impacts, trace.total, 0)
        anywhere = True
        if i == plan.centre:
            if time - state.last[1] > plan.merged:
                record_impact(time, -rate[i], trace.central, trace.total, 1)
            state.last[1] = time
    if anywhere:
        state.last[0] = time
        trace.total[2] += part
    trace.total[3] = max(trace.total[3], force)
    return force
