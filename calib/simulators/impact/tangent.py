"""Small differences carried along a motion: exact between events, by saltation at them.

A difference meets an event earlier or later than the motion does, by dt = -(dW) / (dW/dt) with the witness W of the
regime that ends. With the reset x+ = g(x-, t) and the rates f- and f+ of the state before and after,

    dx+ = g_x dx- + (g_x f- + g_t - f+) dt

(Mueller, Chaos, Solitons & Fractals 5 (1995) 1671; Leine and Nijmeijer, Dynamics and Bifurcations of Non-Smooth
Mechanical Systems, 2004). Force laws depend on the motion and have no place here.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import COMPILED, ENCLOSED, ENCLOSED_INLINED, WITHIN
from calib.simulators.impact.coordinates import modal_row
from calib.simulators.impact.events import coefficient
from calib.simulators.impact.flow import impulse_response
from calib.simulators.impact.kernel import DIVERGED, DONE, SPENT, within, write_row
from calib.simulators.impact.kinds import by_stop
from calib.simulators.impact.polynomial import polynomial, slope
from calib.simulators.impact.problem import (
    CLOSING,
    COMPRESSION,
    CONTACT,
    FREE,
    REGIME,
    RESTITUTION_LAWS,
    STEPS,
    ImpactState,
    Problem,
    Regimes,
)
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.series import carry_differences
from calib.simulators.impact.step import complete_step, next_step
from calib.simulators.impact.witness import EVENT, FAILED, witness

MAX_ROUNDING_SHARE = 1e-13  # of the largest difference: what rounding leaves of one that a contact reduces to zero
RELATIVE_SPEED_STEP = 1e-5  # relative step for the slope of a law of restitution


@njit(**WITHIN)
def _flow_differences(regimes: Regimes, r: int, tau: float, dy: np.ndarray, dv: np.ndarray) -> None:
    """Carry dy, dv (n, m) on by `tau` [s] within regime `r`: no load depends on the motion."""
    for i in range(dy.shape[0]):
        stiffness, rate = regimes.stiffness[r, i], regimes.rate[r, i]
        s, c = impulse_response(stiffness, rate, tau)
        for k in range(dy.shape[1]):
            y, v = dy[i, k], dv[i, k]
            dy[i, k] = (c + 2.0 * rate * s) * y + s * v
            dv[i, k] = c * v - stiffness * s * y


@njit(**COMPILED)
def _change_regime(regimes: Regimes, r: int, to: int, dy: np.ndarray, dv: np.ndarray) -> None:
    """Express dy, dv (n, m) of regime `r` in the modes of regime `to`."""
    n = dy.shape[0]
    turn = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for b in range(n):
                turn[i, j] += regimes.project[to, i, b] * regimes.shape[r, b, j]
    old_y, old_v = dy.copy(), dv.copy()
    for i in range(n):
        for k in range(dy.shape[1]):
            dy[i, k] = 0.0
            dv[i, k] = 0.0
            for j in range(n):
                dy[i, k] += turn[i, j] * old_y[j, k]
                dv[i, k] += turn[i, j] * old_v[j, k]


@njit(**ENCLOSED)
def _accelerations(
    problem: Problem,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    time: float,
    u: float,
    du: float,
    ddu: float,
    out: np.ndarray,
) -> None:
    """Write q'' (n,) [m/s^2] of the modal motion y, v in regime `r` under the input u, du, ddu."""
    both, w = problem.regimes, problem.omega
    c, s = math.cos(w * time), math.sin(w * time)
    for j in range(out.size):
        out[j] = -w * w * (both.motion[r, j, 0] * c + both.motion[r, j, 1] * s) + both.motion_input[r, j] * ddu
    for i in range(y.size):
        load = both.load_constant[r, i]
        load += both.load_input[r, i, 0] * u + both.load_input[r, i, 1] * du + both.load_input[r, i, 2] * ddu
        a = load - 2.0 * both.rate[r, i] * v[i] - both.stiffness[r, i] * y[i]
        for j in range(out.size):
            out[j] += both.shape[r, j, i] * a


@njit(**ENCLOSED)
def _delays(problem: Problem, r: int, first: float, dy: np.ndarray, dv: np.ndarray, delay: np.ndarray) -> None:
    """Write by how much later [s] each difference meets the end of regime `r`, whose witness falls at `first`."""
    both = problem.regimes
    for k in range(delay.size):
        change = 0.0
        for i in range(dy.shape[0]):
            change += both.witness_y[r, i] * dy[i, k] + both.witness_v[r, i] * dv[i, k]
        delay[k] = -change / first


@njit(**ENCLOSED)
def _rebound(
    problem: Problem,
    v_before: np.ndarray,
    v_after: np.ndarray,
    rate: float,
    second: float,
    dy: np.ndarray,
    dv: np.ndarray,
    delay: np.ndarray,
) -> None:
    """Saltation at an impact that leaves the stop again; `rate`, `second` of the clearance before it."""
    both, n = problem.regimes, dy.shape[0]
    speed = -rate
    steeper = 0.0
    if problem.counts[RESTITUTION_LAWS] > 0:
        step = RELATIVE_SPEED_STEP * speed
        steeper = 0.5 * (coefficient(problem, speed + step) - coefficient(problem, speed - step)) / step
    turned = 1.0 + coefficient(problem, speed) + speed * steeper  # d[(1 + e) rate] / d rate
    for k in range(delay.size):
        closing = second * delay[k]
        for i in range(n):
            closing += both.witness_y[FREE, i] * dv[i, k]
        for i in range(n):
            jump = v_before[i] - v_after[i]
            dy[i, k] += jump * delay[k]
            dv[i, k] -= 2.0 * both.rate[FREE, i] * jump * delay[k]
            for b in range(n):
                dv[i, k] -= turned * both.project[FREE, i, b] * problem.hit[b] * closing


@njit(**COMPILED)
def _stick(
    problem: Problem,
    before: np.ndarray,
    after: np.ndarray,
    second: float,
    dy: np.ndarray,
    dv: np.ndarray,
    delay: np.ndarray,
) -> None:
    """Saltation where the contact begins: the difference in the clearance becomes zero.

    Accelerations are `before` and `after` (n,)  [m/s^2].
    """
    both, n = problem.regimes, dy.shape[0]
    for k in range(delay.size):
        opening, closing = 0.0, second * delay[k]
        for i in range(n):
            opening += both.witness_y[FREE, i] * dy[i, k]
            closing += both.witness_y[FREE, i] * dv[i, k]
        for i in range(n):
            for b in range(n):
                part = both.project[FREE, i, b]
                dy[i, k] -= part * problem.hit[b] * opening
                dv[i, k] += part * ((before[b] - after[b]) * delay[k] - problem.hit[b] * closing)
    _change_regime(both, FREE, CONTACT, dy, dv)


@njit(**COMPILED)
def _release(
    problem: Problem, before: np.ndarray, after: np.ndarray, dy: np.ndarray, dv: np.ndarray, delay: np.ndarray
) -> None:
    """Saltation where the contact ends: the state goes on, its acceleration changes from `before` to `after` (n,)."""
    both, n = problem.regimes, dy.shape[0]
    _change_regime(both, CONTACT, FREE, dy, dv)
    for k in range(delay.size):
        for i in range(n):
            for b in range(n):
                dv[i, k] += both.project[FREE, i, b] * (before[b] - after[b]) * delay[k]


@njit(**COMPILED)
def _cross_rigid_stop(
    problem: Problem,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    state: ImpactState,
    time: float,
    tau: float,
    step: float,
    w: Scratch,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Carry dy, dv (n, m) over the event at `tau` into the step that began at `time`.

    Before the event the modal motion is y, v (n,) in regime `r`; after it, that of the state.
    """
    n, now, loaded = state.y.size, time + tau, problem.loads is not None
    _, first, second, _ = witness(problem.regimes, r, y, v, problem.omega, now, loaded, w.load, w.added, step, tau, 0.0)
    delay = np.zeros(dy.shape[1])
    # a contact that ends as it begins does so at the same instant for all neighbours: it was the impact's instant
    if tau > 0.0 or r == FREE:
        _delays(problem, r, first, dy, dv, delay)
    to = state.counters[REGIME]
    if r == FREE and to == FREE:
        _rebound(problem, v, state.v, first, second, dy, dv, delay)
        return
    u, du, ddu = 0.0, 0.0, 0.0
    if loaded:
        x = tau / step
        u, du = polynomial(w.input, x), slope(w.input, x) / step
        ddu = (2.0 * w.input[2] + x * (6.0 * w.input[3] + x * 12.0 * w.input[4])) / (step * step)
    before, after = np.zeros(n), np.zeros(n)
    _accelerations(problem, r, y, v, now, u, du, ddu, before)
    _accelerations(problem, to, state.y, state.v, now, u, du, ddu, after)
    if r == FREE:
        _stick(problem, before, after, second, dy, dv, delay)
    else:
        _release(problem, before, after, dy, dv, delay)


@njit(**ENCLOSED)
def _loss_slope(problem: Problem, speed: float) -> float:
    """Derivative of the loss factor of a compliant contact by its closing speed  [s^2/m^2]."""
    law = problem.compliance
    return -law.loss / (speed * speed) if law.by_speed and speed > law.slowest else 0.0


@njit(**COMPILED)
def _cross_surface(
    problem: Problem,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    state: ImpactState,
    time: float,
    tau: float,
    step: float,
    w: Scratch,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Saltation where a compliant contact begins: the state goes on, its acceleration jumps by that of the damper.

    At all other events of such a contact the force is zero on both sides, and so is the jump.
    """
    if r != FREE:
        return
    loaded, law, delay = problem.loads is not None, problem.compliance, np.zeros(dspeed.size)
    _, first, second, _ = witness(
        problem.regimes, FREE, y, v, problem.omega, time + tau, loaded, w.load, w.added, step, tau, 0.0
    )
    if first < 0.0:
        _delays(problem, FREE, first, dy, dv, delay)
    for k in range(delay.size):
        dspeed[k] = -second * delay[k]
        for i in range(dy.shape[0]):
            dspeed[k] -= problem.regimes.witness_y[FREE, i] * dv[i, k]
        for i in range(dy.shape[0]):
            dv[i, k] -= law.load[i] * law.damping * state.clock[CLOSING] * delay[k]


def _carry_step_with_rigid_stop(
    problem: Problem,
    r: int,
    state: ImpactState,
    step: float,
    tau: float,
    w: Scratch,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Carry dy, dv (n, m) on by `tau` into a step in regime `r`."""
    _flow_differences(problem.regimes, r, tau, dy, dv)


def _carry_step_with_compliance(
    problem: Problem,
    r: int,
    state: ImpactState,
    step: float,
    tau: float,
    w: Scratch,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    if r == COMPRESSION:
        carry_differences(problem, state, _loss_slope(problem, state.clock[CLOSING]), step, tau, w, dy, dv, dspeed)
    else:
        _flow_differences(problem.regimes, FREE, tau, dy, dv)


_carry_step = by_stop(_carry_step_with_rigid_stop, _carry_step_with_compliance, ENCLOSED_INLINED)
_cross = by_stop(_cross_rigid_stop, _cross_surface, COMPILED)


@njit(**COMPILED)
def _make_orthonormal(vectors: np.ndarray, upper: np.ndarray) -> None:
    """Replace the columns of `vectors` (d, m) by orthonormal ones Q and write R (m, m), vectors = Q R.

    What rounding leaves of a direction that a contact reduces to zero becomes a column of zeros.
    """
    d, m = vectors.shape
    largest = 0.0
    for k in range(m):
        largest = max(largest, math.sqrt((vectors[:, k] ** 2).sum()))
    for k in range(m):
        for _ in range(2):  # once more: Gram and Schmidt lose orthogonality to rounding
            for j in range(k):
                share = 0.0
                for i in range(d):
                    share += vectors[i, j] * vectors[i, k]
                upper[j, k] += share
                for i in range(d):
                    vectors[i, k] -= share * vectors[i, j]
        length = math.sqrt((vectors[:, k] ** 2).sum())
        if length <= MAX_ROUNDING_SHARE * largest:
            length = 0.0
        upper[k, k] = length
        for i in range(d):
            vectors[i, k] = vectors[i, k] / length if length > 0.0 else 0.0


@njit(**WITHIN)
def _to_section(
    regimes: Regimes,
    r: int,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
    scale: np.ndarray,
    vectors: np.ndarray,
) -> None:
    """Write `vectors`, in units of `scale`, of the modal differences dy, dv (n, m), dspeed (m,) in regime `r`."""
    n, free = dy.shape[0], r == FREE
    if vectors.shape[0] > 2 * n:
        for k in range(dspeed.size):
            vectors[2 * n, k] = 0.0 if free else dspeed[k] / scale[2 * n]
    r = modal_row(r)
    for j in range(n):
        for k in range(dy.shape[1]):
            q, dq = 0.0, 0.0
            for i in range(n):
                q += regimes.shape[r, j, i] * dy[i, k]
                dq += regimes.shape[r, j, i] * dv[i, k]
            vectors[j, k] = q / scale[j]
            vectors[n + j, k] = dq / scale[n + j]


@njit(**WITHIN)
def _from_section(
    regimes: Regimes,
    r: int,
    vectors: np.ndarray,
    scale: np.ndarray,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Write dy, dv (n, m), dspeed (m,) of `vectors`: the inverse of `_to_section`."""
    n = dy.shape[0]
    for k in range(dspeed.size):
        dspeed[k] = vectors[2 * n, k] * scale[2 * n] if vectors.shape[0] > 2 * n else 0.0
    r = modal_row(r)
    for i in range(n):
        for k in range(dy.shape[1]):
            dy[i, k] = 0.0
            dv[i, k] = 0.0
            for j in range(n):
                dy[i, k] += regimes.project[r, i, j] * vectors[j, k] * scale[j]
                dv[i, k] += regimes.project[r, i, j] * vectors[n + j, k] * scale[n + j]


@njit(**COMPILED)
def carry(
    problem: Problem,
    state: ImpactState,
    w: Scratch,
    periods: int,
    budget: int,
    scale: np.ndarray,
    sections: np.ndarray,
    vectors: np.ndarray,
    growth: np.ndarray,
) -> tuple[int, int]:
    """Go on by `periods` periods with small differences beside the motion.

    Parameters
    ----------
    problem : Problem without force laws, with located events
    state : State at phase zero, written
    w : Scratch
    periods : periods to go
    budget : steps after which the run is given up
    scale : (2 n,) or (2 n + 1,) in which the differences are measured  [m], [m/s]
    sections : (periods, 2 n + 2) written as in `kernel.advance`; of a problem whose contact remembers its closing speed
        (periods, 2 n + 3) with that speed last, zero out of contact  [m/s]
    vectors : (2 n, m), or with the closing speed (2 n + 1, m), written: in, the differences in units of `scale`; out,
        made orthonormal after the last period
    growth : (periods, m, m) zeros; written: the triangular factors, see `calib.modelling.orbit.Tangent`

    Returns
    -------
    outcome : DONE, DIVERGED or SPENT
    done : periods gone
    """
    n, m = state.y.size, vectors.shape[1]
    regimes, no_impacts = problem.regimes, np.zeros((0, 2 + 2 * n))
    ye, ve = state.y.copy(), state.v.copy()
    dy, dv, dspeed = np.zeros((n, m)), np.zeros((n, m)), np.zeros(m)
    _make_orthonormal(vectors, np.zeros((m, m)))
    _from_section(regimes, state.counters[REGIME], vectors, scale, dy, dv, dspeed)
    done = 0
    while done < periods:
        r, time = state.counters[REGIME], state.clock[0]
        outcome, tau, step = next_step(problem, state, w, ye, ve)
        if outcome == FAILED:
            return DIVERGED, done
        if state.counters[STEPS] > budget:
            return SPENT, done
        if not complete_step(problem, state, outcome, tau, step, no_impacts, w, ye, ve):
            return DIVERGED, done
        _carry_step(problem, r, state, step, tau, w, dy, dv, dspeed)
        if tau >= problem.period - time:
            write_row(problem, r, ye, ve, time, tau, step, w, sections[done])
            if not within(sections[done], n, state.limits):
                return DIVERGED, done
            if vectors.shape[0] > 2 * n:
                sections[done, 2 * n + 2] = state.clock[CLOSING] if r != FREE else 0.0
            _to_section(regimes, r, dy, dv, dspeed, scale, vectors)
            _make_orthonormal(vectors, growth[done])
            _from_section(regimes, r, vectors, scale, dy, dv, dspeed)
            done += 1
        if outcome == EVENT and problem.stop:
            _cross(problem, r, ye, ve, state, time, tau, step, w, dy, dv, dspeed)
    return DONE, done
