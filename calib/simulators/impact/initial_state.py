"""The state that a run starts from, and the coordinates of a state."""

import math

import numpy as np

from calib.modelling.laws import STATES
from calib.simulators.impact.coordinates import modal_row, to_coordinates
from calib.simulators.impact.problem import (
    CLOSING,
    COMPRESSION,
    CONTACT,
    FREE,
    HIT,
    LAW_STATES,
    PARTED,
    REGIME,
    RELEASED,
    TOUCH,
    ImpactState,
    Problem,
)
from calib.simulators.impact.scratch import scratch

DIVERGENCE_FACTOR = 1e6  # of a motion that counts as diverged, over the largest displacement to be expected  [1]


def start(problem: Problem, q: np.ndarray, dq: np.ndarray) -> ImpactState:
    """Return the state at phase zero with coordinates q [m] and velocities dq [m/s] (n,).

    Where the stop would be penetrated, or is touched and not being left, the run starts in contact. A compliant stop is
    penetrated as it is given; the closing speed at which that contact began is taken from the energy that it holds,
    without losses.
    """
    both, omega = problem.regimes, problem.omega
    u, du = problem.table[0, :2] if len(problem.table) else (0.0, 0.0)

    def modal(r: int, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = both.project[r] @ (q - both.motion[r] @ [1.0, 0.0, 1.0] - both.motion_input[r] * u)
        return y, both.project[r] @ (dq - both.motion[r] @ [0.0, omega, 0.0] - both.motion_input[r] * du)

    y, v = modal(FREE, q, dq)
    touch, regime, speed = 0, FREE, 0.0
    if problem.stop:
        acceleration = -2.0 * both.rate[FREE] * v - both.stiffness[FREE] * y
        clearance = both.witness_y[FREE] @ y + both.witness[FREE] @ [1.0, 0.0, 1.0] + both.witness_input[FREE, 0] * u
        rate = both.witness_y[FREE] @ v + both.witness[FREE] @ [0.0, omega, 0.0] + both.witness_input[FREE, 0] * du
        opening = both.witness_y[FREE] @ acceleration - both.witness[FREE, 0] * omega**2
        # a state from within a contact lies beside the surface by rounding
        at_rest = abs(clearance) <= problem.height and abs(rate) * problem.lift <= problem.height and opening < 0.0
        if problem.compliance is not None:
            regime, touch, speed = _in_compliance(problem, -clearance, -rate)
        elif clearance <= 0.0 or at_rest:
            q = q - clearance * problem.hit
            regime = CONTACT if rate < 0.0 or at_rest else FREE
            touch = 0 if regime == CONTACT else (HIT if rate > 0.0 else RELEASED)
            y, v = modal(regime, q, dq - rate * problem.hit if regime == CONTACT else dq)
    z, counters = np.zeros((*problem.acts.shape, STATES)), np.zeros(7, dtype=np.int64)
    state = ImpactState(y, v, z, np.zeros(3), counters, _limits(problem, q, dq))
    state.counters[REGIME], state.counters[TOUCH] = regime, touch
    state.clock[CLOSING] = speed
    return state


def _limits(problem: Problem, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Displacement [m] and velocity [m/s] (2,) beyond which a motion from q, q' (n,) counts as diverged."""
    slowest = max(
        math.sqrt(np.abs(problem.regimes.stiffness[FREE]).min()), 1.0 / max(abs(problem.period), np.finfo(float).tiny)
    )
    extent = max(problem.extent, np.abs(q).max(), np.abs(dq).max() / slowest)
    return DIVERGENCE_FACTOR * extent * np.array([1.0, problem.fastest])


def _in_compliance(problem: Problem, depth: float, rate: float) -> tuple[int, int, float]:
    """Regime, touch and closing speed [m/s] of a start with this penetration [m] and rate [m/s]."""
    if depth < 0.0 or (depth == 0.0 and rate > 0.0):  # the latter meets the surface at once
        return FREE, 0, 0.0
    if depth == 0.0:
        return FREE, HIT if rate < 0.0 else RELEASED, 0.0
    law = problem.compliance
    speed = math.sqrt(rate**2 + 2.0 * law.stiffness * depth ** (law.exponent + 1.0) / (law.exponent + 1.0))
    loss = law.loss / max(speed, law.slowest) if law.by_speed else law.loss
    force = law.stiffness * depth**law.exponent * (1.0 + loss * rate) + law.damping * rate
    return COMPRESSION if force > 0.0 else PARTED, 0, speed


def coordinates_at_phase_zero(problem: Problem, state: ImpactState) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates [m] and velocities [m/s] (n,) of a state at phase zero."""
    n, w = len(state.y), scratch(problem)
    u, du = problem.table[0, :2] if len(problem.table) else (0.0, 0.0)
    to_coordinates(
        problem.regimes, modal_row(state.counters[REGIME]), state.y, state.v, problem.omega, state.clock[0], u, du,
        w.q, w.dq,
    )  # fmt: skip
    return w.q[:n], w.dq[:n]


def remembers_speed(problem: Problem) -> bool:
    """Whether the state in a contact holds the closing speed at which that began."""
    return problem.compliance is not None and problem.compliance.by_speed


def memory(problem: Problem, state: ImpactState) -> np.ndarray:
    """Return what a state holds beside coordinates and velocities.

    These are the internal states of the force laws, where there are any, and the closing speed at which the present
    contact began [m/s], where its loss depends on that; zero out of contact.
    """
    laws = state.z.ravel() if problem.counts[LAW_STATES] else np.zeros(0)
    if not remembers_speed(problem):
        return laws
    return np.append(laws, state.clock[CLOSING] if state.counters[REGIME] != FREE else 0.0)


def with_memory(problem: Problem, state: ImpactState, values: np.ndarray) -> ImpactState:
    """Return the state with the `memory` that a motion ended with, also one with fewer or more force laws.

    Laws take over states by their position: those before one that is added or left out go on from their own.
    """
    of_a_law = math.prod(state.z.shape[1:])
    if values.size % of_a_law == 1:
        if remembers_speed(problem) and values[-1] > 0.0 and state.counters[REGIME] != FREE:
            state.clock[CLOSING] = values[-1]
        values = values[:-1]
    if values.size % of_a_law == 0:
        common = min(values.size, state.z.size)
        state.z.ravel()[:common] = values[:common]
    return state
