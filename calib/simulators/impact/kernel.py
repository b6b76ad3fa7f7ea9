"""The run: flight, event, flight, until the asked number of periods is done."""

import math

from numba import njit

from calib.simulators.compilation import COMPILED, WITHIN
from calib.simulators.impact.collocation import collocate
from calib.simulators.impact.coordinates import to_coordinates
from calib.simulators.impact.events import meet_stop
from calib.simulators.impact.flow import flow
from calib.simulators.impact.polynomial import polynomial, slope
from calib.simulators.impact.problem import AT_PERIOD, CONTACT, PIECE, REGIME, SECTIONS, STEPS, TOUCH
from calib.simulators.impact.witness import BROKEN, FOUND, first_zero, witness

DONE, SETTLED, DIVERGED, SPENT = 0, 1, 2, 3  # how a run ends
UNLIMITED = 2**62  # steps
LONGEST = 16  # periods of a motion that counts as settled
SHORTEST = 1.0 / 2048.0  # of the longest step: shorter ones are not halved, whether their loads hold or not
AGAIN = 6  # times a step is taken anew up to the event in it


@njit(**WITHIN)
def write_row(problem, r, y, v, time, tau, step, w, row):
    """Write (q, q', U, U') at `tau` into the step that began at `time` [s] since the whole period."""
    n = w.q.size
    u = polynomial(w.input, tau / step)
    du = slope(w.input, tau / step) / step
    to_coordinates(problem.regimes, r, y, v, problem.omega, time + tau, u, du, w.q, w.dq)
    for j in range(n):
        row[j] = w.q[j]
        row[n + j] = w.dq[j]
    row[2 * n] = u
    row[2 * n + 1] = du


@njit(**WITHIN)
def within(row, n, limit):
    """Whether all displacements and velocities of a row are below the limit (and are numbers)."""
    size = 0.0
    for j in range(2 * n):
        size = max(size, abs(row[j])) if math.isfinite(row[j]) else math.inf
    return size < limit


@njit(**WITHIN)
def _has_settled(sections, last, n, tolerance):
    """Whether the last section equals one of the 16 before, in q and in q', to a share of the largest of either."""
    for back in range(1, min(LONGEST, last) + 1):
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


@njit(**WITHIN)
def _step_length(problem, state):
    """Length of the next step [s]; where events are located it ends with the period, the grid, the table's piece."""
    if not problem.exact:
        return problem.step
    time, period = state.clock[0], problem.period
    reach = period - time
    if problem.collocated:
        grid = period / math.ceil(period / problem.step - 1e-9)
        reach = min(reach, (math.floor(time / grid + 1e-9) + 1.0) * grid - time)
    pieces = problem.table.shape[0]
    if pieces > 0:
        while state.count[PIECE] < pieces - 1 and time >= problem.knots[state.count[PIECE] + 1]:
            state.count[PIECE] += 1
        if state.count[PIECE] < pieces - 1:
            reach = min(reach, problem.knots[state.count[PIECE] + 1] - time)
    return reach


@njit(**WITHIN)
def fly(problem, state, w, ye, ve):
    """Take one step: its loads are worked out and its end is found.

    A step over which the loads do not hold is halved; the next ones are at most twice as long as the one before.
    A step that an event ends is taken anew up to the event where laws act: at its end the collocation is of order 8,
    within it only of order 5. Where the loads do not hold up to there, the event is taken from a shorter step.

    Returns
    -------
    outcome : of `first_zero`
    tau : when the step ends  [s]
    step : length over which the loads' polynomials hold  [s]
    """
    r, time = state.count[REGIME], state.clock[0]
    step = _step_length(problem, state)
    wary = problem.exact and problem.counts[0] > 0
    if wary and 2.0 * w.trust[0] < 0.99 * step:  # no sliver is left of it, which rounding might make nothing of
        step = 2.0 * w.trust[0]
    search = problem.exact and problem.stop
    halved, again, rough = False, 0, False
    while True:
        state.count[STEPS] += 1
        if problem.collocated:
            converged = collocate(problem, r, state, time, step, w)
            if not converged and problem.exact and step > SHORTEST * problem.step:
                halved, rough = True, rough or again > 0
                again = 0
                step *= 0.5
                continue
        if wary and again == 0:
            w.trust[0] = step if halved else max(w.trust[0], step)
        if again > 0:
            flow(problem.regimes, r, state.y, state.v, problem.collocated, w.load, step, step, ye, ve)
            value, first, _, _ = witness(
                problem.regimes, r, ye, ve, problem.omega, time + step, problem.collocated, w.load, w.added, step,
                step, 0.0,
            )  # fmt: skip
            move = -value / first if first < 0.0 else 0.0
            if abs(move) <= problem.resolution or again == AGAIN or step + move <= 0.0:
                return FOUND, step, step
            again += 1
            step += move
            continue
        if not search:
            return 0, step, step
        outcome, tau, jumps = first_zero(
            problem.regimes, r, state.count[TOUCH], state.y, state.v, problem.omega, time, problem.collocated, w.load,
            w.added, step, step, problem.resolution, problem.lift, ye, ve,
        )  # fmt: skip
        state.count[STEPS] += jumps
        if outcome != FOUND or problem.counts[0] == 0 or rough or tau <= 0.0:
            return outcome, tau, step
        again = 1
        step = tau


@njit(**COMPILED)
def advance(problem, state, w, periods, tolerance, budget, sections, times, samples, impacts):
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
    outcome : DONE, SETTLED, DIVERGED or SPENT
    """
    n = state.y.size
    ye, ve = state.y.copy(), state.v.copy()
    sample, done = 0, 0
    begin = state.count[SECTIONS]
    regimes, loaded = problem.regimes, problem.collocated
    while done < periods:
        r, time = state.count[REGIME], state.clock[0]
        outcome, tau, step = fly(problem, state, w, ye, ve)
        if outcome == BROKEN:
            return DIVERGED
        if state.count[STEPS] > budget:
            return SPENT
        since = (state.count[AT_PERIOD] - begin) * problem.period + time
        last = problem.exact and done == periods - 1 and outcome != FOUND and time + tau >= problem.period
        while sample < times.size and (times[sample] < since + tau or last):
            at = min(max(times[sample] - since, 0.0), tau)
            flow(regimes, r, state.y, state.v, loaded, w.load, step, at, ye, ve)
            write_row(problem, r, ye, ve, time, at, step, w, samples[sample])
            sample += 1

        to_end = problem.period - time
        ends, settled = tau >= to_end, False
        if ends and state.count[SECTIONS] == state.count[AT_PERIOD]:
            flow(regimes, r, state.y, state.v, loaded, w.load, step, to_end, ye, ve)
            write_row(problem, r, ye, ve, time, to_end, step, w, sections[done])
            state.count[SECTIONS] += 1
            done += 1
            if not within(sections[done - 1], n, problem.limit):
                return DIVERGED
            settled = tolerance > 0.0 and _has_settled(sections, done - 1, n, tolerance)
            if not problem.exact and (settled or done == periods):
                return SETTLED if settled else DONE  # the step in hand is taken again when the run goes on

        flow(regimes, r, state.y, state.v, loaded, w.load, step, tau, ye, ve)
        if not math.isfinite(ye[0] + ve[0]):
            return DIVERGED
        for i in range(n):
            state.y[i], state.v[i] = ye[i], ve[i]
        if problem.counts[3] > 0 and tau > 0.0:
            for i in range(state.z.shape[0]):
                for b in range(state.z.shape[1]):
                    for k in range(state.z.shape[2]):
                        state.z[i, b, k] = w.z[i, b, k, 4]
        if r == CONTACT:
            state.clock[1] += tau
        state.count[TOUCH] = 0
        if problem.stop and (outcome == FOUND or not problem.exact):
            meet_stop(problem, state, time, tau, step, outcome == FOUND, impacts, w)
        state.clock[0] = time + tau
        if ends:
            state.count[AT_PERIOD] += 1
            state.clock[0] = 0.0 if problem.exact else time + tau - problem.period
            if settled:
                return SETTLED
    return DONE
