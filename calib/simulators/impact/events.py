"""What happens at the end of a regime: impact, sticking, release."""

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED, ENCLOSED_INLINED
from calib.simulators.impact.coordinates import to_coordinates, to_modes
from calib.simulators.impact.polynomial import polynomial, slope
from calib.simulators.impact.problem import (
    AT_PERIOD,
    CONTACT,
    FREE,
    HIT,
    IMPACTS,
    REGIME,
    RELEASED,
    RESTITUTION_LAWS,
    TOUCH,
    ImpactState,
    Problem,
)
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.witness import witness
from calib.simulators.law_calls import restitution


@njit(**ENCLOSED)
def coefficient(problem: Problem, speed: float) -> float:
    """Coefficient of restitution at a closing speed [m/s], laws included, within [0, 1]; NaN where a law is."""
    e = problem.restitution
    for i in range(problem.counts[RESTITUTION_LAWS]):
        e += restitution(problem.restitution_laws[i], problem.restitution, speed, problem.restitution_p[i])
    return min(max(e, 0.0), 1.0)  # in this order NaN is kept, and ends the run


@njit(**ENCLOSED)
def sticks(problem: Problem, rate: float, acceleration: float, e: float) -> bool:
    """Whether a rebound with this rate [m/s] ends in contact: it rises less than `height`, and so all that follow.

    What is left of the flights is the geometric sum 2 rate / (|acceleration| (1 - e)); where e is so near 1 that this
    is no short time, the body goes on bouncing.
    """
    if not acceleration < 0.0:
        return False
    if problem.exact:
        low = rate * rate <= -2.0 * acceleration * problem.height
        return low and 2.0 * rate <= -acceleration * (1.0 - e) * problem.lift
    return 2.0 * rate < -acceleration * problem.step  # a flight shorter than a step


@njit(**ENCLOSED_INLINED)
def note_impact(
    problem: Problem, state: ImpactState, now: float, speed: float, impacts: np.ndarray, w: Scratch
) -> None:
    """Count an impact at `now` [s] since the whole period; note it, its closing speed [m/s] and the motion in `w`."""
    row, n = state.counters[IMPACTS], w.q.size
    if row < impacts.shape[0]:
        impacts[row, 0] = state.counters[AT_PERIOD] * problem.period + now
        impacts[row, 1] = speed
        for j in range(n):
            impacts[row, 2 + j] = w.q[j]
            impacts[row, 2 + n + j] = w.dq[j]
    state.counters[IMPACTS] += 1


@njit(**ENCLOSED)
def meet_stop(
    problem: Problem,
    state: ImpactState,
    time: float,
    tau: float,
    step: float,
    located: bool,
    impacts: np.ndarray,
    w: Scratch,
) -> None:
    """Take the impact, stick or release at `tau` into the step that began at `time`; the state is the one there.

    An impact turns the rate of the clearance by -e: the body that is hit jumps, the others keep their velocities
    (paper, eq. (2): the beam is infinitely heavy at an impact). `located` says that an event is due here, and that
    the clearance is zero but for rounding. Impacts are noted in `impacts` as `kernel.advance` says.
    """
    r, now, omega = state.counters[REGIME], time + tau, problem.omega
    loaded = problem.loads is not None
    value, rate, _, _ = witness(
        problem.regimes, r, state.y, state.v, omega, now, loaded, w.load, w.added, step, tau, 0.0
    )
    free = r == FREE
    if not (located or (value < 0.0 and (rate < 0.0 or not free))):
        return
    u, du = polynomial(w.input, tau / step), slope(w.input, tau / step) / step
    to_coordinates(problem.regimes, r, state.y, state.v, omega, now, u, du, w.q, w.dq)
    state.counters[TOUCH] = HIT if free else RELEASED
    e = 0.0
    if free:
        note_impact(problem, state, now, -rate, impacts, w)
        e = coefficient(problem, -rate)
        place = value if located or problem.onto_surface else 0.0
        for j in range(w.q.size):
            w.dq[j] -= (1.0 + e) * rate * problem.hit[j]
            w.q[j] -= place * problem.hit[j]
        rate = -e * rate
    r = state.counters[REGIME] = FREE
    to_modes(problem.regimes, r, w.q, w.dq, omega, now, u, du, state.y, state.v)
    if not free:
        return
    value, _, acceleration, _ = witness(
        problem.regimes, r, state.y, state.v, omega, now, loaded, w.load, w.added, step, tau, 0.0
    )
    if sticks(problem, rate, acceleration, e):
        for j in range(w.q.size):
            w.dq[j] -= rate * problem.hit[j]
            w.q[j] -= value * problem.hit[j]
        r = state.counters[REGIME] = CONTACT
        to_modes(problem.regimes, r, w.q, w.dq, omega, now, u, du, state.y, state.v)
        state.counters[TOUCH] = 0
