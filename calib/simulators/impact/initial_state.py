"""The state that a run starts from, and the coordinates of a state."""

import numpy as np

from calib.modelling.laws import STATES
from calib.simulators.impact.coordinates import to_coordinates
from calib.simulators.impact.problem import CONTACT, FREE, HIT, REGIME, RELEASED, TOUCH, ImpactState, Problem
from calib.simulators.impact.scratch import scratch


def start(problem: Problem, q: np.ndarray, dq: np.ndarray) -> ImpactState:
    """Return the state at phase zero with coordinates q [m] and velocities dq [m/s] (n,).

    Where the stop would be penetrated, or is touched and not being left, the run starts in contact.
    """
    both, omega = problem.regimes, problem.omega
    u, du = problem.table[0, :2] if len(problem.table) else (0.0, 0.0)

    def modal(r: int, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = both.project[r] @ (q - both.motion[r] @ [1.0, 0.0, 1.0] - both.motion_input[r] * u)
        return y, both.project[r] @ (dq - both.motion[r] @ [0.0, omega, 0.0] - both.motion_input[r] * du)

    y, v = modal(FREE, q, dq)
    touch, regime = 0, FREE
    if problem.stop:
        acceleration = -2.0 * both.rate[FREE] * v - both.stiffness[FREE] * y
        clearance = both.witness_y[FREE] @ y + both.witness[FREE] @ [1.0, 0.0, 1.0] + both.witness_input[FREE, 0] * u
        rate = both.witness_y[FREE] @ v + both.witness[FREE] @ [0.0, omega, 0.0] + both.witness_input[FREE, 0] * du
        opening = both.witness_y[FREE] @ acceleration - both.witness[FREE, 0] * omega**2
        # a state from within a contact lies beside the surface by rounding
        at_rest = abs(clearance) <= problem.height and abs(rate) * problem.lift <= problem.height and opening < 0.0
        if clearance <= 0.0 or at_rest:
            q = q - clearance * problem.hit
            regime = CONTACT if rate < 0.0 or at_rest else FREE
            touch = 0 if regime == CONTACT else (HIT if rate > 0.0 else RELEASED)
            y, v = modal(regime, q, dq - rate * problem.hit if regime == CONTACT else dq)
    state = ImpactState(y, v, np.zeros((*problem.acts.shape, STATES)), np.zeros(2), np.zeros(7, dtype=np.int64))
    state.counters[REGIME], state.counters[TOUCH] = regime, touch
    return state


def coordinates_at_phase_zero(problem: Problem, state: ImpactState) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates [m] and velocities [m/s] (n,) of a state at phase zero."""
    n, w = len(state.y), scratch(len(state.y))
    u, du = problem.table[0, :2] if len(problem.table) else (0.0, 0.0)
    to_coordinates(
        problem.regimes, state.counters[REGIME], state.y, state.v, problem.omega, state.clock[0], u, du, w.q, w.dq
    )
    return w.q[:n], w.dq[:n]


def with_law_states(state: ImpactState, law_states: np.ndarray) -> ImpactState:
    """Return the state with the internal states of the force laws that a motion ended with, where the sizes agree."""
    if law_states.size == state.z.size:
        state.z[:] = law_states.reshape(state.z.shape)
    return state
