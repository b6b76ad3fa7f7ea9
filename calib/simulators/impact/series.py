"""Taylor series of the motion in a compliant contact, whatever its law.

The modes out of contact go on under the contact force, which depends on them through the penetration alone: so each
order costs one number of the force and one of each mode. Coefficients are those of (tau / step)^k. A linear law's
series reaches rounding in steps of 3 over its angular frequency; another law's step is what the series allow. A power
d^n with n > 1 has no series about d = 0: its steps are those of `fictitious_time`, a contact begins with that of
`crossing` where 2 n is not whole, and where it ends the force is so small that its impulse along a path of constant
velocity serves.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED, INLINED, WITHIN
from calib.simulators.impact.convolution import square_term
from calib.simulators.impact.crossing import carry_about_crossing, expand_about_crossing, motion_about_crossing
from calib.simulators.impact.fictitious_time import (
    carry_in_fictitious_time,
    expand_in_fictitious_time,
    motion_in_fictitious_time,
)
from calib.simulators.impact.problem import (
    CLOSING,
    COMPRESSION,
    FREE,
    HIT,
    REGIME,
    TOUCH,
    Compliance,
    ImpactState,
    Problem,
    Regimes,
)
from calib.simulators.impact.scratch import (
    BY_DEPTH,
    BY_LOSS,
    BY_RATE,
    DEPTH,
    FICTITIOUS,
    FORCE,
    KNOWN,
    LAST,
    LATTICE,
    MODES,
    ORDER,
    RATE,
    SERIES,
    SPREAD,
    SPREAD_OF_RATE,
    STIFF,
    TRUNCATION,
    WITNESS,
    Scratch,
)

MAX_SERIES_JUMPS = 10_000  # over a step before its zero is given up
MIN_ORDER = 6  # so that the polynomials of the loads have entered
SMALL_CHANGE = 1e-9  # of velocity, as a share of it, up to which the force next to d = 0 acts as if that were constant
_INVERSE = np.array([1.0 / ((k + 1) * (k + 2)) for k in range(ORDER)])


@njit(**INLINED)
def loss_at(law: Compliance, speed: float) -> float:
    """Loss factor [s/m] in a contact that began at a closing speed [m/s]."""
    return law.loss / max(speed, law.slowest) if law.by_speed else law.loss


@njit(**WITHIN)
def time_of_small_force(law: Compliance, speed: float, acceleration: float) -> float:
    """Time [s] from d = 0 over which d^n makes next to nothing of the velocity; d sets out with these rates."""
    n = law.exponent
    share = SMALL_CHANGE * (n + 1.0) / law.stiffness
    time = math.inf
    if speed > 0.0:
        time = (share / (2.0 * speed) ** (n - 1.0)) ** (1.0 / (n + 1.0))
    if acceleration > 0.0:
        time = min(time, (share / acceleration ** (n - 1.0)) ** (0.5 / n))
    return time


@njit(**ENCLOSED)
def expand(
    regimes: Regimes,
    law: Compliance,
    omega: float,
    loaded: bool,
    load: np.ndarray,
    added: np.ndarray,
    state: ImpactState,
    time: float,
    step: float,
    contact: np.ndarray,
) -> float:
    """Write the series over a step from `time` [s] since the whole period.

    Parameters
    ----------
    loaded, load, added : as of `witness.witness`, with which those of the contact's force add up
    contact : `Scratch.contact`, written

    Returns
    -------
    tail : size of its last terms, as a share of the largest; 0 where it has converged, NaN where it is not finite
    """
    n = state.y.size
    a, depth, rate, force = contact[MODES:], contact[DEPTH], contact[RATE], contact[FORCE]
    pressed = 1.0 if state.counters[REGIME] == COMPRESSION else 0.0
    stiffness = law.stiffness if contact[KNOWN, STIFF] != 0 else 0.0  # of d^n, where that has its part
    loss = loss_at(law, state.clock[CLOSING])
    damping = law.damping
    per_step, square, turn = 1.0 / step, step * step, omega * step
    c, s = math.cos(omega * time), math.sin(omega * time)
    wc, ws = regimes.witness[FREE, 0], regimes.witness[FREE, 1]
    drive, drive_next = wc * c + ws * s, (ws * c - wc * s) * turn  # two terms of the drive's part in the clearance
    clearance, opening, largest = drive + regimes.witness[FREE, 2], drive_next, 0.0
    if loaded:
        clearance += added[0]
        opening += added[1]
    for i in range(n):
        a[i, 0], a[i, 1] = state.y[i], state.v[i] * step
        clearance += regimes.witness_y[FREE, i] * a[i, 0]
        opening += regimes.witness_y[FREE, i] * a[i, 1]
        largest = max(largest, abs(a[i, 1]))
    depth[0], depth[1] = -clearance, -opening
    if state.counters[TOUCH] == HIT and depth[0] < 0.0:
        depth[0] = 0.0  # but for rounding
    deepest = spread = abs(depth[1])
    spread_of_rate = 0.0
    small, order, tail, before = 0, ORDER, 0.0, 0.0
    for k in range(ORDER - 1):
        rate[k] = (k + 1) * per_step * depth[k + 1]
        value = damping * rate[k]
        if stiffness > 0.0:
            value += stiffness * depth[k]
            if loss > 0.0:  # d d' = (d^2)' / 2
                value += 0.5 * stiffness * loss * per_step * (k + 1) * square_term(depth, k)
        force[k] = value
        value *= pressed
        drive, drive_next = drive_next, -turn * turn * _INVERSE[k] * drive
        clearance, term = drive_next, 0.0
        if loaded and k < 3:
            clearance += added[k + 2]
        for i in range(n):
            f = load[i, k] if loaded and k < 5 else 0.0
            still = square * (f - regimes.stiffness[FREE, i] * a[i, k])
            still -= 2.0 * (k + 1) * step * regimes.rate[FREE, i] * a[i, k + 1]
            x = (still + square * law.load[i] * value) * _INVERSE[k]
            a[i, k + 2] = x
            clearance += regimes.witness_y[FREE, i] * still * _INVERSE[k]
            term = max(term, abs(x))
        clearance += square * value * _INVERSE[k]  # a unit of the acceleration is one of the clearance's
        depth[k + 2] = -clearance
        spread += abs(clearance)
        term, deep = term * (k + 2), abs(clearance) * (k + 2)
        spread_of_rate += deep
        largest, deepest = max(largest, term), max(deepest, deep)
        if term <= TRUNCATION * largest and deep <= TRUNCATION * deepest and k + 2 >= MIN_ORDER:
            small += 1
            if small == 2:
                order = k + 2
                break
        else:
            small = 0
            if k >= ORDER - 6:  # a parity of terms may be zero
                before, tail = (
                    tail,
                    max(term / largest if largest > 0.0 else 0.0, deep / deepest if deepest > 0.0 else 0.0),
                )
    for k in range(order - 1, ORDER + 1):
        rate[k], force[k] = 0.0, 0.0
    for k in range(order + 1, ORDER + 1):
        depth[k] = 0.0
    contact[KNOWN, LAST], contact[KNOWN, SPREAD], contact[KNOWN, SPREAD_OF_RATE] = order, spread, spread_of_rate
    if not math.isfinite(largest + deepest + depth[order]):
        return math.nan
    return 0.0 if small == 2 else max(tail, before)


@njit(**ENCLOSED)
def expand_contact(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> tuple[float, float]:
    """Write the series over a step in contact, of `crossing`, of `fictitious_time` or of `expand`.

    Returns
    -------
    tail : of `expand`; that of `crossing` is 0, NaN where it is not finite
    ratio : of the length over which the series hold to the step, in the variable of the series
    """
    regimes, law, omega, loaded = problem.regimes, problem.compliance, problem.omega, problem.loads is not None
    loss = loss_at(law, state.clock[CLOSING])
    if w.contact[KNOWN, SERIES] == LATTICE:
        ratio = expand_about_crossing(
            regimes, law, loss, omega, loaded, w.load, w.added, state, time, step, w.lattice, w.last
        )
        return (0.0 if math.isfinite(ratio) else math.nan), ratio
    if w.contact[KNOWN, SERIES] == FICTITIOUS:
        tail = expand_in_fictitious_time(regimes, law, loss, omega, loaded, state, time, step, w)
    else:
        tail = expand(regimes, law, omega, loaded, w.load, w.added, state, time, step, w.contact)
    return tail, 0.9 * (TRUNCATION / tail) ** (1.0 / (w.contact[KNOWN, LAST] - 1.0)) if tail > 0.0 else 1.0


@njit(**WITHIN)
def rescale(contact: np.ndarray, ratio: float, modes: int) -> None:
    """Let the series hold for a step that is `ratio` times as long, and shorter."""
    contact[KNOWN, SPREAD] *= ratio
    contact[KNOWN, SPREAD_OF_RATE] *= ratio * ratio
    factor = 1.0
    for k in range(int(contact[KNOWN, LAST]) + 1):
        for row in (DEPTH, RATE, FORCE):
            contact[row, k] *= factor
        for row in range(MODES, MODES + modes):
            contact[row, k] *= factor
        factor *= ratio


@njit(**ENCLOSED)
def _small_force(
    law: Compliance, state: ImpactState, tau: float, depth_at: float, power: float, contact: np.ndarray
) -> float:
    """Integral of stiffness d^(power - 1) (1 + loss d') up to `tau`, where d went evenly to `depth_at` [m]."""
    begin, end = max(0.0, contact[DEPTH, 0]), max(0.0, depth_at)
    if begin == end or tau == 0.0:
        return 0.0
    lossy = 1.0 + loss_at(law, state.clock[CLOSING]) * contact[RATE, 0]
    return law.stiffness * lossy * (end**power - begin**power) / (power * (end - begin)) * tau


@njit(**ENCLOSED)
def motion_within(
    law: Compliance,
    state: ImpactState,
    w: Scratch,
    step: float,
    tau: float,
    y: np.ndarray,
    v: np.ndarray,
) -> None:
    """Write the modal motion at `tau` into the step."""
    contact = w.contact
    if contact[KNOWN, SERIES] == LATTICE:
        motion_about_crossing(law, w.lattice, w.last, step, tau, y, v)
        return
    if contact[KNOWN, SERIES] == FICTITIOUS:
        motion_in_fictitious_time(law, contact, tau, y, v)
        return
    x, order = tau / step, int(contact[KNOWN, LAST])
    for i in range(y.size):
        value, slope = contact[MODES + i, order], 0.0
        for k in range(order - 1, -1, -1):
            slope = slope * x + value
            value = value * x + contact[MODES + i, k]
        y[i], v[i] = value, slope / step
    if contact[KNOWN, STIFF] == 0 and state.counters[REGIME] == COMPRESSION:
        depth = 0.0
        for k in range(order, -1, -1):
            depth = depth * x + contact[DEPTH, k]
        impulse = _small_force(law, state, tau, depth, law.exponent + 1.0, contact)
        for i in range(y.size):
            v[i] += law.load[i] * impulse


@njit(**INLINED)
def _until_zero(value: float, slope: float, curvature: float) -> float:
    """First zero of value + slope x - curvature x^2 / 2 beyond 0, where value is not negative; infinite without one."""
    if curvature <= 0.0:
        return -value / slope if slope < 0.0 else math.inf
    root = math.sqrt(slope * slope + 2.0 * curvature * value)
    return 2.0 * value / (root - slope) if slope < 0.0 else (slope + root) / curvature


@njit(**WITHIN)
def first_root(series: np.ndarray, begin: int, end: int, resolution: float) -> tuple[float, int]:
    """First zero in [0, 1] of sum_k series[k] x^(k - begin), which is positive before it; infinite without one.

    As in `witness.first_zero`, a bound says how far one may go without passing a zero, here one on the third
    derivative. NaN: it was given up. The jumps made are counted.
    """
    third, change = 0.0, 0.0
    for k in range(begin + 1, end + 1):
        size = abs(series[k])
        third += (k - begin) * (k - begin - 1) * (k - begin - 2) * size
        change += size
    if series[begin] > change:
        return math.inf, 1
    x, jumps = 0.0, 0
    while x < 1.0:
        if jumps == MAX_SERIES_JUMPS:
            return math.nan, jumps
        jumps += 1
        value, slope, half = series[end], 0.0, 0.0
        for k in range(end - 1, begin - 1, -1):
            half = half * x + slope
            slope = slope * x + value
            value = value * x + series[k]
        if value <= 0.0:
            return x, jumps
        reach = 1.0 - x
        ahead = _until_zero(value, slope, third * reach / 3.0 - 2.0 * half)
        if ahead < reach:  # a shorter reach has a lower bound on the curvature
            reach = min(reach, 4.0 * ahead)
            ahead = min(reach, _until_zero(value, slope, third * reach / 3.0 - 2.0 * half))
        if slope < 0.0 and ahead < resolution:
            return (x + ahead if x + ahead <= 1.0 else math.inf), jumps
        x += max(ahead, resolution)
    return math.inf, jumps


@njit(**WITHIN)
def end_of_parting(
    law: Compliance, begin: float, end: float, resolution: float, step: float, contact: np.ndarray
) -> tuple[float, int]:
    """First zero in [begin, end] of stiffness d^n + damping d', which is negative before it; infinite without one.

    With a bound on |d'''|, a convex function of time lies above it: where that is negative at the end of an interval as
    at its start, there is no zero in between. The jumps made are counted; NaN: it was given up.
    """
    order, depth = int(contact[KNOWN, LAST]), contact[DEPTH]
    third = 0.0
    for k in range(3, order + 1):
        third += k * (k - 1) * (k - 2) * abs(depth[k])
    x, jumps = begin, 0
    while x < end:
        value, slope, second = depth[order], 0.0, 0.0
        for k in range(order - 1, -1, -1):
            second = second * x + 2.0 * slope
            slope = slope * x + value
            value = value * x + depth[k]
        second, ahead = max(0.0, second), end - x
        while True:
            if jumps == MAX_SERIES_JUMPS:
                return math.nan, jumps
            jumps += 1
            highest = max(0.0, value + ahead * (slope + ahead * (0.5 * second + third * ahead / 6.0)))
            fastest = slope + ahead * (second + 0.5 * third * ahead)
            if law.stiffness * highest**law.exponent + law.damping * fastest / step < 0.0:
                break
            ahead *= 0.5
            if ahead < resolution:
                return x, jumps
        x += ahead
    return math.inf, jumps


@njit(**ENCLOSED)
def _expand_slopes(problem: Problem, loss: float, w: Scratch) -> None:
    """Write the series of the force's derivatives by the penetration, by its rate and by the loss factor."""
    law = problem.compliance
    depth, rate = w.contact[DEPTH], w.contact[RATE]
    by_depth, by_rate, by_loss = w.contact[BY_DEPTH], w.contact[BY_RATE], w.contact[BY_LOSS]
    stiffness = law.stiffness if w.contact[KNOWN, STIFF] != 0 else 0.0
    for k in range(ORDER + 1):
        by_loss[k] = 0.0
        if loss != 0.0:
            for j in range(k + 1):
                by_loss[k] += stiffness * depth[j] * rate[k - j]
        by_depth[k] = stiffness * ((1.0 if k == 0 else 0.0) + loss * rate[k])
        by_rate[k] = stiffness * loss * depth[k] + (law.damping if k == 0 else 0.0)


@njit(**ENCLOSED)
def carry_differences(
    problem: Problem,
    state: ImpactState,
    loss_slope: float,
    step: float,
    tau: float,
    w: Scratch,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Carry dy, dv (n, m) on by `tau` into a step of compression whose series are written; those of the loads vanish.

    dspeed (m,) are differences of the closing speed [m/s], by which the loss factor falls at `loss_slope`.
    """
    regimes, law, n = problem.regimes, problem.compliance, dy.shape[0]
    loss, at = loss_at(law, state.clock[CLOSING]), 0.0
    if w.contact[KNOWN, SERIES] == LATTICE:
        carry_about_crossing(problem, state, loss, loss_slope, step, tau, w.lattice, w.last, dy, dv, dspeed)
        return
    if w.contact[KNOWN, SERIES] == FICTITIOUS:
        carry_in_fictitious_time(problem, loss, loss_slope, tau, w.contact, dy, dv, dspeed)
        return
    simple = loss == 0.0 and law.exponent == 1.0
    by_start, by_speed, by_factor = 0.0, 0.0, 0.0  # impulse of the small force, per unit of what it depends on
    if w.contact[KNOWN, STIFF] == 0:
        for k in range(int(w.contact[KNOWN, LAST]), -1, -1):
            at = at * tau / step + w.contact[DEPTH, k]
        begin, rate = max(0.0, w.contact[DEPTH, 0]), w.contact[RATE, 0]
        impulse = _small_force(law, state, tau, at, law.exponent + 1.0, w.contact)
        per_depth = _small_force(law, state, tau, at, law.exponent, w.contact)
        by_start, by_factor = law.exponent * per_depth, impulse * rate / (1.0 + loss * rate)
        if impulse != 0.0:  # the path went evenly from the beginning to its end
            by_speed = law.exponent * tau / (max(0.0, at) - begin) * (impulse - begin * per_depth)
            by_speed += loss * impulse / (1.0 + loss * rate)
    _expand_slopes(problem, loss, w)
    by_depth, by_rate, by_loss, depth = w.contact[BY_DEPTH], w.contact[BY_RATE], w.contact[BY_LOSS], w.contact[WITNESS]
    a, x, square = w.contact[MODES:], tau / step, step * step
    for column in range(dy.shape[1]):
        depth[0], depth[1] = 0.0, 0.0
        for i in range(n):
            a[i, 0], a[i, 1] = dy[i, column], dv[i, column] * step
            depth[0] -= regimes.witness_y[FREE, i] * a[i, 0]
            depth[1] -= regimes.witness_y[FREE, i] * a[i, 1]
        for k in range(ORDER - 1):
            value = by_loss[k] * loss_slope * dspeed[column]
            for j in range(1 if simple else k + 1):
                value += by_depth[j] * depth[k - j] + by_rate[j] * (k - j + 1) * depth[k - j + 1] / step
            depth[k + 2] = 0.0
            for i in range(n):
                f = law.load[i] * value - regimes.stiffness[FREE, i] * a[i, k]
                f = square * f - 2.0 * regimes.rate[FREE, i] * step * (k + 1) * a[i, k + 1]
                a[i, k + 2] = f * _INVERSE[k]
                depth[k + 2] -= regimes.witness_y[FREE, i] * a[i, k + 2]
        for i in range(n):
            value, slope = a[i, ORDER], 0.0
            for k in range(ORDER - 1, -1, -1):
                slope = slope * x + value
                value = value * x + a[i, k]
            more = by_start * depth[0] + by_speed * depth[1] / step + by_factor * loss_slope * dspeed[column]
            dy[i, column], dv[i, column] = value, slope / step + law.load[i] * more
