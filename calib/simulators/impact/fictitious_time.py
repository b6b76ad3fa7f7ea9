"""Motion under a force with a power of the penetration, as Taylor series in a fictitious time.

A power d^n with n > 1 has no series in time about d = 0, and near there only short ones. Over a step from s = 0 to 1
the time goes as a polynomial of s whose rate is zero where a contact begins and, over later steps, where it is
expected to end: with 2 n whole the motion has series in s up to there and beyond. The rate is one of the second degree,
so that

    y' = rate v,    v' = rate (f - 2 decay v - stiffness y)

cost each order little more than in time. The impulse of k d^n loss d' is k loss d^(n + 1) / (n + 1), and that of a
damper its factor times d: so the force needs d^n alone. What the modes do beside the force has series that end sooner.
The regularisation of collisions in celestial mechanics does the same (Stiefel & Scheifele, Linear and Regular Celestial
Mechanics, 1971).
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED, INLINED, WITHIN
from calib.simulators.impact.convolution import convolutions
from calib.simulators.impact.problem import FREE, Compliance, ImpactState, Problem, Regimes
from calib.simulators.impact.scratch import (
    BY_DEPTH,
    BY_LOSS,
    BY_RATE,
    COMPOSED,
    DEPTH,
    FORCE,
    IMPULSE,
    KNOWN,
    LAST,
    MODAL_LAST,
    MODES,
    MOVED,
    ORDER,
    PACE,
    POWER,
    RATE,
    SPREAD,
    SPREAD_OF_RATE,
    TRUNCATION,
    WITNESS,
    Scratch,
)

LEAST_MODAL = 1e-14  # terms of the modes beside the force, as a share of the largest, after which they end
FIRST_END = 8  # order before which the series do not end, so that the force has entered
MAX_INVERSIONS = 60  # steps of Newton and of bisection for the fictitious time
_RECIPROCAL_OF = np.array([1.0 / max(1, k) for k in range(ORDER + 1)])


@njit(**INLINED)
def set_pace(contact: np.ndarray, constant: float, linear: float, quadratic: float) -> float:
    """Write the rate constant + linear s + quadratic s^2 of the time [s]; the length of the step [s] is returned."""
    contact[KNOWN, PACE], contact[KNOWN, PACE + 1], contact[KNOWN, PACE + 2] = constant, linear, quadratic
    return constant + linear / 2.0 + quadratic / 3.0


@njit(**INLINED)
def time_at(contact: np.ndarray, s: float) -> float:
    """Time [s] since the start of the step at the fictitious time."""
    return s * (contact[KNOWN, PACE] + s * (contact[KNOWN, PACE + 1] / 2.0 + s * contact[KNOWN, PACE + 2] / 3.0))


@njit(**WITHIN)
def fictitious(contact: np.ndarray, tau: float) -> float:
    """Fictitious time at `tau` [s] into the step, over which time never runs back; beyond its end it is 1."""
    low, high = 0.0, 1.0
    if tau >= time_at(contact, 1.0):
        return 1.0
    s = tau / time_at(contact, 1.0)
    for _ in range(MAX_INVERSIONS):
        excess = time_at(contact, s) - tau
        if excess > 0.0:
            high = s
        else:
            low = s
        rate = contact[KNOWN, PACE] + s * (contact[KNOWN, PACE + 1] + s * contact[KNOWN, PACE + 2])
        following = s - excess / rate if rate > 0.0 else low
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(following - s) <= 4e-16 * s:
            return following
        s = following
    return s


@njit(**WITHIN)
def shorten(contact: np.ndarray, ratio: float, modes: int, written: bool) -> float:
    """End the step, and its series where they are written, at the fictitious time `ratio`; return its length [s]."""
    contact[KNOWN, SPREAD_OF_RATE] *= time_at(contact, ratio) / time_at(contact, 1.0) * ratio
    if written:
        contact[KNOWN, SPREAD] *= ratio
        factor = 1.0
        for k in range(int(contact[KNOWN, LAST]) + 1):
            for row in (DEPTH, RATE, POWER, IMPULSE, MOVED):
                contact[row, k] *= factor
            if k <= contact[KNOWN, MODAL_LAST]:
                for row in range(MODES, MODES + 2 * modes):
                    contact[row, k] *= factor
            factor *= ratio
    constant, linear, quadratic = contact[KNOWN, PACE], contact[KNOWN, PACE + 1], contact[KNOWN, PACE + 2]
    return set_pace(contact, ratio * constant, ratio**2 * linear, ratio**3 * quadratic)


@njit(**WITHIN)
def _compose(contact: np.ndarray, step: float, composed: np.ndarray) -> None:
    """Write the series in s of (tau / step)^m, m = 0 to 4."""
    composed[:] = 0.0
    composed[0, 0] = 1.0
    for m in range(1, composed.shape[0]):
        for k in range(3 * m - 2):
            for j in range(3):
                composed[m, k + j + 1] += composed[m - 1, k] * contact[KNOWN, PACE + j] / ((j + 1) * step)


@njit(**ENCLOSED)
def expand_in_fictitious_time(
    regimes: Regimes,
    law: Compliance,
    loss: float,
    omega: float,
    loaded: bool,
    state: ImpactState,
    time: float,
    step: float,
    w: Scratch,
) -> float:
    """Write the series over the step whose rate of time is written, from `time` [s] since the whole period.

    Where that rate is zero at the start, the penetration is zero there.

    Parameters
    ----------
    loss : factor of the contact at hand  [s/m]
    loaded : whether `load` and `added` of `Scratch`, as of `witness.witness`, have their part

    Returns
    -------
    tail : size of its last terms, as a share of the first; 0 where it has converged, NaN where it is not finite
    """
    n, exponent = state.y.size, law.exponent
    contact, load, added, composed = w.contact, w.load, w.added, w.composed
    a, v, still = contact[MODES:], contact[MODES + n :], contact[MODES + 2 * n :]
    depth, rate, own, impulse, moved = (
        contact[DEPTH], contact[RATE], contact[WITNESS], contact[IMPULSE], contact[MOVED],
    )  # fmt: skip
    g0, g1, g2 = contact[KNOWN, PACE], contact[KNOWN, PACE + 1], contact[KNOWN, PACE + 2]
    by_square = 2 if g0 == 0.0 else 0  # exponent of s that the penetration begins with
    begins = int(exponent * by_square)  # that its power begins with
    reduced, power = depth[by_square:], contact[POWER, begins:]
    if loaded:
        _compose(contact, step, composed)
    c, s, square = math.cos(omega * time), math.sin(omega * time), omega * omega
    wc, ws = regimes.witness[FREE, 0], regimes.witness[FREE, 1]
    drive, drive1, drive2 = wc * c + ws * s, 0.0, 0.0  # of the drive's part in the clearance: the last three terms
    moving, moving1, moving2 = omega * (ws * c - wc * s), 0.0, 0.0  # and of its rate
    clearance, opening, largest, heaviest = drive + regimes.witness[FREE, 2], moving, 0.0, 0.0
    if loaded:
        clearance += added[0]
        opening += added[1] / step
    for i in range(n):
        a[i, 0], v[i, 0] = state.y[i], state.v[i]
        clearance += regimes.witness_y[FREE, i] * a[i, 0]
        opening += regimes.witness_y[FREE, i] * v[i, 0]
        largest, heaviest = max(largest, abs(v[i, 0])), max(heaviest, abs(law.load[i]))
    depth[0], rate[0], impulse[0], moved[0] = 0.0 if by_square else -clearance, -opening, 0.0, 0.0
    for k in range(begins):
        contact[POWER, k] = 0.0
    if by_square == 0:
        power[0], own[0] = depth[0] ** exponent, 0.0
    per_depth = 1.0 / depth[0] if by_square == 0 else 0.0
    share = law.stiffness * loss / (exponent + 1.0)  # the impulse of k d^n loss d' is that of d^(n + 1)
    fastest, spread, spread_of_rate = abs(opening), 0.0, 0.0
    opened, opened1, opened2 = 0.0, 0.0, 0.0  # acceleration of the clearance without the force: the last three terms
    largest_begins, fastest_begins = largest, fastest
    # orders of which one term is not zero: a parity may be, and the force about d = 0 acts on every 2 (n + 1)-th alone
    window = begins + by_square if by_square else 2
    small, order, tail, few, modal = 0, ORDER, 0.0, 0, ORDER
    first_end = COMPOSED if loaded else FIRST_END
    for k in range(ORDER):
        inverse, j = _RECIPROCAL_OF[k + 1], k + 1 - begins
        f0, f1, f2 = g0 * inverse, g1 * inverse if k > 0 else 0.0, g2 * inverse if k > 1 else 0.0
        last, earlier = max(0, k - 1), max(0, k - 2)
        depth[k + 1] = f0 * rate[k] + f1 * rate[last] + f2 * rate[earlier]
        spread += abs(depth[k + 1])
        acting = law.damping * depth[k + 1]
        pressed = f0 * contact[POWER, k] + f1 * contact[POWER, last] + f2 * contact[POWER, earlier]
        acting += law.stiffness * pressed
        whole = 0.0
        if j > 0:
            plain, weighted = convolutions(power, own, reduced, j - 1)
            # d p' = n p d'
            power[j] = (exponent * plain - (exponent + 1.0) * _RECIPROCAL_OF[j] * weighted) * per_depth
            own[j] = j * power[j]
        elif j == 0:
            power[0], own[0], per_depth = reduced[0] ** exponent, 0.0, 1.0 / reduced[0]
        if loss > 0.0:
            i = j - by_square
            if by_square == 0:
                whole = plain + power[j] * depth[0]
            elif i >= 0:
                whole = power[0] * reduced[i]
                for m in range(1, i + 1):
                    whole += power[m] * reduced[i - m]
            acting += share * whole
        impulse[k + 1] = acting
        moved[k + 1] = f0 * impulse[k] + f1 * impulse[last] + f2 * impulse[earlier]
        opening = 0.0
        if k < modal:
            opened2, opened1, opened, term = opened1, opened, -square * drive, 0.0
            if loaded and k < COMPOSED:
                for m in range(2, 5):
                    opened += m * (m - 1) * added[m] * composed[m - 2, k] / (step * step)
            drive, drive1, drive2, moving, moving1, moving2 = (
                f0 * moving + f1 * moving1 + f2 * moving2, drive, drive1,
                -square * (f0 * drive + f1 * drive1 + f2 * drive2), moving, moving1,
            )  # fmt: skip
            for i in range(n):
                x = -regimes.stiffness[FREE, i] * (a[i, k] + law.load[i] * moved[k])
                x -= 2.0 * regimes.rate[FREE, i] * (v[i, k] + law.load[i] * impulse[k])
                if loaded and k < COMPOSED:
                    for m in range(5):
                        x += load[i, m] * composed[m, k]
                still[i, k] = x
                opened += regimes.witness_y[FREE, i] * x
                x = f0 * x + f1 * still[i, last] + f2 * still[i, earlier]
                a[i, k + 1] = f0 * v[i, k] + f1 * v[i, last] + f2 * v[i, earlier]
                v[i, k + 1] = x
                term = max(term, abs(x))
            opening = f0 * opened + f1 * opened1 + f2 * opened2
            few = few + 1 if max(term, abs(opening)) <= LEAST_MODAL * largest and k + 1 >= first_end else 0
            if few == window + 1:
                modal = k + 1
        term = heaviest * abs(acting) + (term if k < modal else 0.0)
        rate[k + 1] = -opening - acting  # a unit of the impulse is one of the clearance's
        deep = abs(rate[k + 1])
        spread_of_rate += deep
        largest, fastest = max(largest, term), max(fastest, deep)
        if k == 1:
            largest_begins, fastest_begins = largest, fastest
        if term <= TRUNCATION * largest and deep <= TRUNCATION * fastest and k + 1 >= first_end:
            small += 1
            if small == window:
                order = k + 1
                break
        else:
            small = 0
            if k >= ORDER - window:
                tail = max(
                    tail,
                    term / largest_begins if largest > 0.0 else 0.0,
                    deep / fastest_begins if fastest > 0.0 else 0.0,
                )
    for k in range(order + 1, ORDER + 1):
        rate[k], depth[k], contact[POWER, k] = 0.0, 0.0, 0.0
    contact[KNOWN, LAST], contact[KNOWN, SPREAD], contact[KNOWN, MODAL_LAST] = order, spread, min(order, modal)
    contact[KNOWN, SPREAD_OF_RATE] = spread_of_rate * step
    if not math.isfinite(largest + fastest + depth[order]):
        return math.nan
    return tail if order == ORDER else 0.0


@njit(**WITHIN)
def motion_in_fictitious_time(law: Compliance, contact: np.ndarray, tau: float, y: np.ndarray, v: np.ndarray) -> None:
    """Write the modal motion at `tau` into the step."""
    x, order, modal, n = fictitious(contact, tau), int(contact[KNOWN, LAST]), int(contact[KNOWN, MODAL_LAST]), y.size
    moved, impulse = contact[MOVED, order], contact[IMPULSE, order]
    for k in range(order - 1, -1, -1):
        moved = moved * x + contact[MOVED, k]
        impulse = impulse * x + contact[IMPULSE, k]
    for i in range(n):
        value, speed = contact[MODES + i, modal], contact[MODES + n + i, modal]
        for k in range(modal - 1, -1, -1):
            value = value * x + contact[MODES + i, k]
            speed = speed * x + contact[MODES + n + i, k]
        y[i], v[i] = value + law.load[i] * moved, speed + law.load[i] * impulse


@njit(**WITHIN)
def expand_force(law: Compliance, contact: np.ndarray) -> None:
    """Write the series of the force of a damper and of a power of the penetration."""
    for k in range(int(contact[KNOWN, LAST]) + 1):
        contact[FORCE, k] = law.stiffness * contact[POWER, k] + law.damping * contact[RATE, k]


@njit(**WITHIN)
def _expand_derivatives_of_force(law: Compliance, loss: float, contact: np.ndarray) -> None:
    """Write the series of the force's derivatives by the penetration, by its rate and by the loss factor."""
    n, by_square = law.exponent, 2 if contact[KNOWN, PACE] == 0.0 else 0
    begins = int((n - 1.0) * by_square)
    depth, rate, power, lower = contact[DEPTH, by_square:], contact[RATE], contact[POWER], contact[WITNESS]
    for k in range(ORDER + 1):
        j = k - begins
        if j < 0:
            lower[k] = 0.0
        elif j == 0:
            lower[k] = depth[0] ** (n - 1.0)
        else:
            total = 0.0
            for i in range(1, min(j, ORDER - by_square) + 1):
                total += (n * i - j) * depth[i] * lower[k - i]
            lower[k] = total / (j * depth[0])
        product, by_loss = 0.0, 0.0
        for i in range(k + 1):
            product += lower[i] * rate[k - i]
            by_loss += power[i] * rate[k - i]
        contact[BY_LOSS, k] = law.stiffness * by_loss
        contact[BY_DEPTH, k] = law.stiffness * n * (lower[k] + loss * product)
        contact[BY_RATE, k] = law.stiffness * loss * power[k] + (law.damping if k == 0 else 0.0)


@njit(**ENCLOSED)
def carry_in_fictitious_time(
    problem: Problem,
    loss: float,
    loss_slope: float,
    tau: float,
    contact: np.ndarray,
    dy: np.ndarray,
    dv: np.ndarray,
    dspeed: np.ndarray,
) -> None:
    """Carry differences by `tau` into the step, as `series.carry_differences` does; the power's series are lost."""
    regimes, law, n = problem.regimes, problem.compliance, dy.shape[0]
    _expand_derivatives_of_force(law, loss, contact)
    by_depth, by_rate, by_loss = contact[BY_DEPTH], contact[BY_RATE], contact[BY_LOSS]
    a, v, acceleration = contact[MODES:], contact[MODES + n :], contact[MODES + 2 * n :]
    depth, rate, x = contact[WITNESS], contact[POWER], fictitious(contact, tau)
    for column in range(dy.shape[1]):
        for i in range(n):
            a[i, 0], v[i, 0] = dy[i, column], dv[i, column]
        for k in range(ORDER):
            depth[k], rate[k] = 0.0, 0.0
            for i in range(n):
                depth[k] -= regimes.witness_y[FREE, i] * a[i, k]
                rate[k] -= regimes.witness_y[FREE, i] * v[i, k]
            value = by_loss[k] * loss_slope * dspeed[column]
            for j in range(k + 1):
                value += by_depth[j] * depth[k - j] + by_rate[j] * rate[k - j]
            for i in range(n):
                acceleration[i, k] = law.load[i] * value - regimes.stiffness[FREE, i] * a[i, k]
                acceleration[i, k] -= 2.0 * regimes.rate[FREE, i] * v[i, k]
                a[i, k + 1], v[i, k + 1] = 0.0, 0.0
                for j in range(min(2, k) + 1):
                    factor = contact[KNOWN, PACE + j] * _RECIPROCAL_OF[k + 1]
                    a[i, k + 1] += factor * v[i, k - j]
                    v[i, k + 1] += factor * acceleration[i, k - j]
        for i in range(n):
            value, speed = a[i, ORDER], v[i, ORDER]
            for k in range(ORDER - 1, -1, -1):
                value = value * x + a[i, k]
                speed = speed * x + v[i, k]
            dy[i, column], dv[i, column] = value, speed
