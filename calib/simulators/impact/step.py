"""One step of the motion: its loads, its end, and the event at its end.

Every run goes on by `next_step`, which leaves the state where it is, and `complete_step`, which takes the state to the
end of the step. What a run samples within the step, it works out between the two.
"""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED, ENCLOSED_INLINED
from calib.simulators.impact.collocation import LOADS_HOLD, MISSED_BETWEEN, NOT_CONVERGED
from calib.simulators.impact.events import meet_stop
from calib.simulators.impact.flow import flow
from calib.simulators.impact.kinds import by_stop
from calib.simulators.impact.loads import set_loads
from calib.simulators.impact.problem import (
    AT_PERIOD,
    COMPRESSION,
    CONTACT,
    EXCITATION_LAWS,
    FORCE_LAWS,
    FREE,
    LAW_STATES,
    PIECE,
    REGIME,
    STEPS,
    TOUCH,
    ImpactState,
    Problem,
)
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.series import motion_within
from calib.simulators.impact.surface import meet_surface, next_step_in_contact
from calib.simulators.impact.witness import EVENT, NO_EVENT, first_zero, witness

MIN_STEP_FRACTION = 1.0 / 2048.0  # of the longest step: shorter ones are not halved where laws are missed between nodes
MIN_CONVERGED_FRACTION = 2.0**-40  # of the longest step: no loads converge that do not over so short a step
UNCONVERGED = 3  # outcome of a step, beside those of `first_zero`
MAX_RETAKES = 6  # times a step is taken anew up to the event in it


@njit(**ENCLOSED)
def _step_length(problem: Problem, state: ImpactState) -> float:
    """Length of the next step [s]; where events are located it ends with the period, the grid, the table's piece."""
    if not problem.exact:
        return problem.step
    time, period = state.clock[0], problem.period
    reach = period - time
    if problem.loads is not None:
        grid = period / math.ceil(period / problem.step - 1e-9)
        reach = min(reach, (math.floor(time / grid + 1e-9) + 1.0) * grid - time)
    pieces = problem.table.shape[0]
    if pieces > 0:
        while state.counters[PIECE] < pieces - 1 and time >= problem.knots[state.counters[PIECE] + 1]:
            state.counters[PIECE] += 1
        if state.counters[PIECE] < pieces - 1:
            reach = min(reach, problem.knots[state.counters[PIECE] + 1] - time)
    return reach


@njit(**ENCLOSED)
def next_step_out_of_compliance(
    problem: Problem, state: ImpactState, w: Scratch, ye: np.ndarray, ve: np.ndarray
) -> tuple[int, float, float]:
    """Work out the loads over the next step, and find where it ends.

    A step over which the loads do not hold is halved; the next ones are at most twice as long as the one before.
    A step that an event ends is taken anew up to the event where laws act: at its end the collocation is of order 8,
    within it only of order 5. Where the loads do not hold up to there, the event is taken from a shorter step.

    Returns
    -------
    outcome : of `first_zero`; UNCONVERGED where the loads of laws do not converge over any step
    tau : when the step ends  [s]
    step : length over which the loads' polynomials hold  [s]
    """
    r, time, loaded = state.counters[REGIME], state.clock[0], problem.loads is not None
    step = _step_length(problem, state)
    laws_act = problem.exact and (problem.counts[FORCE_LAWS] > 0 or problem.counts[EXCITATION_LAWS] > 0)
    # 0.99: no sliver is left of the step, which rounding might make nothing of
    if laws_act and 2.0 * w.resolved_step[0] < 0.99 * step:
        step = 2.0 * w.resolved_step[0]
    search = problem.exact and problem.stop
    halved, retakes, unresolved = False, 0, False
    while True:
        state.counters[STEPS] += 1
        loads = set_loads(problem, r, state, time, step, w)
        if loads == NOT_CONVERGED and problem.exact and step <= MIN_CONVERGED_FRACTION * problem.step:
            return UNCONVERGED, 0.0, step
        shortest = MIN_STEP_FRACTION if loads == MISSED_BETWEEN else 0.0
        if loads != LOADS_HOLD and problem.exact and step > shortest * problem.step:
            halved, unresolved = True, unresolved or retakes > 0
            retakes = 0
            step *= 0.5
            continue
        if laws_act and retakes == 0:
            w.resolved_step[0] = step if halved else max(w.resolved_step[0], step)
        if retakes > 0:
            flow(problem.regimes, r, state.y, state.v, loaded, w.load, step, step, ye, ve)
            value, first, _, _ = witness(
                problem.regimes, r, ye, ve, problem.omega, time + step, loaded, w.load, w.added, step, step, 0.0
            )
            move = -value / first if first < 0.0 else 0.0
            if abs(move) <= problem.resolution or retakes == MAX_RETAKES or step + move <= 0.0:
                return EVENT, step, step
            retakes += 1
            step += move
            continue
        if not search:
            return NO_EVENT, step, step
        outcome, tau, jumps = first_zero(
            problem.regimes, r, state.counters[TOUCH], state.y, state.v, problem.omega, time, loaded, w.load, w.added,
            step, step, problem.resolution, problem.lift, ye, ve,
        )  # fmt: skip
        state.counters[STEPS] += jumps
        if outcome != EVENT or problem.counts[FORCE_LAWS] == 0 or unresolved or tau <= 0.0:
            return outcome, tau, step
        retakes = 1
        step = tau


@njit(**ENCLOSED)
def _next_step_with_compliance(
    problem: Problem, state: ImpactState, w: Scratch, ye: np.ndarray, ve: np.ndarray
) -> tuple[int, float, float]:
    if state.counters[REGIME] >= COMPRESSION:
        return next_step_in_contact(problem, state, _step_length(problem, state), w)
    return next_step_out_of_compliance(problem, state, w, ye, ve)


def _flow_with_rigid_stop(
    problem: Problem, state: ImpactState, step: float, tau: float, w: Scratch, y_end: np.ndarray, v_end: np.ndarray
) -> None:
    """Write the modal motion at `tau` into the step that `next_step` has worked out into y_end, v_end (n,)."""
    r, loaded = state.counters[REGIME], problem.loads is not None
    flow(problem.regimes, r, state.y, state.v, loaded, w.load, step, tau, y_end, v_end)


def _flow_with_compliance(
    problem: Problem, state: ImpactState, step: float, tau: float, w: Scratch, y_end: np.ndarray, v_end: np.ndarray
) -> None:
    if state.counters[REGIME] >= COMPRESSION:
        motion_within(problem.compliance, state, w, step, tau, y_end, v_end)
    else:
        flow(problem.regimes, FREE, state.y, state.v, problem.loads is not None, w.load, step, tau, y_end, v_end)


def _meet_rigid_stop(
    problem: Problem,
    state: ImpactState,
    outcome: int,
    time: float,
    tau: float,
    step: float,
    impacts: np.ndarray,
    w: Scratch,
) -> None:
    """Take the event, if there is one, at the end of a step."""
    if problem.stop and (outcome == EVENT or not problem.exact):
        meet_stop(problem, state, time, tau, step, outcome == EVENT, impacts, w)


def _meet_compliant_stop(
    problem: Problem,
    state: ImpactState,
    outcome: int,
    time: float,
    tau: float,
    step: float,
    impacts: np.ndarray,
    w: Scratch,
) -> None:
    if outcome == EVENT:
        meet_surface(problem, state, time, tau, step, impacts, w)


next_step = by_stop(next_step_out_of_compliance, _next_step_with_compliance, ENCLOSED)
flow_within = by_stop(_flow_with_rigid_stop, _flow_with_compliance, ENCLOSED_INLINED)
_meet = by_stop(_meet_rigid_stop, _meet_compliant_stop, ENCLOSED_INLINED)


@njit(**ENCLOSED_INLINED)
def complete_step(
    problem: Problem,
    state: ImpactState,
    outcome: int,
    tau: float,
    step: float,
    impacts: np.ndarray,
    w: Scratch,
    ye: np.ndarray,
    ve: np.ndarray,
) -> bool:
    """Take the state to the end of a step, and through the event there.

    Parameters
    ----------
    outcome, tau, step : of `next_step`
    impacts : written, as in `kernel.advance`
    ye, ve : (n,) written: the modal motion at the end of the step, before the event

    Returns
    -------
    finite : whether the motion is; the state is unchanged where it is not
    """
    r, time = state.counters[REGIME], state.clock[0]
    flow_within(problem, state, step, tau, w, ye, ve)
    if not math.isfinite(ye[0] + ve[0]):
        return False
    for i in range(state.y.size):
        state.y[i], state.v[i] = ye[i], ve[i]
    if problem.counts[LAW_STATES] > 0 and tau > 0.0:
        for i in range(state.z.shape[0]):
            for b in range(state.z.shape[1]):
                for k in range(state.z.shape[2]):
                    state.z[i, b, k] = w.z[i, b, k, 4]
    if r in (CONTACT, COMPRESSION):
        state.clock[1] += tau
    state.counters[TOUCH] = 0
    _meet(problem, state, outcome, time, tau, step, impacts, w)
    state.clock[0] = time + tau
    if tau >= problem.period - time:
        state.counters[AT_PERIOD] += 1
        state.clock[0] = 0.0 if problem.exact else time + tau - problem.period
    return True
