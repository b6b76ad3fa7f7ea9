"""The full kernel: central differences over corotational quadrilaterals with penalty contact.

Velocities live half a step before displacements. With w = u + beta v, the internal forces f(w) of all elements, the
contact forces F and the lumped masses M,

    v+ = [(1 - alpha dt/2) v - dt M^-1 (f(w) - F)] / (1 + alpha dt/2),    u+ = u + dt v+

so that alpha damps M v centrally and beta damps K v with the velocity half a step back; w is kept instead of u. The
elements' energy is that of the Biot strain in the axes that turn with the element,

    V [G/2 (D^2 + S^2) + K2/2 (r - 2)^2],    K2 = E / (2 (1 - nu)),
    D = F11 - F22,  S = F21 + F12,  A = F11 + F22,  B = F21 - F12,  r^2 = A^2 + B^2,

which is linear in all but r, and the bending of the product patterns in the turned axes (see `plane_stress`).

Rows of elements and nodes are contiguous and padded, one array an operand: these loops become vector instructions.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, uintp

from calib.simulators import slots
from calib.simulators.compilation import COMPILED, INLINED, WITHIN
from calib.simulators.delaminated_beam.impacts import note_impact, note_pass

ROW = 1032  # numbers from one row of a strip's coefficients or forces to the next
LANES = 8  # rows are padded to whole vectors
AROUND = 8  # steps from one look for contact to the next, while no pair can close in between
WATCH = 64  # steps from one look at the velocities to the next
FACTORS = 11  # rows of coefficients of a strip
FORCES = 8  # rows of nodal forces of a strip
DONE, UNSTABLE = 0, 1

VECTOR = {**WITHIN, "fastmath": {"contract"}}


class ExplicitPlan(NamedTuple):
    """Everything that a run holds fixed.

    Nodes are numbered line by line, padded, all x first, then all y: `size` to each.

    Attributes
    ----------
    size : of a component
    strips : (k, 3) first node of the lower and of the upper line, elements (padded)
    turned : (k,) whether a strip's stress-free elements are not rectangles along x
    factors : (k * FACTORS * ROW,) coefficients of the elements, see `forces_of_strip`
    across : (k,) 0.5 / height of the elements  [1/m]
    shear, mean : G, K2 (see above)  [Pa]
    lines : (l, 4) first node, nodes (padded), strip below, strip above (-1: none)
    shared : (j, 3) first node on the layer's lowest line and on the interface, and how many they have in common
    joint : (3,) strip below the interface, strip above the layer's lowest line, and that line
    inverse_mass : (2 * size,) 0 where a node is held, driven, or a second name of one on the layer's line  [1/kg]
    alpha, beta : [1/s], [s]
    step : [s]
    slave, master, following : (m,) y-nodes of the contact pairs
    weight, clearance, stiffness, damping : (m,) [1], [m], [N/m], [N s/m]
    acting : (m,) whether the two sides are two nodes
    area : (m,) of the pair  [m^2]
    place : (m,) along the delamination  [1]
    lagged, clipped : how damping is taken, and whether the force can pull
    centre : number of the pair in the middle
    driven : y-node
    limit : velocity beyond which the run counts as unstable  [m/s]
    merged : steps without contact that separate two impacts
    force, force_p : laws (see `calib.simulators.slots`), (SLOTS,), (SLOTS, LAW_PARAMETERS)
    acts : (SLOTS, 2) whether a force law acts on beam and layer
    bodies : (b, 3) first y-node, nodes and body (0 beam, 1 layer) of ranges on which force laws act
    contact, contact_p : laws of the contact
    counts : (2,) laws at force and contact
    """

    size: int
    strips: np.ndarray
    turned: np.ndarray
    factors: np.ndarray
    across: np.ndarray
    shear: float
    mean: float
    lines: np.ndarray
    shared: np.ndarray
    joint: np.ndarray
    inverse_mass: np.ndarray
    alpha: float
    beta: float
    step: float
    slave: np.ndarray
    master: np.ndarray
    following: np.ndarray
    weight: np.ndarray
    clearance: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    acting: np.ndarray
    area: np.ndarray
    place: np.ndarray
    lagged: bool
    clipped: bool
    centre: int
    driven: int
    limit: float
    merged: int
    force: np.ndarray
    force_p: np.ndarray
    acts: np.ndarray
    bodies: np.ndarray
    contact: np.ndarray
    contact_p: np.ndarray
    counts: np.ndarray


class ExplicitState(NamedTuple):
    """Where a run stands; the kernel writes it.

    Attributes
    ----------
    w, v : (2 * size,) displacement + beta velocity [m], velocity half a step back [m/s]
    elastic : (k * FORCES * ROW,) nodal forces of each strip's elements, see `spread`  [N]
    active : (m,) pairs that are closed
    gap, rate, push : (m,) clearance [m], its rate [m/s] half a step back, force [N] of the closed pairs
    mobility, crowd : (m,) of the closed pairs with all the others [1/kg]; (2 * size,) pairs that push each node [1]
    count : (4,) steps done in all, next step at which contact is looked for, step of the last contact anywhere, and in
        the middle
    """

    w: np.ndarray
    v: np.ndarray
    elastic: np.ndarray
    active: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    push: np.ndarray
    mobility: np.ndarray
    crowd: np.ndarray
    count: np.ndarray


class ExplicitTrace(NamedTuple):
    """What is noted while stepping.

    Attributes
    ----------
    at, shift : (s,) step next to each sample, and the sample's distance from it  [1], [1, in steps]
    samples : (s, 5) displacement of beam and layer in the middle [m], their velocities [m/s], impulse of the contact
        forces on the layer since the sample before [N s]
    impacts, central : (k, 2) step and closing speed [m/s] at which contact begins, anywhere and in the middle
    closed : (m,) steps for which each pair was closed
    total : (5,) impacts, central impacts, steps with contact, largest force [N], deepest penetration [m]
    nearest : (k,) local minima of the clearance while nothing is closed; only where it is not empty
    passes : (3,) smallest clearance one and two steps back, number of minima
    """

    at: np.ndarray
    shift: np.ndarray
    samples: np.ndarray
    impacts: np.ndarray
    central: np.ndarray
    closed: np.ndarray
    total: np.ndarray
    nearest: np.ndarray
    passes: np.ndarray


@njit(**VECTOR)
def spread(at, fx, fy, ax, ay, cx, cy, out):
    """Write the nodal forces of an element from `at` on: of product pattern (f), ends (a) and sides (c)  [N].

    Rows of `out`: x of the lower line from the elements on the right and on the left of each node, y of it, then x and
    y of the upper line.
    """
    plus, minus = ax + cx, ax - cx
    out[at] = fx - plus
    out[at + uintp(ROW + 1)] = minus - fx
    out[at + uintp(4 * ROW)] = -minus - fx
    out[at + uintp(5 * ROW + 1)] = fx + plus
    plus, minus = ay + cy, ay - cy
    out[at + uintp(2 * ROW)] = fy - plus
    out[at + uintp(3 * ROW + 1)] = minus - fy
    out[at + uintp(6 * ROW)] = -minus - fy
    out[at + uintp(7 * ROW + 1)] = fy + plus


@njit(**VECTOR)
def forces_of_strip(count, w, xl, yl, xu, yu, k, at, across, mean, shear, out, to):
    """Nodal forces of rectangular elements that stand along x.

    Parameters
    ----------
    count : elements, padded
    xl, yl, xu, yu : (count + 1,) displacements of the lower and the upper line  [m]
    k : rows 0.5 / length [1/m], 0.5 * height * width [m^2], 0.5 * length * width [m^2], a sixteenth of the bending
        stiffness of the two patterns [N/m]; zero in padding
    across : 0.5 / height  [1/m]
    mean, shear : K2, G  [Pa]
    out : see `spread`
    """
    for j in range(count):
        px, qx, rx = w[xl + uintp(1) + j] - w[xl + j], w[xu + uintp(1) + j] - w[xu + j], w[xu + j] - w[xl + j]
        py, qy, ry = w[yl + uintp(1) + j] - w[yl + j], w[yu + uintp(1) + j] - w[yu + j], w[yu + j] - w[yl + j]
        hx, hy = qx - px, qy - py
        along, end, side = k[at + j], k[at + uintp(ROW) + j], k[at + uintp(2 * ROW) + j]
        g11, g21 = along * (px + qx), along * (py + qy)
        g12, g22 = across * (2.0 * rx + hx), across * (2.0 * ry + hy)
        a, b = 2.0 + (g11 + g22), g21 - g12
        q = 1.0 / np.sqrt(a * a + b * b)
        c, s = a * q, b * q
        pressure = mean - 2.0 * mean * q
        pa, pb, pd, ps = pressure * a, pressure * b, shear * (g11 - g22), shear * (g21 + g12)
        tx, ty = c * hx + s * hy, c * hy - s * hx
        bx, by = k[at + uintp(3 * ROW) + j] * tx, k[at + uintp(4 * ROW) + j] * ty
        moment = (bx * ty - by * tx) * q
        mc, ms = moment * c, moment * s
        ax, ay = end * (pa + pd) - ms * along, end * (ps + pb) + mc * along
        cx, cy = side * (ps - pb) - mc * across, side * (pa - pd) - ms * across
        spread(to + j, c * bx - s * by, s * bx + c * by, ax, ay, cx, cy, out)


@njit(**VECTOR)
def forces_of_turned_strip(count, w, xl, yl, xu, yu, k, at, across, mean, shear, out, to):
    """Nodal forces of elements whose stress-free shape is a turned and slightly bent rectangle.

    As `forces_of_strip`; further rows of k are 2 cos, 2 sin of the angle by which an element stands turned [1], and 4
    times the stress-free amplitudes of the pattern along x, along y and in turned axes [m].
    """
    for j in range(count):
        px, qx, rx = w[xl + uintp(1) + j] - w[xl + j], w[xu + uintp(1) + j] - w[xu + j], w[xu + j] - w[xl + j]
        py, qy, ry = w[yl + uintp(1) + j] - w[yl + j], w[yu + uintp(1) + j] - w[yu + j], w[yu + j] - w[yl + j]
        hx, hy = qx - px, qy - py
        along, end, side = k[at + j], k[at + uintp(ROW) + j], k[at + uintp(2 * ROW) + j]
        g11, g21 = along * (px + qx), along * (py + qy)
        g12, g22 = across * (2.0 * rx + hx), across * (2.0 * ry + hy)
        a, b = k[at + uintp(5 * ROW) + j] + (g11 + g22), k[at + uintp(6 * ROW) + j] + (g21 - g12)
        q = 1.0 / np.sqrt(a * a + b * b)
        c, s = a * q, b * q
        pressure = mean - 2.0 * mean * q
        pa, pb, pd, ps = pressure * a, pressure * b, shear * (g11 - g22), shear * (g21 + g12)
        hx, hy = hx + k[at + uintp(7 * ROW) + j], hy + k[at + uintp(8 * ROW) + j]
        tx, ty = c * hx + s * hy, c * hy - s * hx
        tx0, ty0 = k[at + uintp(9 * ROW) + j], k[at + uintp(10 * ROW) + j]
        bx, by = k[at + uintp(3 * ROW) + j] * (tx - tx0), k[at + uintp(4 * ROW) + j] * (ty - ty0)
        moment = (bx * ty - by * tx) * q
        mc, ms = moment * c, moment * s
        ax, ay = end * (pa + pd) - ms * along, end * (ps + pb) + mc * along
        cx, cy = side * (ps - pb) - mc * across, side * (pa - pd) - ms * across
        spread(to + j, c * bx - s * by, s * bx + c * by, ax, ay, cx, cy, out)


@njit(**INLINED)
def elastic(plan, w, out):
    """Nodal forces of all elements at the displacements w, those of common nodes put together on the layer's line."""
    size = plan.size
    k, mean, shear = plan.factors, plan.mean, plan.shear
    for strip in range(len(plan.strips)):
        low, up, count = uintp(plan.strips[strip, 0]), uintp(plan.strips[strip, 1]), uintp(plan.strips[strip, 2])
        yl, yu, across = low + uintp(size), up + uintp(size), plan.across[strip]
        at, to = uintp(strip * FACTORS * ROW), uintp(strip * FORCES * ROW)
        if plan.turned[strip]:
            forces_of_turned_strip(count, w, low, yl, up, yu, k, at, across, mean, shear, out, to)
        else:
            forces_of_strip(count, w, low, yl, up, yu, k, at, across, mean, shear, out, to)
    below, above = plan.joint[0] * FORCES * ROW, plan.joint[1] * FORCES * ROW
    for stretch in range(len(plan.shared)):
        layer, beam, count = plan.shared[stretch, 0], plan.shared[stretch, 1], plan.shared[stretch, 2]
        for row in (0, 2):
            mine, other = uintp(above + row * ROW + layer), uintp(below + (row + 4) * ROW + beam)
            for j in range(uintp(count)):
                out[mine + j] += out[other + j] + out[other + uintp(ROW) + j]


@njit(**VECTOR)
def advance_outer_line(count, at, forces, row, w, v, inverse_mass, keep, gain, ahead, back):
    """Step the nodes, from `at` on, of a line that has elements on one side, whose forces begin at `row`."""
    for j in range(count):
        old = v[at + j]
        new = keep * old - gain * inverse_mass[at + j] * (forces[row + j] + forces[row + uintp(ROW) + j])
        v[at + j] = new
        w[at + j] += ahead * new - back * old


@njit(**VECTOR)
def advance_inner_line(count, at, forces, below, above, w, v, inverse_mass, keep, gain, ahead, back):
    """Step the nodes of a line that has elements on both sides."""
    for j in range(count):
        old = v[at + j]
        force = forces[below + j] + forces[below + uintp(ROW) + j] + forces[above + j] + forces[above + uintp(ROW) + j]
        new = keep * old - gain * inverse_mass[at + j] * force
        v[at + j] = new
        w[at + j] += ahead * new - back * old


@njit(**INLINED)
def advance_nodes(plan, state):
    """Step all nodes by the elements' forces and by alpha."""
    half = 0.5 * plan.alpha * plan.step
    keep, gain = (1.0 - half) / (1.0 + half), plan.step / (1.0 + half)
    ahead, back = plan.step + plan.beta, plan.beta
    w, v, mass, forces = state.w, state.v, plan.inverse_mass, state.elastic
    for k in range(len(plan.lines)):
        first, count, below, above = plan.lines[k, 0], plan.lines[k, 1], plan.lines[k, 2], plan.lines[k, 3]
        for component in range(2):
            at = uintp(first + component * plan.size)
            lower = uintp((below * FORCES + 4 + 2 * component) * ROW)
            upper = uintp((above * FORCES + 2 * component) * ROW)
            if below >= 0 and above >= 0:
                advance_inner_line(uintp(count), at, forces, lower, upper, w, v, mass, keep, gain, ahead, back)
            else:
                row = upper if above >= 0 else lower
                advance_outer_line(uintp(count), at, forces, row, w, v, mass, keep, gain, ahead, back)


@njit(**INLINED)
def find_contact(plan, state):
    """Note the pairs that are closed at this step, with clearance and its rate.

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
def gather_mobility(plan, state, closed):
    """Add up, for each closed pair, by how much its own push and equal ones of all the others would part it  [1/kg].

    Pairs that share a master push it together. A damper that reckons with this is stable for any damping, whatever the
    others' pushes turn out to be: the row sums bound the matrix of the mobilities from above.
    """
    inverse, crowd = plan.inverse_mass, state.crowd
    for k in range(closed):
        if state.gap[k] < 0.0:
            i = state.active[k]
            crowd[plan.master[i]] += 1.0 - plan.weight[i]
            crowd[plan.following[i]] += plan.weight[i]
    for k in range(closed):
        i = state.active[k]
        s, m, n, weight = plan.slave[i], plan.master[i], plan.following[i], plan.weight[i]
        state.mobility[k] = inverse[s] + (1.0 - weight) * inverse[m] * crowd[m] + weight * inverse[n] * crowd[n]
    for k in range(closed):
        i = state.active[k]
        crowd[plan.master[i]] = crowd[plan.following[i]] = 0.0


@njit(**INLINED)
def push_apart(plan, state, closed):
    """Step the nodes of closed pairs by their contact forces.

    The damping sees the mean of the velocities before the step and after it, these as if the other closed pairs pushed
    as much (see `gather_mobility`): exact for a pair alone and for a common push. `lagged`: the velocity before.
    """
    w, v = state.w, state.v
    gain = plan.step / (1.0 + 0.5 * plan.alpha * plan.step)
    ahead = plan.step + plan.beta
    if not plan.lagged:
        gather_mobility(plan, state, closed)
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
                more += slots.contact(plan.contact[law], plan.place[i], gap, before, pressure, plan.contact_p[law])
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
def push_by_laws(plan, state, time):
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
                    acceleration += slots.force(plan.force[law], time, x, state.v[j], plan.force_p[law], none, none)
            state.v[j] += gain * acceleration
            state.w[j] += ahead * gain * acceleration


@njit(**INLINED)
def step(plan, state, time, drive):
    """Go on by one step, at whose end the driven node stands at `drive` [m].

    Returns
    -------
    closed, nearest : see `find_contact`; nearest is infinite where contact was not looked for
    """
    closed, nearest = 0, np.inf
    if state.count[0] >= state.count[1]:
        closed, nearest = find_contact(plan, state)
        if not closed and nearest > 2.0 * AROUND * plan.step * plan.limit:
            state.count[1] = state.count[0] + AROUND
    elastic(plan, state.w, state.elastic)
    driven = plan.driven
    before = state.w[driven] - plan.beta * state.v[driven]
    advance_nodes(plan, state)
    if plan.counts[0] > 0:
        push_by_laws(plan, state, time)
    state.v[driven] = (drive - before) / plan.step
    state.w[driven] = drive + plan.beta * state.v[driven]
    if closed:
        push_apart(plan, state, closed)
    layer, beam = plan.lines[plan.joint[2], 0], plan.lines[plan.joint[2] - 1, 0]
    for k in range(len(plan.shared)):
        for component in range(2):
            source = component * plan.size + layer + plan.shared[k, 0]
            copy = component * plan.size + beam + plan.shared[k, 1]
            for j in range(plan.shared[k, 2]):
                state.w[copy + j] = state.w[source + j]
                state.v[copy + j] = state.v[source + j]
    state.count[0] += 1
    return closed, nearest


@njit(**INLINED)
def note_contact(plan, state, closed, seen):
    """Note what the contact forces of this step did; return their sum  [N]."""
    force, anywhere, count = 0.0, False, state.count[0]
    for k in range(closed):
        force += state.push[k]
        if state.gap[k] >= 0.0:  # a law acts at a distance
            continue
        i = state.active[k]
        seen.closed[i] += 1
        seen.total[4] = max(seen.total[4], -state.gap[k])
        if not anywhere and count - state.count[2] > plan.merged:
            note_impact(count, -state.rate[k], seen.impacts, seen.total, 0)
        anywhere = True
        if i == plan.centre:
            if count - state.count[3] > plan.merged:
                note_impact(count, -state.rate[k], seen.central, seen.total, 1)
            state.count[3] = count
    if anywhere:
        state.count[2] = count
        seen.total[2] += 1
    seen.total[3] = max(seen.total[3], force)
    return force


@njit(**COMPILED)
def advance(plan, state, time, drive, seen):
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
            impulse += plan.step * note_contact(plan, state, closed, seen)
        if len(seen.nearest):
            state.count[1] = 0
            note_pass(closed, nearest, seen)
        while sample < len(seen.at) and seen.at[sample] == n:
            theta = seen.shift[sample]
            for k, node in enumerate((driven, slave)):
                mean, change = 0.5 * (old[2 * k + 1] + state.v[node]), state.v[node] - old[2 * k + 1]
                seen.samples[sample, k] = old[2 * k] + plan.step * theta * (mean + 0.5 * theta * change)
                seen.samples[sample, 2 + k] = mean + theta * change
            seen.samples[sample, 4] = impulse
            impulse = 0.0
            sample += 1
        if state.count[0] % WATCH == 0 and not np.max(np.abs(state.v)) < plan.limit:
            return UNSTABLE
    return DONE


@njit(**COMPILED)
def power(plan, elastic, velocity):
    """Power of the elements' nodal forces at the velocities (2 * size,): of free nodes, and of the driven one  [W]."""
    free, driven = 0.0, 0.0
    for k in range(len(plan.lines)):
        first, count, below, above = plan.lines[k]
        for component in range(2):
            row = 2 * component * ROW
            for j in range(count):
                node = first + component * plan.size + j
                force = 0.0
                if above >= 0:
                    upper = above * FORCES * ROW + row + j
                    force += elastic[upper] + elastic[upper + ROW]
                if below >= 0:
                    lower = (below * FORCES + 4) * ROW + row + j
                    force += elastic[lower] + elastic[lower + ROW]
                if node == plan.driven:
                    driven += force * velocity[node]
                elif plan.inverse_mass[node] > 0.0:
                    free += force * velocity[node]
    return free, driven


@njit(**COMPILED)
def audit(plan, state, time, drive, energy):
    """As `advance`, noting the energies on the way instead of the motion; several times slower.

    Parameters
    ----------
    energy : (6,) work of the drive; lost to alpha, to beta, in contact; kinetic energy of the free nodes at the first
        step and at the last, of the velocities before and after it; written  [J]. What force laws do is not told
    """
    other = np.zeros_like(state.elastic)
    energy[:] = 0.0
    for n in range(len(drive)):
        old = state.v.copy()
        u = state.w - plan.beta * old
        elastic(plan, u, other)
        closed, _ = step(plan, state, time + n * plan.step, drive[n])
        mean = 0.5 * (old + state.v)
        free, driven = power(plan, other, mean)
        damped, _ = power(plan, state.elastic, mean)
        energy[0] += plan.step * driven
        energy[2] += plan.step * (damped - free)
        kinetic, alpha = 0.0, 0.0
        for k in range(len(mean)):
            if plan.inverse_mass[k] > 0.0:
                mass = 1.0 / plan.inverse_mass[k]
                kinetic += 0.5 * mass * old[k] * state.v[k]
                alpha += mass * mean[k] ** 2
        energy[1] += plan.step * plan.alpha * alpha
        for k in range(closed):
            i = state.active[k]
            s, m, f, weight = plan.slave[i], plan.master[i], plan.following[i], plan.weight[i]
            rate = mean[s] - (1.0 - weight) * mean[m] - weight * mean[f]
            energy[3] -= plan.step * state.push[k] * rate
            if m == plan.driven:
                energy[0] += plan.step * state.push[k] * (1.0 - weight) * mean[m]
            if f == plan.driven:
                energy[0] += plan.step * state.push[k] * weight * mean[f]
        if n == 0:
            energy[4] = kinetic
        energy[5] = kinetic
