"""The way of a motion into a compliant contact, through it and out of it.

The contact begins where the clearance comes to zero, and its force is that of the law while that is not negative. The
surface has no memory: where the force comes down to zero before the bodies have separated (a damper holds them back),
they part, and the force is back as soon as the law is positive again. An impact is counted where the clearance comes
to zero, not where parted bodies meet anew before they have separated.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED, ENCLOSED_INLINED, INLINED
from calib.simulators.impact.collocation import LOADS_HOLD
from calib.simulators.impact.coordinates import to_coordinates
from calib.simulators.impact.crossing import has_series_at_ends, rescale_about_crossing, time_about_crossing
from calib.simulators.impact.events import note_impact
from calib.simulators.impact.fictitious_time import expand_force, fictitious, set_pace, shorten, time_at
from calib.simulators.impact.loads import set_loads, set_loads_without_laws
from calib.simulators.impact.polynomial import polynomial, slope
from calib.simulators.impact.problem import (
    CLOSING,
    COMPRESSION,
    FORCE_LAWS,
    FREE,
    HIT,
    PARTED,
    REGIME,
    RELEASED,
    STEPS,
    TOUCH,
    Compliance,
    ImpactState,
    Problem,
)
from calib.simulators.impact.scratch import (
    BEGAN,
    DEPTH,
    END,
    FICTITIOUS,
    FORCE,
    HELD,
    KNOWN,
    LAST,
    LATTICE,
    PACE,
    RATE,
    SERIES,
    SMALL,
    SPREAD,
    SPREAD_OF_RATE,
    STIFF,
    TIME,
    WITNESS,
    Scratch,
)
from calib.simulators.impact.series import (
    end_of_parting,
    expand_contact,
    first_root,
    loss_at,
    rescale,
    time_of_small_force,
)
from calib.simulators.impact.witness import EVENT, FAILED, NO_EVENT, witness

SEPARATION, NO_FORCE, FORCE_AGAIN = 1, 2, 3  # what ends a step in contact
MAX_SHORTENINGS = 60  # of a step whose series or loads do not hold
MAX_SHARE_OF_DISTANCE = 0.75  # of the fictitious time to d = 0: the end may come later than foreseen
REACH_OF_SERIES = 0.6  # of a step, as a share of the fictitious time to where the series end
REACH_ABOUT = 2.3  # of the first step in a fictitious time, as a share of what `crossing` takes
EXIT_SHARE = 3.0  # by which the time to the end of a contact is foreseen, 2 under a force that lasts to the end
SHARE_BEFORE_END = 0.9  # of the fictitious time to where d = 0, beyond which series of d^n are not relied on
MAX_TAIL = 1e-6  # of a series in time that is cut to a shorter step as it is; with a longer one it is made anew
MIN_RESOLUTION, MAX_RESOLUTION = 1e-15, 1e-12  # of events, as a share of the step: less does not show in it
MAX_CONTACT_RETAKES = 4  # times a step is taken anew up to the event in it, where force laws act


@njit(**ENCLOSED_INLINED)
def _longer(w: Scratch, factor: float) -> float:
    """Length of the step over which the series held last, times a factor; infinite before the first  [s]."""
    held = w.contact[KNOWN, HELD]
    return factor * held if held > 0.0 else math.inf


@njit(**ENCLOSED_INLINED)
def _penetration(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> tuple[float, float]:
    """Penetration [m], zero at least, and its rate [m/s] at the start of a step; what the input adds is written."""
    regimes, omega = problem.regimes, problem.omega
    c, s = math.cos(omega * time), math.sin(omega * time)
    wc, ws = regimes.witness[FREE, 0], regimes.witness[FREE, 1]
    clearance, rate = wc * c + ws * s + regimes.witness[FREE, 2], omega * (ws * c - wc * s)
    if problem.loads is not None:
        clearance += w.added[0]
        rate += w.added[1] / step
    for i in range(state.y.size):
        clearance += regimes.witness_y[FREE, i] * state.y[i]
        rate += regimes.witness_y[FREE, i] * state.v[i]
    return max(0.0, -clearance), -rate


@njit(**INLINED)
def _set_pace_within(law: Compliance, loss: float, depth: float, rate: float, age: float, contact: np.ndarray) -> float:
    """Write the rate of time over a step from a penetration that moves so; the length of the step [s] is returned.

    The fictitious time is a part of that x in which the whole contact, of length T, is t = T (3 x^2 - 2 x^3). Beside
    x = 0 and 1, its beginning is at x = 1.5 too, and its end at -0.5. A step does not go to x = 1: where the end comes
    a little later, d^(n - 1) and with it the derivatives of the motion have no series that reaches there.

    Parameters
    ----------
    age : time since the contact began, NaN where that is not known  [s]
    """
    n, whole = law.exponent, has_series_at_ends(law)
    frequency = math.sqrt(law.stiffness) * depth ** (0.5 * (n - 1.0))
    angle = math.atan2(frequency * depth, rate)
    if not age > 0.0:
        age = angle / frequency
    if rate >= 0.0:
        left = (math.pi - angle) / frequency
    else:
        pressing = max(0.0, frequency * frequency * depth * (1.0 + loss * rate) + law.damping * rate)
        left = 2.0 * depth / (math.sqrt(rate * rate + 4.0 * pressing * depth / EXIT_SHARE) - rate)
    whole_time = age + left
    x = 0.5 - math.sin(math.asin(1.0 - 2.0 * age / whole_time) / 3.0)
    way = REACH_OF_SERIES * min(x + 0.5, 1.5 - x)
    way = min(way, MAX_SHARE_OF_DISTANCE * (1.0 - x if whole else min(x, 1.0 - x)))
    pace = 6.0 * whole_time * way
    return set_pace(contact, pace * x * (1.0 - x), pace * way * (1.0 - 2.0 * x), -pace * way * way)


@njit(**ENCLOSED_INLINED)
def _step_within_power(problem: Problem, state: ImpactState, time: float, reach: float, w: Scratch) -> float:
    """Length of the next step [s] under a force with n > 1; it is written which series serve."""
    law, contact, loaded = problem.compliance, w.contact, problem.loads is not None
    longest = min(reach, law.step)
    if loaded:
        longest = min(longest, _longer(w, 1.5))
    set_loads_without_laws(problem, state, time, longest, w)
    depth, rate = _penetration(problem, state, time, longest, w)
    small, hit = contact[KNOWN, SMALL], state.counters[TOUCH] == HIT
    loss, step = loss_at(law, state.clock[CLOSING]), math.inf
    if hit or small == 0.0:
        _, _, second, _ = witness(
            problem.regimes, FREE, state.y, state.v, problem.omega, time, loaded, w.load, w.added, longest, 0.0, 0.0
        )
        small = time_of_small_force(law, abs(rate), abs(second) if rate >= 0.0 else 0.0)
        contact[KNOWN, SMALL] = small
        contact[KNOWN, BEGAN] = time if hit else math.nan
        if hit:
            depth = 0.0
            step = time_about_crossing(law, loss, rate, second)
            if step > small:
                contact[KNOWN, SERIES] = FICTITIOUS if has_series_at_ends(law) else LATTICE
                if contact[KNOWN, SERIES] == LATTICE:
                    return min(longest, step)
                step = set_pace(contact, 0.0, 2.0 * REACH_ABOUT * step, 0.0)
    if contact[KNOWN, SERIES] == TIME:
        distance = depth / abs(rate) if rate != 0.0 else (math.inf if depth > 0.0 else 0.0)
        if distance < small:
            contact[KNOWN, STIFF] = 0.0
            return min(longest, small if rate >= 0.0 else 4.0 * distance)
        contact[KNOWN, SERIES] = FICTITIOUS
        age = time - contact[KNOWN, BEGAN]
        step = _set_pace_within(law, loss, depth, rate, age if age >= 0.0 else age + problem.period, contact)
    if step > longest:
        shorten(contact, fictitious(contact, longest), state.y.size, False)
        return longest
    return step


@njit(**INLINED)
def _stays_positive(step: float, contact: np.ndarray) -> bool:
    """Whether the penetration falls all along the step, and does not come to zero."""
    if contact[RATE, 0] + contact[KNOWN, SPREAD_OF_RATE] / step >= 0.0:
        return False
    end = 0.0
    for k in range(int(contact[KNOWN, LAST]) + 1):
        end += contact[DEPTH, k]
    return end > 0.0


@njit(**ENCLOSED)
def _first_event(
    law: Compliance, state: ImpactState, step: float, resolution: float, lift: float, contact: np.ndarray
) -> float:
    """First end of the regime, as a share of the step, infinite without one; what it is, is written."""
    touch = state.counters[TOUCH]
    pressed = state.counters[REGIME] == COMPRESSION
    order, own = int(contact[KNOWN, LAST]), contact[WITNESS]
    # a fictitious time goes at most twice as fast as on average
    resolution = max(min(0.5 * resolution / step, MAX_RESOLUTION), MIN_RESOLUTION)
    by_separation, by_force, jumps, more = math.inf, math.inf, 0, 0
    if not pressed or law.damping == 0.0:
        begin = 1 if touch == HIT and contact[DEPTH, 0] == 0.0 else 0
        if contact[KNOWN, SERIES] == FICTITIOUS and contact[KNOWN, PACE] == 0.0:
            begin = 2
        if begin > 0 or (contact[DEPTH, 0] <= contact[KNOWN, SPREAD] and not _stays_positive(step, contact)):
            by_separation, jumps = first_root(contact[DEPTH], begin, order, resolution)
    loss = loss_at(law, state.clock[CLOSING])
    if law.damping > 0.0 and not pressed and law.exponent != 1.0:
        begins = lift / step if touch == RELEASED else 0.0
        by_force, more = end_of_parting(law, begins, min(1.0, by_separation), resolution, step, contact)
    elif law.damping > 0.0:
        sign = 1.0 if pressed else -1.0
        if contact[KNOWN, SERIES] == FICTITIOUS:
            expand_force(law, contact)
        for k in range(order + 1):
            own[k] = sign * contact[FORCE, k]
        begin = 1 if touch == RELEASED or (touch == HIT and own[0] <= 0.0) else 0
        by_force, more = first_root(own, begin, order, resolution)
    elif loss > 0.0:  # the sign of a force that is a power of d times this
        sign, begin = (1.0 if pressed else -1.0), (1 if touch == RELEASED else 0)
        if begin == 1 or sign * (1.0 + loss * contact[RATE, 0]) <= loss * contact[KNOWN, SPREAD_OF_RATE] / step:
            for k in range(order + 1):
                own[k] = sign * (loss * contact[RATE, k] + (1.0 if k == 0 else 0.0))
            by_force, more = first_root(own, begin, order, resolution)
    state.counters[STEPS] += jumps + more
    contact[KNOWN, END] = SEPARATION if by_separation <= by_force else (NO_FORCE if pressed else FORCE_AGAIN)
    return min(by_separation, by_force)


@njit(**ENCLOSED)
def next_step_in_contact(problem: Problem, state: ImpactState, reach: float, w: Scratch) -> tuple[int, float, float]:
    """Work out the motion over the next step in contact, at most `reach` [s] long, and find where it ends.

    Returns
    -------
    outcome, tau, step : as of `step.next_step`
    """
    law, time, loaded = problem.compliance, state.clock[0], problem.loads is not None
    pressed = state.counters[REGIME] == COMPRESSION
    w.contact[KNOWN, STIFF], w.contact[KNOWN, SERIES] = pressed or law.exponent == 1.0, TIME
    step = min(reach, law.step if pressed else law.free_step)
    if pressed and law.exponent != 1.0:
        step = _step_within_power(problem, state, time, reach, w)
    elif pressed and law.loss > 0.0:
        step = min(step, _longer(w, 1.2))
    n, shortenings, retakes = state.y.size, 0, 0
    about, regularised = w.contact[KNOWN, SERIES] == LATTICE, w.contact[KNOWN, SERIES] == FICTITIOUS
    while shortenings <= MAX_SHORTENINGS:
        state.counters[STEPS] += 1
        holds = set_loads(problem, state.counters[REGIME], state, time, step, w) == LOADS_HOLD
        tail, ratio = expand_contact(problem, state, time, step, w)
        if not math.isfinite(tail):  # over so long a step the series grow beyond bounds, or the loads made of them
            shortenings += 1
            step = shorten(w.contact, 0.5, n, False) if regularised else 0.5 * step
            continue
        if ratio < 1.0 or not holds:
            shortenings += 1
            ratio = ratio if ratio < 1.0 else 0.5
            anew = loaded or (tail > MAX_TAIL and not regularised) or (about and ratio < 0.5)
            step = shorten(w.contact, ratio, n, not anew) if regularised else ratio * step
            if anew:
                continue
            if about:
                rescale_about_crossing(law, w.lattice, w.last, ratio)
            elif not regularised:
                rescale(w.contact, ratio, n)
        if about:  # the penetration grows all along
            w.contact[KNOWN, HELD] = step
            return NO_EVENT, step, step
        at = _first_event(law, state, step, problem.resolution, problem.lift, w.contact)
        if math.isnan(at):
            return FAILED, 0.0, step
        if regularised and at <= 1.0 and w.contact[KNOWN, END] == SEPARATION:
            shortenings += 1
            step = shorten(w.contact, SHARE_BEFORE_END * at, n, not loaded)
            if loaded:
                continue
            at = math.inf
        if pressed and shortenings > 0:
            w.contact[KNOWN, HELD] = step
        elif pressed:
            w.contact[KNOWN, HELD] = max(w.contact[KNOWN, HELD], step)
        if at > 1.0:
            return NO_EVENT, step, step
        kind = w.contact[KNOWN, END]
        tau = time_at(w.contact, at) if regularised else at * step
        immediate = tau <= problem.resolution  # a step as short as that might not show the event anew
        if problem.counts[FORCE_LAWS] == 0 or retakes == MAX_CONTACT_RETAKES or immediate or at > 1.0 - 1e-9:
            return EVENT, tau, step
        retakes += 1
        w.contact[KNOWN, END] = kind
        ratio = min(1.0, at + 1e-10)  # within a step the laws' loads are of lower order than at its end
        step = shorten(w.contact, ratio, n, False) if regularised else ratio * step
    return FAILED, 0.0, step


@njit(**ENCLOSED)
def meet_surface(
    problem: Problem, state: ImpactState, time: float, tau: float, step: float, impacts: np.ndarray, w: Scratch
) -> None:
    """Take the event at `tau` into the step that began at `time`; the state is the one there, and goes on."""
    r, now, loaded = state.counters[REGIME], time + tau, problem.loads is not None
    value, rate, _, _ = witness(
        problem.regimes, FREE, state.y, state.v, problem.omega, now, loaded, w.load, w.added, step, tau, 0.0
    )
    if r == FREE:
        u, du = polynomial(w.input, tau / step), slope(w.input, tau / step) / step
        to_coordinates(problem.regimes, FREE, state.y, state.v, problem.omega, now, u, du, w.q, w.dq)
        note_impact(problem, state, now, -rate, impacts, w)
        state.clock[CLOSING] = max(0.0, -rate)
        state.counters[REGIME], state.counters[TOUCH] = COMPRESSION, HIT
    elif w.contact[KNOWN, END] == SEPARATION or value >= 0.0:
        state.counters[REGIME], state.counters[TOUCH] = FREE, (HIT if rate > 0.0 else RELEASED)
    else:
        state.counters[REGIME] = PARTED if r == COMPRESSION else COMPRESSION
        state.counters[TOUCH] = RELEASED
