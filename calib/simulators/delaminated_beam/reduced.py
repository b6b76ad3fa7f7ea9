"""The reduced kernel: modes drift exactly, and are kicked by membrane and contact forces between the drifts.

A period is divided into equal steps, each of which may be divided again. In flight one step is

    half a kick by the membrane force, exact drift of each mode under the drive, half a kick,

and where contact is near, the drift goes in parts, after each of which the contact forces move the modes. They are
implicit: the closed pairs' forces F over a part of length h obey

    (1 / e + C / h + h W) F = (kappa p + (c / h) C F_before) / e + p',      e = c + kappa h,    W = B M^-1 B^T

with p the penetrations, p' their rates, C the compliance that no mode carries; pairs that would pull are left out and
the rest is solved again. They change the rates by h M^-1 B^T F, and the coordinates by `along` times that, half a part
for slow modes: the forces are steady over a part, not blows at its end. With blows a closed pair would fall for a part
before it is caught, and creep ahead by half of that, as if its damper gave way by h W / 2 more. No part is too long for
any stiffness, damping or mode.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from calib.simulators import slots
from calib.simulators.compilation import COMPILED, INLINED
from calib.simulators.delaminated_beam.impacts import note_impact, note_pass

DONE, DIVERGED = 0, 1
VECTOR = {**INLINED, "fastmath": {"contract", "reassoc"}}


class Drift(NamedTuple):
    """Exact motion of n damped modes over a time h, under an acceleration of the drive that is linear in time.

    q+ = qq q + qv v + q0 f(0) + q1 f(h),  v+ = vq q + vv v + v0 f(0) + v1 f(h), arrays (n,); f = X'' + alpha X'.

    Attributes
    ----------
    kick : (n,) mean effect on v of a steady force over h, sin(omega h / 2) / (omega h / 2)  [1]
    """

    qq: np.ndarray
    qv: np.ndarray
    q0: np.ndarray
    q1: np.ndarray
    vq: np.ndarray
    vv: np.ndarray
    v0: np.ndarray
    v1: np.ndarray
    kick: np.ndarray


class ReducedPlan(NamedTuple):
    """Everything that a run holds fixed; n modes, m contact pairs, k pairs that are looked at in flight.

    Attributes
    ----------
    step, parts : of a flight step [s], and how many parts it has where contact is near
    flight, near : over a step, over a part
    along : (n,) displacement that goes with a change of rate by contact, see `reduction`  [s]
    quadratic : (n + 1, n + 1), tension : (n + 1,), kappa : see `modes`
    stretch : (n,) tension in the kicks, see `reduction`
    opening : (m, n + 1) of the pairs, per modal coordinate and per displacement of the driven node
    watched : (k,) pairs that are looked at in flight
    clearance, stiffness, damping : (m,)  [m], [N/m], [N s/m]
    mobility : (m, m) W  [1/kg]
    compliance : (m, m) C  [m/N]
    clipped : whether contact cannot pull
    area, place : (m,) [m^2], [1]
    centre : number of the pair in the middle
    layer : (n + 1,) displacement of the layer in the middle
    guard : (m,) clearance that counts as near  [m]
    limit : displacement beyond which the motion diverges  [m]
    merged : time without contact that separates two impacts  [s]
    force, force_p, acts : laws, as in `explicit.ReducedPlan`
    columns, masses, bodies : (j, n + 1) displacement of the points at which force laws act, their masses [kg], bodies
    contact, contact_p : laws of the contact
    counts : (2,) laws at force and contact
    """

    step: float
    parts: int
    flight: Drift
    near: Drift
    along: np.ndarray
    quadratic: np.ndarray
    tension: np.ndarray
    stretch: np.ndarray
    kappa: float
    opening: np.ndarray
    watched: np.ndarray
    clearance: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    mobility: np.ndarray
    compliance: np.ndarray
    clipped: bool
    area: np.ndarray
    place: np.ndarray
    centre: int
    layer: np.ndarray
    guard: np.ndarray
    limit: float
    merged: float
    force: np.ndarray
    force_p: np.ndarray
    acts: np.ndarray
    columns: np.ndarray
    masses: np.ndarray
    bodies: np.ndarray
    contact: np.ndarray
    contact_p: np.ndarray
    counts: np.ndarray


class ReducedState(NamedTuple):
    """Where a run stands; the kernel writes it.

    Attributes
    ----------
    q, v : (n + 1,) coordinates, the last that of the drive  [m kg^1/2], their rates
    push : (m,) contact forces of the last part  [N]
    kick : (n,) membrane force  [N kg^-1/2]
    near : (m,) pairs near contact
    last : (2,) times of the last contact, anywhere and in the middle  [s]
    count : (1,) steps and parts done
    """

    q: np.ndarray
    v: np.ndarray
    push: np.ndarray
    kick: np.ndarray
    near: np.ndarray
    last: np.ndarray
    count: np.ndarray


class ReducedTrace(NamedTuple):
    """What is noted on the way.

    Attributes
    ----------
    times : (s,) of the samples, since the beginning of the call  [s]
    samples : (s, 5) see `explicit.ReducedTrace`
    impacts, central : (k, 2) time [s] and closing speed [m/s] at which contact begins
    closed : (m,) time for which each pair was closed  [s]
    total : (5,) impacts, central impacts, time with contact [s], largest force [N], deepest penetration [m]
    nearest : (k,) local minima of the clearance while nothing is closed; only where it is not empty
    passes : (3,) smallest clearance one and two steps back, number of minima
    """

    times: np.ndarray
    samples: np.ndarray
    impacts: np.ndarray
    central: np.ndarray
    closed: np.ndarray
    total: np.ndarray
    nearest: np.ndarray
    passes: np.ndarray


@njit(**VECTOR)
def dot(rows, i, y):
    """Row i of (m, n) times y (n,)."""
    total = 0.0
    for k in range(len(y)):
        total += rows[i, k] * y[k]
    return total


@njit(**VECTOR)
def membrane(plan, state):
    """Work out the force of the stretched layer on the modes."""
    n = len(state.kick)
    q, kick = state.q, state.kick
    bent, tension = 0.0, 0.0
    for k in range(n):
        kick[k] = dot(plan.quadratic, k, q)
        bent += 0.5 * q[k] * kick[k]
        tension += plan.tension[k] * q[k]
    bent += 0.5 * q[n] * dot(plan.quadratic, n, q)
    tension += plan.tension[n] * q[n]
    pull = tension + plan.kappa * bent
    for k in range(n):
        kick[k] = -pull * kick[k] - bent * plan.stretch[k]


@njit(**VECTOR)
def kicked(state, filter, time):
    """Add to the rates what the membrane force does over a time  [s]."""
    for k in range(len(state.kick)):
        state.v[k] += time * filter[k] * state.kick[k]


@njit(**VECTOR)
def drifted(drift, q, v, before, after):
    """Move the modes by a drift, under the drive's X'' + alpha X' before and after it."""
    for k in range(len(drift.qq)):
        x, y = q[k], v[k]
        q[k] = drift.qq[k] * x + drift.qv[k] * y + drift.q0[k] * before + drift.q1[k] * after
        v[k] = drift.vq[k] * x + drift.vv[k] * y + drift.v0[k] * before + drift.v1[k] * after


@njit(**INLINED)
def find_near(plan, state, ahead):
    """Note the pairs that may close within a time `ahead` [s]; return their number and the smallest clearance [m]."""
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


@njit(**VECTOR)
def factorised(matrix, first, count):
    """Replace the rows of a symmetric positive definite matrix, from `first` on, by those of its Cholesky factor."""
    for i in range(first, count):
        for j in range(i):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / matrix[j, j]
        pivot = matrix[i, i]
        for k in range(i):
            pivot -= matrix[i, k] ** 2
        matrix[i, i] = np.sqrt(pivot)


@njit(**VECTOR)
def solved(factor, right, count):
    """Solve a system whose Cholesky factor is given; the solution stands in `right`."""
    for i in range(count):
        total = right[i]
        for k in range(i):
            total -= factor[i, k] * right[k]
        right[i] = total / factor[i, i]
    for i in range(count - 1, -1, -1):
        right[i] /= factor[i, i]
        for k in range(i):
            right[k] -= factor[i, k] * right[i]


@njit(**INLINED)
def prepared(plan, part, active, count, factor, of):
    """See to it that `factor` is that of the closed pairs; `of` says whose it is, their number last."""
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
def push_apart(plan, state, near, part, gap, rate, yielded, active, factors, of, push, change):
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
def push_by_contact_laws(plan, state, near, part, gap, rate):
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


@njit(**COMPILED)
def push_by_laws(plan, state, time, span):
    """Kick the modes by the force laws over a time `span` [s]."""
    none, kick = np.zeros(1), np.zeros(len(state.kick))
    for j in range(len(plan.masses)):
        x, v, acceleration = dot(plan.columns, j, state.q), dot(plan.columns, j, state.v), 0.0
        for law in range(plan.counts[0]):
            if plan.acts[law, plan.bodies[j]]:
                acceleration += slots.force(plan.force[law], time, x, v, plan.force_p[law], none, none)
        for k in range(len(kick)):
            kick[k] += span * plan.masses[j] * acceleration * plan.columns[j, k]
    state.v[: len(kick)] += kick


@njit(**INLINED)
def sampled(plan, old, state, begin, length, impulse, number, seen):
    """Note the samples within a step that began at `begin` and lasts `length` [s]; return how many there are now."""
    n = len(state.kick)
    while number < len(seen.times) and seen.times[number] < begin + length:
        s = (seen.times[number] - begin) / length
        for body in range(2):
            if body == 0:
                x0, v0, x1, v1 = old[0], old[1], state.q[n], state.v[n]
            else:
                x0, v0, x1, v1 = old[2], old[3], dot_row(plan.layer, state.q), dot_row(plan.layer, state.v)
            rise = x1 - x0 - length * v0
            bend = length * (v1 - v0)
            # cubic through both ends with their rates
            seen.samples[number, body] = x0 + s * length * v0 + s * s * ((3.0 * rise - bend) + s * (bend - 2.0 * rise))
            slope = s * (2.0 * (3.0 * rise - bend) + 3.0 * s * (bend - 2.0 * rise))
            seen.samples[number, 2 + body] = v0 + slope / length
        seen.samples[number, 4] = impulse[0]
        impulse[0] = 0.0
        number += 1
    return number


@njit(**VECTOR)
def dot_row(row, y):
    """Product of two (n,)."""
    total = 0.0
    for k in range(len(y)):
        total += row[k] * y[k]
    return total


@njit(**INLINED)
def begun(plan, old, state):
    """Keep displacement and velocity of beam and layer in the middle."""
    n = len(state.kick)
    old[0], old[1] = state.q[n], state.v[n]
    old[2], old[3] = dot_row(plan.layer, state.q), dot_row(plan.layer, state.v)


@njit(**INLINED)
def note_contact(plan, state, near, time, part, gap, rate, seen):
    """Note what the contact forces of a part did; return their sum  [N]."""
    force, anywhere = 0.0, False
    for k in range(near):
        i = state.near[k]
        force += state.push[i]
        if gap[i] >= 0.0:
            continue
        seen.closed[i] += part
        seen.total[4] = max(seen.total[4], -gap[i])
        if not anywhere and time - state.last[0] > plan.merged:
            note_impact(time, -rate[i], seen.impacts, seen.total, 0)
        anywhere = True
        if i == plan.centre:
            if time - state.last[1] > plan.merged:
                note_impact(time, -rate[i], seen.central, seen.total, 1)
            state.last[1] = time
    if anywhere:
        state.last[0] = time
        seen.total[2] += part
    seen.total[3] = max(seen.total[3], force)
    return force


@njit(**COMPILED)
def advance(plan, state, time, drive, seen):
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
    gap, rate, yielded = np.zeros(m), np.zeros(m), np.zeros(m)
    push, change = np.zeros(m), np.zeros(n)
    active, factors = np.zeros(m, dtype=np.int64), np.empty((2, m, m))
    of = np.zeros((2, m + 1), dtype=np.int64)
    old, impulse, sample = np.zeros(4), np.zeros(1), 0
    state.q[n], state.v[n] = drive[0, 0], drive[0, 1]
    membrane(plan, state)
    for step in range((len(drive) - 1) // parts):
        at, begin = step * parts, step * plan.step
        near, nearest = find_near(plan, state, plan.step)
        closed = 0
        begun(plan, old, state)
        kicked(state, plan.flight.kick, 0.5 * plan.step)
        if plan.counts[0] > 0:
            push_by_laws(plan, state, time + begin, 0.5 * plan.step)
        if near == 0:
            drifted(plan.flight, state.q, state.v, drive[at, 2], drive[at + parts, 2])
            state.q[n], state.v[n] = drive[at + parts, 0], drive[at + parts, 1]
            state.count[0] += 1
        else:
            for k in range(parts):
                if k:
                    begun(plan, old, state)
                drifted(plan.near, state.q, state.v, drive[at + k, 2], drive[at + k + 1, 2])
                state.q[n], state.v[n] = drive[at + k + 1, 0], drive[at + k + 1, 1]
                closed = push_apart(plan, state, near, part, gap, rate, yielded, active, factors, of, push, change)
                if plan.counts[1] > 0:
                    push_by_contact_laws(plan, state, near, part, gap, rate)
                if closed:
                    now = time + begin + (k + 1) * part
                    impulse[0] += part * note_contact(plan, state, near, now, part, gap, rate, seen)
                if k < parts - 1:
                    sample = sampled(plan, old, state, begin + k * part, part, impulse, sample, seen)
            state.count[0] += parts
        membrane(plan, state)
        kicked(state, plan.flight.kick, 0.5 * plan.step)
        if plan.counts[0] > 0:
            push_by_laws(plan, state, time + begin + plan.step, 0.5 * plan.step)
        if near:
            sample = sampled(plan, old, state, begin + (parts - 1) * part, part, impulse, sample, seen)
        else:
            sample = sampled(plan, old, state, begin, plan.step, impulse, sample, seen)
        if len(seen.nearest):
            note_pass(closed, nearest, seen)
        if not abs(dot_row(plan.layer, state.q)) < plan.limit:
            return DIVERGED
    return DONE
