"""A run over a number of periods: step by step, with its samples, sections and impacts."""

import numpy as np
from numba import njit

from calib.simulators.compilation import COMPILED, ENCLOSED_INLINED, WITHIN
from calib.simulators.impact.coordinates import modal_row, to_coordinates
from calib.simulators.impact.polynomial import polynomial, slope
from calib.simulators.impact.problem import AT_PERIOD, REGIME, SECTIONS, STEPS, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.step import UNCONVERGED, complete_step, flow_within, next_step
from calib.simulators.impact.witness import FAILED

DONE, SETTLED, DIVERGED, SPENT, STALLED = 0, 1, 2, 3, 4  # how a run ends
MAX_SETTLED_PERIOD = 16  # periods of a motion that counts as settled


@njit(**ENCLOSED_INLINED)  # once a sample: to hand its arrays over would take longer than its arithmetic
def write_row(
    problem: Problem,
    r: int,
    y: np.ndarray,
    v: np.ndarray,
    time: float,
    tau: float,
    step: float,
    w: Scratch,
    row: np.ndarray,
) -> None:
    """Write (q, q', U, U') at `tau` into the step that began at `time` [s] since the whole period."""
    n = w.q.size
    u = polynomial(w.input, tau / step)
    du = slope(w.input, tau / step) / step
    to_coordinates(problem.regimes, modal_row(r), y, v, problem.omega, time + tau, u, du, w.q, w.dq)
    for j in range(n):
        row[j] = w.q[j]
        row[n + j] = w.dq[j]
    row[2 * n] = u
    row[2 * n + 1] = du


@njit(**WITHIN)
def within(row: np.ndarray, n: int, limits: np.ndarray) -> bool:
    """Whether the displacements and the velocities of a row are below their limits (and are numbers)."""
    below = True
    for j in range(n):
        below = below and abs(row[j]) < limits[0] and abs(row[n + j]) < limits[1]
    return below


@njit(**WITHIN)
def _has_settled(sections: np.ndarray, last: int, n: int, tolerance: float) -> bool:
    """Whether the last section equals one of the 16 before, in q and in q', to a share of the largest of either."""
    for back in range(1, min(MAX_SETTLED_PERIOD, last) + 1):
        same = True
        for half in range(2):
            size, gap = 0.0, 0.0
            for j in range(half * n, (half + 1) * n):
                size = max(size, abs(sections[last, j]))
                gap = max(gap, abs(sections[last, j] - sections[last - back, j]))
            same = same and gap <= tolerance * size
        if same:
            return True
    return False


@njit(**COMPILED)
def advance(
    problem: Problem,
    state: ImpactState,
    w: Scratch,
    periods: int,
    tolerance: float,
    budget: int,
    sections: np.ndarray,
    times: np.ndarray,
    samples: np.ndarray,
    impacts: np.ndarray,
) -> int:
    """Go on by `periods` periods, or until the stroboscopic section has settled.

    Parameters
    ----------
    problem : Problem
    state : State, written
    w : Scratch
    periods : periods to go
    tolerance : relative change of the section at which the motion has settled; 0 never
    budget : steps (jumps of the event search included) after which the run is given up
    sections : (periods, 2 n + 2) written: (q, q', U, U') at the end of each period  [m], [m/s]
    times : (k,) ascending, since the last whole period  [s]
    samples : (k, 2 n + 2) written: (q, q', U, U') at `times`
    impacts : (capacity, 2 + 2 n) written: time since the run began [s], closing speed [m/s], (q, q') before

    Returns
    -------
    outcome : DONE, SETTLED, DIVERGED, SPENT, or STALLED where the loads of laws converge over no step
    """
    n = state.y.size
    ye, ve = state.y.copy(), state.v.copy()
    sample, done = 0, 0
    begin = state.counters[SECTIONS]
    while done < periods:
        r, time = state.counters[REGIME], state.clock[0]
        outcome, tau, step = next_step(problem, state, w, ye, ve)
        if outcome == FAILED:
            return DIVERGED
        if outcome == UNCONVERGED:
            return STALLED
        if state.counters[STEPS] > budget:
            return SPENT
        since = (state.counters[AT_PERIOD] - begin) * problem.period + time
        to_end = problem.period - time
        ends = tau >= to_end and state.counters[SECTIONS] == state.counters[AT_PERIOD]
        last = ends and done == periods - 1
        while sample < times.size and (times[sample] < since + tau or last):
            at = min(max(times[sample] - since, 0.0), tau)
            flow_within(problem, state, step, at, w, ye, ve)
            write_row(problem, r, ye, ve, time, at, step, w, samples[sample])
            sample += 1

        settled = False
        if ends:
            flow_within(problem, state, step, to_end, w, ye, ve)
            write_row(problem, r, ye, ve, time, to_end, step, w, sections[done])
            state.counters[SECTIONS] += 1
            done += 1
            if not within(sections[done - 1], n, state.limits):
                return DIVERGED
            settled = tolerance > 0.0 and _has_settled(sections, done - 1, n, tolerance)
            if not problem.exact and (settled or done == periods):
                return SETTLED if settled else DONE  # the step in hand is taken again when the run goes on

        if not complete_step(problem, state, outcome, tau, step, impacts, w, ye, ve):
            return DIVERGED
        if settled:
            return SETTLED
    return DONE
