"""Contact of the layer's nodes with the beam's segments, in the full kernel."""

import numpy as np
from numba import njit, uintp

from calib.simulators import law_calls
from calib.simulators.compilation import INLINED
from calib.simulators.delaminated_beam.explicit.plan import (
    LAST_CENTRAL_CONTACT,
    LAST_CONTACT,
    STEPS_DONE,
    ExplicitPlan,
    ExplicitState,
    ExplicitTrace,
)
from calib.simulators.delaminated_beam.impacts import (
    CENTRAL_IMPACTS,
    CONTACT_TIME,
    IMPACTS,
    MAX_FORCE,
    MAX_PENETRATION,
    record_impact,
)


@njit(**INLINED)
def find_contact(plan: ExplicitPlan, state: ExplicitState) -> tuple[int, float]:
    """List the pairs that are closed at this step, with clearance and its rate.

    Returns
    -------
    closed : their number
    nearest : smallest clearance of all pairs  [m]
    """
    w, v, beta = state.w, state.v, plan.beta
    closed, nearest = 0, np.inf
    everywhere = plan.counts[1] > 0
    for i in range(len(plan.slave)):
        if not plan.acting[i]:
            continue
        s, m, n = uintp(plan.slave[i]), uintp(plan.master[i]), uintp(plan.following[i])
        weight = plan.weight[i]
        rate = v[s] - (1.0 - weight) * v[m] - weight * v[n]
        gap = plan.clearance[i] + w[s] - (1.0 - weight) * w[m] - weight * w[n] - beta * rate
        nearest = min(nearest, gap)
        if gap < 0.0 or everywhere:
            state.active[closed], state.gap[closed], state.rate[closed] = i, gap, rate
            closed += 1
    return closed, nearest


@njit(**INLINED)
def add_mobilities(plan: ExplicitPlan, state: ExplicitState, closed: int) -> None:
    """Add up, for each closed pair, by how much its own push and equal ones of all the others would part it  [1/kg].

    Pairs that share a master push it together. A damper that reckons with this is stable for any damping, whatever the
    others' pushes turn out to be: the row sums bound the matrix of the mobilities from above.
    """
    inverse, pair_weights = plan.inverse_mass, state.pair_weights
    for k in range(closed):
        if state.gap[k] < 0.0:
            i = state.active[k]
            pair_weights[plan.master[i]] += 1.0 - plan.weight[i]
            pair_weights[plan.following[i]] += plan.weight[i]
    for k in range(closed):
        i = state.active[k]
        s, m, n, weight = plan.slave[i], plan.master[i], plan.following[i], plan.weight[i]
        state.mobility[k] = (
            inverse[s] + (1.0 - weight) * inverse[m] * pair_weights[m] + weight * inverse[n] * pair_weights[n]
        )
    for k in range(closed):
        i = state.active[k]
        pair_weights[plan.master[i]] = pair_weights[plan.following[i]] = 0.0


@njit(**INLINED)
def apply_contact_forces(plan: ExplicitPlan, state: ExplicitState, closed: int) -> None:
    """Step the nodes of closed pairs by their contact forces.

    The damping sees the mean of the velocities before the step and after it, these as if the other closed pairs pushed
    as much (see `add_mobilities`): exact for a pair alone and for a common push. `lagged`: the velocity before.
    """
    w, v = state.w, state.v
    gain = plan.step / (1.0 + 0.5 * plan.alpha * plan.step)
    ahead = plan.step + plan.beta
    if not plan.lagged:
        add_mobilities(plan, state, closed)
    for k in range(closed):
        i = state.active[k]
        gap, before = state.gap[k], state.rate[k]
        s, m, n, weight = plan.slave[i], plan.master[i], plan.following[i], plan.weight[i]
        push = 0.0
        if gap < 0.0:
            if plan.lagged:
                push = -plan.stiffness[i] * gap - plan.damping[i] * before
            else:
                free = v[s] - (1.0 - weight) * v[m] - weight * v[n]
                push = -plan.stiffness[i] * gap - plan.damping[i] * 0.5 * (before + free)
                push /= 1.0 + 0.5 * plan.damping[i] * gain * state.mobility[k]
            if plan.clipped:
                push = max(0.0, push)
        if plan.counts[1] > 0:
            pressure, more = push / plan.area[i], 0.0
            for law in range(plan.counts[1]):
                more += law_calls.contact(plan.contact[law], plan.place[i], gap, before, pressure, plan.contact_p[law])
            push += more * plan.area[i]
        state.push[k] = push
    for k in range(closed):
        i, push = state.active[k], state.push[k]
        s, m, n, weight = plan.slave[i], plan.master[i], plan.following[i], plan.weight[i]
        for node, part in ((s, 1.0), (m, weight - 1.0), (n, -weight)):
            change = gain * plan.inverse_mass[node] * part * push
            v[node] += change
            w[node] += ahead * change


@njit(**INLINED)
def record_contact(plan: ExplicitPlan, state: ExplicitState, closed: int, trace: ExplicitTrace) -> float:
    """Record what the contact forces of this step did; return their sum  [N]."""
    force, anywhere, step = 0.0, False, state.counters[STEPS_DONE]
    for k in range(closed):
        force += state.push[k]
        if state.gap[k] >= 0.0:  # a law acts at a distance
            continue
        i = state.active[k]
        trace.closed[i] += 1
        trace.total[MAX_PENETRATION] = max(trace.total[MAX_PENETRATION], -state.gap[k])
        if not anywhere and step - state.counters[LAST_CONTACT] > plan.merged:
            record_impact(step, -state.rate[k], trace.impacts, trace.total, IMPACTS)
        anywhere = True
        if i == plan.centre:
            if step - state.counters[LAST_CENTRAL_CONTACT] > plan.merged:
                record_impact(step, -state.rate[k], trace.central, trace.total, CENTRAL_IMPACTS)
            state.counters[LAST_CENTRAL_CONTACT] = step
    if anywhere:
        state.counters[LAST_CONTACT] = step
        trace.total[CONTACT_TIME] += 1
    trace.total[MAX_FORCE] = max(trace.total[MAX_FORCE], force)
    return force
