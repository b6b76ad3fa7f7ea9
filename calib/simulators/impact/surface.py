"""The way of a motion into a compliant contact, through it and out of it.

The contact begins where the clearance comes to zero, and its force is that of the law while that is not negative. The
surface has no memory: where the force comes down to zero before the bodies have separated (a damper holds them back),
they part, and the force is back as soon as the law is positive again. An impact is counted where the clearance comes
to zero, not where parted bodies meet anew before they have separated.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import INLINED, WITHIN
from calib.simulators.impact.collocation import collocate, set_given_loads
from calib.simulators.impact.coordinates import to_coordinates
from calib.simulators.impact.crossing import rescale_about_crossing, time_about_crossing
from calib.simulators.impact.events import note_impact
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
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.series import (
    CROSSING,
    DEPTH,
    END,
    FORCE,
    HELD,
    KNOWN,
    LAST,
    RATE,
    SMALL,
    SPREAD,
    SPREAD_OF_RATE,
    STIFF,
    WITNESS,
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
MAX_SHARE_OF_DISTANCE = 0.75  # of the time to d = 0, ahead or behind, that a step takes where n > 1
MAX_TAIL = 1e-6  # of a series that is cut to a shorter step as it is; with a longer one it is made anew
MIN_RESOLUTION, MAX_RESOLUTION = 1e-15, 1e-12  # of events, as a share of the step: less does not show in it
MAX_CONTACT_RETAKES = 4  # times a step is taken anew up to the event in it, where force laws act


@njit(**INLINED)
def _longer(w: Scratch, factor: float) -> float:
    """Length of the step over which the series held last, times a factor; infinite before the first  [s]."""
    held = w.contact[KNOWN, HELD]
    return factor * held if held > 0.0 else math.inf


@njit(**INLINED)
def _penetration(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> tuple[float, float]:
    """Penetration [m], zero at least, and its rate [m/s] at the start of a step; what the input adds is written."""
    regimes, omega = problem.regimes, problem.omega
    c, s = math.cos(omega * time), math.sin(omega * time)
    wc, ws = regimes.witness[FREE, 0], regimes.witness[FREE, 1]
    clearance, rate = wc * c + ws * s + regimes.witness[FREE, 2], omega * (ws * c - wc * s)
    if problem.collocated:
        clearance += w.added[0]
        rate += w.added[1] / step
    for i in range(state.y.size):
        clearance += regimes.witness_y[FREE, i] * state.y[i]
        rate += regimes.witness_y[FREE, i] * state.v[i]
    return max(0.0, -clearance), -rate


@njit(**INLINED)
def _step_within_power(problem: Problem, state: ImpactState, time: float, reach: float, w: Scratch) -> float:
    """Length of the next step [s] under a force with n > 1; it is written whether d^n has its part in the force."""
    step = min(reach, min(problem.compliance.step, _longer(w, 1.5)))
    if problem.collocated:
        set_given_loads(problem, state, time, step, w)
    depth, rate = _penetration(problem, state, time, step, w)
    small, hit = w.contact[KNOWN, SMALL], state.counters[TOUCH] == HIT
    if hit or small == 0.0:
        _, _, second, _ = witness(
            problem.regimes, FREE, state.y, state.v, problem.omega, time, problem.collocated, w.load, w.added, step,
            0.0, 0.0,
        )  # fmt: skip
        small = time_of_small_force(problem.compliance, abs(rate), abs(second) if rate >= 0.0 else 0.0)
        w.contact[KNOWN, SMALL] = small
        if hit:
            loss = loss_at(problem.compliance, state.clock[CLOSING])
            about = time_about_crossing(problem.compliance, loss, rate, second)
            if about > small:
                w.contact[KNOWN, CROSSING] = 1.0
                return min(reach, min(problem.compliance.step, about))
    if hit:
        depth = 0.0
    distance = depth / abs(rate) if rate != 0.0 else (math.inf if depth > 0.0 else 0.0)
    w.contact[KNOWN, STIFF] = distance >= small
    if distance >= small:
        return min(step, MAX_SHARE_OF_DISTANCE * distance)
    return min(step, small if rate >= 0.0 else 4.0 * distance)


@njit(**WITHIN)
def _first_event(
    law: Compliance, state: ImpactState, step: float, resolution: float, lift: float, contact: np.ndarray
) -> float:
    """First end of the regime, as a share of the step, infinite without one; what it is, is written."""
    touch = state.counters[TOUCH]
    pressed = state.counters[REGIME] == COMPRESSION
    order, own = int(contact[KNOWN, LAST]), contact[WITNESS]
    resolution = max(min(resolution / step, MAX_RESOLUTION), MIN_RESOLUTION)
    by_separation, by_force, jumps, more = math.inf, math.inf, 0, 0
    if not pressed or law.damping == 0.0:
        begin = 1 if touch == HIT and contact[DEPTH, 0] == 0.0 else 0
        if begin == 1 or contact[DEPTH, 0] <= contact[KNOWN, SPREAD]:
            by_separation, jumps = first_root(contact[DEPTH], begin, order, resolution)
    loss = loss_at(law, state.clock[CLOSING])
    if law.damping > 0.0 and not pressed and law.exponent != 1.0:
        begins = lift / step if touch == RELEASED else 0.0
        by_force, more = end_of_parting(law, begins, min(1.0, by_separation), resolution, step, contact)
    elif law.damping > 0.0:
        sign = 1.0 if pressed else -1.0
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


@njit(**WITHIN)
def next_step_in_contact(problem: Problem, state: ImpactState, reach: float, w: Scratch) -> tuple[int, float, float]:
    """Work out the motion over the next step in contact, at most `reach` [s] long, and find where it ends.

    Returns
    -------
    outcome, tau, step : as of `step.next_step`
    """
    law, time = problem.compliance, state.clock[0]
    pressed = state.counters[REGIME] == COMPRESSION
    w.contact[KNOWN, STIFF], w.contact[KNOWN, CROSSING] = pressed or law.exponent == 1.0, 0.0
    step = min(reach, law.step if pressed else law.free_step)
    if pressed and law.exponent != 1.0:
        step = _step_within_power(problem, state, time, reach, w)
    elif pressed and law.loss > 0.0:
        step = min(step, _longer(w, 1.2))
    shortenings, retakes = 0, 0
    while shortenings <= MAX_SHORTENINGS:
        state.counters[STEPS] += 1
        holds = collocate(problem, state.counters[REGIME], state, time, step, w) if problem.collocated else True
        tail, ratio = expand_contact(problem, state, time, step, w)
        if not math.isfinite(tail):  # over so long a step the series grow beyond bounds, or the loads made of them
            shortenings += 1
            step *= 0.5
            continue
        about = w.contact[KNOWN, CROSSING] != 0
        if ratio < 1.0 or not holds:
            shortenings += 1
            ratio = ratio if ratio < 1.0 else 0.5
            step *= ratio
            if problem.collocated or tail > MAX_TAIL or (about and ratio < 0.5):
                continue
            if about:
                rescale_about_crossing(law, w.lattice, w.last, ratio)
            else:
                rescale(w.contact, ratio)
        if about:  # the penetration grows all along
            w.contact[KNOWN, HELD] = step
            return NO_EVENT, step, step
        at = _first_event(law, state, step, problem.resolution, problem.lift, w.contact)
        if math.isnan(at):
            return FAILED, 0.0, step
        if pressed and shortenings > 0:
            w.contact[KNOWN, HELD] = step
        elif pressed:
            w.contact[KNOWN, HELD] = max(w.contact[KNOWN, HELD], step)
        if at > 1.0:
            return NO_EVENT, step, step
        kind = w.contact[KNOWN, END]
        immediate = at * step <= problem.resolution  # a step as short as that might not show the event anew
        if problem.counts[FORCE_LAWS] == 0 or retakes == MAX_CONTACT_RETAKES or immediate or at > 1.0 - 1e-9:
            return EVENT, at * step, step
        retakes += 1
        w.contact[KNOWN, END] = kind
        step = step * min(1.0, at + 1e-10)  # within a step the laws' loads are of lower order than at its end
    return FAILED, 0.0, step


@njit(**WITHIN)
def meet_surface(
    problem: Problem, state: ImpactState, time: float, tau: float, step: float, impacts: np.ndarray, w: Scratch
) -> None:
    """Take the event at `tau` into the step that began at `time`; the state is the one there, and goes on."""
    r, now = state.counters[REGIME], time + tau
    value, rate, _, _ = witness(
        problem.regimes, FREE, state.y, state.v, problem.omega, now, problem.collocated, w.load, w.added, step, tau, 0.0
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
