"""Loads over a step as polynomials: tabulated input, laws of the excitation, force laws.

The linear part of the motion stays exact. What depends on the motion is collocated at the five Gauss-Lobatto nodes of
the step and iterated to its fixed point: order 8 at the ends of steps (a step that an impact ends is taken anew up to
the impact), order 5 for velocities within them. Where the iteration does not converge, laws that are steep in the
velocity, and their internal states, are solved for. A law that jumps reduces the order to that of its jump. Where a
polynomial through the nodes misses the force laws between them (a kink, a steep film of air), the step is halved down
to a limit. It is halved on where internal states of force laws do not converge, not even where they are solved for, or
where the polynomial misses the laws of the excitation: there a longer step would be wrong at any limit.
"""

import math

import numpy as np
from numba import njit

from calib.modelling.laws import STATES
from calib.simulators.compilation import ENCLOSED, ENCLOSED_INLINED, WITHIN
from calib.simulators.impact.collocated_states import (
    hold_states,
    integrate_states,
    solve_states,
)
from calib.simulators.impact.collocated_sums import (
    differentiate_laws,
    extrapolate_sums,
    set_couplings,
    solve_sums,
)
from calib.simulators.impact.coordinates import modal_row, to_coordinates
from calib.simulators.impact.flow import impulse_response, load_responses
from calib.simulators.impact.input_polynomial import set_input
from calib.simulators.impact.kinds import by_stop
from calib.simulators.impact.polynomial import BETWEEN, FIT, POINTS, PROBE_INDEX, polynomial, slope
from calib.simulators.impact.problem import (
    AT_PERIOD,
    COMPRESSION,
    CONTACT,
    FORCE_LAWS,
    FREE,
    LAW_STATES,
    PORT_LAWS,
    REGIME,
    ImpactState,
    Problem,
    Regimes,
)
from calib.simulators.impact.scratch import POSITION, SOLVED, SUM, VELOCITY, Scratch
from calib.simulators.impact.series import expand_contact, motion_within
from calib.simulators.law_calls import force

MAX_SWEEPS = 15  # of the fixed point
MAX_LOAD_CONTRACTION = 0.5  # change of the loads over that two sweeps before; above it so many sweeps do not suffice
LOAD_TOLERANCE = 1e-13  # relative change of the loads at which the iteration has converged
# error of a polynomial between the nodes, as a change of velocity over the step and a share of the velocities; laws on
# bodies that are not solved for are mostly smooth: their loads are accurate at the ends of steps before in between
MAX_ERROR_OF_STEEP, MAX_ERROR_OF_SMOOTH = 1e-8, 1e-7
# of the longest step: over longer ones laws without states are solved for only where that served the last step, for
# mostly the polynomials do not hold over them either
MAX_SOLVED_FRACTION = 1.0 / 16.0
MAX_ROUNDING_CHANGE = 1e-6  # relative change of the loads that rounding within a law of several states may leave  [1]
NEGLIGIBLE_CHANGE = 1e-15  # change of velocity over the step, as a share of the velocities, that counts as zero
LOADS_HOLD, MISSED_BETWEEN, NOT_CONVERGED = 0, 1, 2  # outcomes of `collocate`


@njit(**ENCLOSED)
def _set_base(regimes: Regimes, r: int, step: float, w: Scratch) -> None:
    """Write the modal load of the input and of the constants."""
    u, base = w.input, w.base
    for i in range(w.y.size):
        a, b, c = regimes.load_input[r, i, 0], regimes.load_input[r, i, 1], regimes.load_input[r, i, 2]
        for k in range(5):
            base[i, k] = a * u[k]
            if k < 4:
                base[i, k] += b * (k + 1) * u[k + 1] / step
            if k < 3:
                base[i, k] += c * (k + 2) * (k + 1) * u[k + 2] / (step * step)
        base[i, 0] += regimes.load_constant[r, i]
        for k in range(5):
            w.load[i, k] = base[i, k]


@njit(**ENCLOSED)
def _set_responses(
    problem: Problem, r: int, state: ImpactState, time: float, step: float, first: int, end: int, w: Scratch
) -> None:
    """Write, at some of the points, the motion without loads, and the modal motion per unit of each of their terms."""
    regimes, n, y, v = problem.regimes, w.q.size, state.y, state.v
    for j in range(first, end):
        x = POINTS[j]
        tau = x * step
        scale = tau * tau
        for i in range(n):
            stiffness, rate = regimes.stiffness[r, i], regimes.rate[r, i]
            s, c = impulse_response(stiffness, rate, tau)
            w.y[i] = (c + 2.0 * rate * s) * y[i] + s * v[i]
            w.v[i] = c * v[i] - stiffness * s * y[i]
            q4, q3, q2, q1, q0, impulse = load_responses(stiffness, rate, tau)
            w.response_y[i, j, 0] = scale * q0
            w.response_y[i, j, 1] = scale * x * q1
            w.response_y[i, j, 2] = scale * x**2 * 2.0 * q2
            w.response_y[i, j, 3] = scale * x**3 * 6.0 * q3
            w.response_y[i, j, 4] = scale * x**4 * 24.0 * q4
            w.response_v[i, j, 0] = tau * impulse
            w.response_v[i, j, 1] = tau * x * q0
            w.response_v[i, j, 2] = tau * x**2 * 2.0 * q1
            w.response_v[i, j, 3] = tau * x**3 * 6.0 * q2
            w.response_v[i, j, 4] = tau * x**4 * 24.0 * q3
        u, du = polynomial(w.input, x), slope(w.input, x) / step
        to_coordinates(regimes, r, w.y, w.v, problem.omega, time + tau, u, du, w.q, w.dq)
        for b in range(n):
            w.free_q[b, j], w.free_dq[b, j] = w.q[b], w.dq[b]
        if problem.counts[PORT_LAWS] > 0:
            w.free_q[n, j], w.free_dq[n, j] = _clearance(problem, r, w.y, w.v, time + tau, u, du)


@njit(**ENCLOSED)
def set_given_loads(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> None:
    """Write what the input makes of the loads and of the clearance over a step out of a rigid contact, without laws."""
    for b in range(w.law.shape[0]):
        for j in range(5):
            w.law[b, j] = 0.0
    set_input(problem, state, time, step, w)
    _set_base(problem.regimes, FREE, step, w)
    _set_added(problem, FREE, step, w)


@njit(**ENCLOSED)
def _clear_responses(w: Scratch) -> None:
    """Let the loads make nothing of the motion: in a compliant contact its series hold them already."""
    for i in range(w.y.size):
        for j in range(PROBE_INDEX + 1):
            for k in range(5):
                w.response_y[i, j, k] = 0.0
                w.response_v[i, j, k] = 0.0


@njit(**ENCLOSED)
def _set_motion_in_contact(
    problem: Problem, state: ImpactState, time: float, step: float, first: int, end: int, w: Scratch
) -> None:
    """Write, at some of the points, the motion in a compliant contact from its series."""
    for j in range(first, end):
        x = POINTS[j]
        motion_within(problem.compliance, state, w, step, x * step, w.y, w.v)
        u, du = polynomial(w.input, x), slope(w.input, x) / step
        to_coordinates(problem.regimes, FREE, w.y, w.v, problem.omega, time + x * step, u, du, w.q, w.dq)
        for b in range(w.q.size):
            w.free_q[b, j], w.free_dq[b, j] = w.q[b], w.dq[b]
        if problem.counts[PORT_LAWS] > 0:
            place = _clearance(problem, FREE, w.y, w.v, time + x * step, u, du)
            w.free_q[w.q.size, j], w.free_dq[w.q.size, j] = place


@njit(**ENCLOSED)
def _respond_in_compliance(
    problem: Problem, r: int, state: ImpactState, time: float, step: float, first: int, end: int, w: Scratch
) -> None:
    if state.counters[REGIME] < COMPRESSION:
        _set_responses(problem, r, state, time, step, first, end, w)
        return
    if first == 0:
        set_given_loads(problem, state, time, step, w)
        _clear_responses(w)
    _set_motion_in_contact(problem, state, time, step, first, end, w)


def _need_not_follow(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> None:
    """Let the motion follow its loads, where `_laws_at` does not do that."""


def _follow_in_compliance(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> None:
    if state.counters[REGIME] >= COMPRESSION:
        expand_contact(problem, state, time, step, w)
        _set_motion_in_contact(problem, state, time, step, 0, PROBE_INDEX, w)


_respond = by_stop(_set_responses, _respond_in_compliance, ENCLOSED_INLINED)
_follow = by_stop(_need_not_follow, _follow_in_compliance, ENCLOSED_INLINED)


@njit(**ENCLOSED_INLINED)
def _sum_at(problem: Problem, b: int, t: float, x: float, v: float, j: int, w: Scratch) -> float:
    """Sum of the force laws at the coordinate `b` (or the port), which moves by x, v; their rates are written."""
    total = 0.0
    z, dz = w.law_state[0], w.law_state[1]
    for i in range(problem.counts[FORCE_LAWS]):
        if problem.acts[i, b]:
            for k in range(STATES):
                z[k] = w.z[i, b, k, j]
                dz[k] = 0.0
            total += force(problem.force[i], t, x, v, problem.force_p[i], z, dz)
            for k in range(STATES):
                w.dz[i, b, k, j] = dz[k]
    w.place[SUM, b, j] = total
    return total


@njit(**ENCLOSED)
def _clearance(
    problem: Problem, r: int, y: np.ndarray, v: np.ndarray, time: float, u: float, du: float
) -> tuple[float, float]:
    """Clearance [m] and its rate [m/s] at `time` since the whole period; both zero in contact."""
    if r == CONTACT:
        return 0.0, 0.0
    regimes, omega = problem.regimes, problem.omega
    c, s = math.cos(omega * time), math.sin(omega * time)
    wc, ws = regimes.witness[r, 0], regimes.witness[r, 1]
    value = wc * c + ws * s + regimes.witness[r, 2] + regimes.witness_input[r, 0] * u
    rate = omega * (ws * c - wc * s) + regimes.witness_input[r, 0] * du
    for i in range(y.size):
        value += regimes.witness_y[r, i] * y[i]
        rate += regimes.witness_y[r, i] * v[i]
    return value, rate


@njit(**ENCLOSED_INLINED)
def _move_places(problem: Problem, r: int, j: int, w: Scratch) -> None:
    """Write the motion of the coordinates and of the clearance at point `j`."""
    regimes, n = problem.regimes, w.q.size
    for i in range(n):
        y, v = 0.0, 0.0
        for k in range(5):
            y += w.response_y[i, j, k] * w.load[i, k]
            v += w.response_v[i, j, k] * w.load[i, k]
        w.y[i], w.v[i] = y, v
    for b in range(n):
        q, dq = w.free_q[b, j], w.free_dq[b, j]
        for i in range(n):
            q += regimes.shape[r, b, i] * w.y[i]
            dq += regimes.shape[r, b, i] * w.v[i]
        w.place[POSITION, b, j], w.place[VELOCITY, b, j] = q, dq
    if problem.counts[PORT_LAWS] > 0:
        clearance, rate = w.free_q[n, j], w.free_dq[n, j]
        if r != CONTACT:
            for i in range(n):
                clearance += regimes.witness_y[r, i] * w.y[i]
                rate += regimes.witness_y[r, i] * w.v[i]
        w.place[POSITION, n, j], w.place[VELOCITY, n, j] = clearance, rate


@njit(**ENCLOSED_INLINED)
def _laws_at(problem: Problem, r: int, start: float, step: float, j: int, w: Scratch) -> None:
    """Write the accelerations by the laws and the rates of their internal states at point `j`."""
    n, t = w.q.size, start + POINTS[j] * step
    _move_places(problem, r, j, w)
    for b in range(n):
        w.law[b, j] = _sum_at(problem, b, t, w.place[POSITION, b, j], w.place[VELOCITY, b, j], j, w)
    if problem.counts[PORT_LAWS] > 0:
        opening = _sum_at(problem, n, t, w.place[POSITION, n, j], w.place[VELOCITY, n, j], j, w)
        for b in range(n):
            w.law[b, j] += problem.push[b] * opening


@njit(**ENCLOSED_INLINED)
def _refit(regimes: Regimes, r: int, w: Scratch) -> tuple[float, float]:
    """Write the load's coefficients from the laws at the nodes; return its largest change and its size."""
    change, size = 0.0, 0.0
    for i in range(w.y.size):
        for j in range(5):
            f = 0.0
            for b in range(w.q.size):
                f += regimes.project[r, i, b] * w.law[b, j]
            change = max(change, abs(f - w.modal[i, j]))
            size = max(size, abs(f))
            w.modal[i, j] = f
        for k in range(5):
            f = w.base[i, k]
            for j in range(5):
                f += FIT[k, j] * w.modal[i, j]
            w.load[i, k] = f
    return change, size


@njit(**ENCLOSED)
def _set_added(problem: Problem, r: int, step: float, w: Scratch) -> None:
    """Write what the input and the laws add to the witness over the step (5,)."""
    u, added, regimes = w.input, w.added, problem.regimes
    a, b, c = regimes.witness_input[r, 0], regimes.witness_input[r, 1], regimes.witness_input[r, 2]
    for k in range(5):
        added[k] = a * u[k]
        if k < 4:
            added[k] += b * (k + 1) * u[k + 1] / step
        if k < 3:
            added[k] += c * (k + 2) * (k + 1) * u[k + 2] / (step * step)
        if problem.counts[FORCE_LAWS] > 0:
            for j in range(5):
                for body in range(w.q.size):
                    added[k] += FIT[k, j] * regimes.witness_law[r, body] * w.law[body, j]


@njit(**WITHIN)
def _modal_speed(regimes: Regimes, r: int, y: np.ndarray, v: np.ndarray) -> float:
    """Largest modal velocity that the motion may have, from its energy  [kg^1/2 m/s]."""
    speed = 0.0
    for i in range(y.size):
        speed = max(speed, v[i] * v[i] + abs(regimes.stiffness[r, i]) * y[i] * y[i])
    return math.sqrt(speed)


@njit(**ENCLOSED)
def _repeat_first(w: Scratch) -> None:
    """Let the laws and the rates of their states keep their value at the first node: the first guess."""
    for b in range(w.law.shape[0]):
        for j in range(5):
            w.law[b, j] = w.law[b, 0]
            w.modal[b, j] = 0.0
    for i in range(w.dz.shape[0]):
        for b in range(w.dz.shape[1]):
            for k in range(w.dz.shape[2]):
                for j in range(5):
                    w.dz[i, b, k, j] = w.dz[i, b, k, 0]


@njit(**ENCLOSED_INLINED)
def _is_resolved(
    problem: Problem, r: int, state: ImpactState, start: float, step: float, speed: float, steep: bool, w: Scratch
) -> bool:
    """Whether the polynomials through the nodes hold between them: of the laws, and of the rates of their states.

    steep : whether the laws had to be solved for
    """
    if problem.counts[LAW_STATES] > 0:
        integrate_states(problem, state.z, step, PROBE_INDEX, PROBE_INDEX + 1, w)
    _laws_at(problem, r, start, step, PROBE_INDEX, w)
    share = MAX_ERROR_OF_STEEP if steep or problem.counts[PORT_LAWS] > 0 else MAX_ERROR_OF_SMOOTH
    for b in range(w.q.size):
        for j in range(5):
            w.law[b, PROBE_INDEX] -= BETWEEN[j] * w.law[b, j]
    for i in range(w.y.size):
        error = 0.0
        for b in range(w.q.size):
            error += problem.regimes.project[r, i, b] * w.law[b, PROBE_INDEX]
        if abs(error) * step > share * speed:
            return False
    if problem.counts[LAW_STATES] > 0:
        for i in range(problem.counts[FORCE_LAWS]):
            for b in range(w.dz.shape[1]):
                for k in range(STATES):
                    error, size = w.dz[i, b, k, PROBE_INDEX], 0.0
                    for j in range(5):
                        error -= BETWEEN[j] * w.dz[i, b, k, j]
                        size = max(size, abs(w.z[i, b, k, j]))
                    if abs(error) * step > share * size:
                        return False
    return True


@njit(**ENCLOSED)
def _iterate(
    problem: Problem, r: int, state: ImpactState, time: float, step: float, speed: float, stiff: bool, w: Scratch
) -> tuple[bool, bool]:
    """Iterate the loads by the force laws over a step, from none, to their fixed point.

    stiff : whether the sums of the laws are solved for with their derivatives by the velocities, and the internal
        states with those of their rates
    -> whether they converge, and whether their last change is one that rounding may leave
    """
    start = state.counters[AT_PERIOD] * problem.period + time
    for i in range(w.y.size):
        for k in range(5):
            w.load[i, k] = w.base[i, k]
    if problem.counts[LAW_STATES] > 0:
        hold_states(state.z, w)
    if stiff:
        set_couplings(problem, r, w)
    held, before, earlier, change, size = False, math.inf, math.inf, math.inf, 0.0
    for sweep in range(MAX_SWEEPS):
        _follow(problem, state, time, step, w)
        for j in range(5):
            if (j == 0) == (sweep == 0):  # the first node does not change
                _laws_at(problem, r, start, step, j, w)
                if stiff:
                    differentiate_laws(problem, start, step, j, w)
        if sweep == 0:
            _repeat_first(w)
        if stiff:
            if sweep == 0:
                _refit(problem.regimes, r, w)
                for j in range(1, 5):
                    _move_places(problem, r, j, w)
                extrapolate_sums(w.place)
            solve_sums(problem.push, w.place, w.coupling, w.equations, w.law)
        change, size = _refit(problem.regimes, r, w)
        if stiff and sweep > 0:
            solve_states(problem, state.z, step, w)
        elif problem.counts[LAW_STATES] > 0 and not stiff:
            integrate_states(problem, state.z, step, 0, PROBE_INDEX, w)
        close = sweep > 0 and (change <= LOAD_TOLERANCE * size or change * step <= NEGLIGIBLE_CHANGE * speed)
        # the loads follow internal states one sweep late, so with those they have to hold twice
        if close and (problem.counts[LAW_STATES] == 0 or held):
            return True, True
        held = close
        if sweep > 2 and not close and change > MAX_LOAD_CONTRACTION * earlier:
            break
        before, earlier = change, before
    return False, change <= MAX_ROUNDING_CHANGE * size


@njit(**ENCLOSED_INLINED)
def _collocate_force_laws(problem: Problem, r: int, state: ImpactState, time: float, step: float, w: Scratch) -> int:
    """Work out the loads by the force laws over a step; the outcome as of `collocate`."""
    _respond(problem, r, state, time, step, 0, PROBE_INDEX, w)
    speed = _modal_speed(problem.regimes, r, state.y, state.v)
    converged, rounded = _iterate(problem, r, state, time, step, speed, False, w)
    short = step <= MAX_SOLVED_FRACTION * problem.step or w.resolved_step[SOLVED] > 0.0
    solved = not converged and problem.exact and (short or problem.counts[LAW_STATES] > 0)
    if solved:
        close = rounded or problem.counts[LAW_STATES] == 0
        converged, rounded = _iterate(problem, r, state, time, step, speed, True, w)
        if close and not (converged or rounded):  # back to what was as good as converged, or may not converge at all
            converged, rounded = _iterate(problem, r, state, time, step, speed, False, w)
    if not converged:
        return MISSED_BETWEEN if rounded or problem.counts[LAW_STATES] == 0 else NOT_CONVERGED
    if not problem.exact:
        return LOADS_HOLD
    start = state.counters[AT_PERIOD] * problem.period + time
    _respond(problem, r, state, time, step, PROBE_INDEX, PROBE_INDEX + 1, w)
    if not _is_resolved(problem, r, state, start, step, speed, solved, w):
        return MISSED_BETWEEN
    w.resolved_step[SOLVED] = 1.0 if solved else 0.0
    return LOADS_HOLD


@njit(**ENCLOSED)
def collocate(problem: Problem, r: int, state: ImpactState, time: float, step: float, w: Scratch) -> int:
    """Work out all loads over a step from `time` [s] since the whole period.

    Returns
    -------
    outcome : LOADS_HOLD; MISSED_BETWEEN, where the polynomials miss force laws between the nodes, or force laws without
        internal states do not converge; NOT_CONVERGED, where the loads are wrong
    """
    r = modal_row(r)
    resolved = set_input(problem, state, time, step, w)
    _set_base(problem.regimes, r, step, w)
    outcome = LOADS_HOLD
    if problem.exact and not resolved:
        outcome = NOT_CONVERGED
    elif problem.counts[FORCE_LAWS] > 0:
        outcome = _collocate_force_laws(problem, r, state, time, step, w)
    _set_added(problem, r, step, w)
    return outcome
