"""Internal states of force laws over a step, from their rates at the nodes of the collocation.

A state z' = g(t, x, v, z) is its value at the start of the step and the integral of its rate. Iterated with the rates
of the last iterate that converges only where a state does little to its own rate over the step: not where it comes to
rest within a small part of it, as friction does whose stroke is many times its yield displacement. There the rates are
taken as linear in their own state at each node, and the equations of the collocation are solved for the states by
Newton's method (Hairer and Wanner, Solving Ordinary Differential Equations II (1996), section IV.8). What one state
does to the rate of another is left to the iteration.
"""

import numpy as np
from numba import njit

from calib.modelling.laws import STATES
from calib.simulators.compilation import ENCLOSED, WITHIN
from calib.simulators.impact.elimination import eliminate
from calib.simulators.impact.law_states import STATE_DIFFERENCE
from calib.simulators.impact.polynomial import INTEGRAL
from calib.simulators.impact.problem import FORCE_LAWS, Problem
from calib.simulators.impact.scratch import Scratch
from calib.simulators.law_calls import force

MIN_SIZE_SHARE = 1e-6  # of what its rate makes in a step, the size of a state that is zero at all nodes  [1]


@njit(**ENCLOSED)
def hold_states(z: np.ndarray, w: Scratch) -> None:
    """Let the internal states keep their value at all nodes."""
    for i in range(z.shape[0]):
        for b in range(z.shape[1]):
            for k in range(z.shape[2]):
                for j in range(5):
                    w.z[i, b, k, j] = z[i, b, k]
                    w.dz[i, b, k, j] = 0.0


@njit(**ENCLOSED)
def integrate_states(problem: Problem, z: np.ndarray, step: float, first: int, end: int, w: Scratch) -> None:
    """Write the internal states at some of the points from their rates at the nodes."""
    for i in range(problem.counts[FORCE_LAWS]):
        for b in range(z.shape[1]):
            for k in range(z.shape[2]):
                for j in range(first, end):
                    total = 0.0
                    for node in range(5):
                        total += INTEGRAL[j, node] * w.dz[i, b, k, node]
                    w.z[i, b, k, j] = z[i, b, k] + step * total


@njit(**ENCLOSED)
def differentiate_rates(
    problem: Problem, i: int, b: int, t: float, x: float, v: float, step: float, j: int, w: Scratch
) -> None:
    """Write the derivatives by its own state of each rate of a law at a coordinate that moves by x, v, at node `j`."""
    z, dz = w.law_state[0], w.law_state[1]
    for k in range(STATES):
        own, rate, size = w.z[i, b, k, j], w.dz[i, b, k, j], 0.0
        for node in range(5):
            size = max(size, abs(w.z[i, b, k, node]))
        difference = STATE_DIFFERENCE * max(size, MIN_SIZE_SHARE * step * abs(rate))
        w.by_state[i, b, k, j] = 0.0
        if difference > 0.0:
            z[k] = own + difference
            for s in range(STATES):
                dz[s] = 0.0
            force(problem.force[i], t, x, v, problem.force_p[i], z, dz)
            w.by_state[i, b, k, j] = (dz[k] - rate) / (z[k] - own)
            z[k] = own


@njit(**ENCLOSED)
def solve_states(problem: Problem, z: np.ndarray, step: float, w: Scratch) -> None:
    """Write the internal states at the nodes from their rates there and the derivatives of these."""
    for i in range(problem.counts[FORCE_LAWS]):
        for b in range(z.shape[1]):
            for k in range(z.shape[2]):
                if problem.acts[i, b]:
                    _solve_state(z[i, b, k], w.z[i, b, k], w.dz[i, b, k], w.by_state[i, b, k], step, w.equations)


@njit(**WITHIN)
def _solve_state(
    start: float, own: np.ndarray, rate: np.ndarray, by_state: np.ndarray, step: float, equations: np.ndarray
) -> None:
    """Write one state `own` at the nodes beyond the first, where its rate is rate + by_state (new - own)."""
    for j in range(4):
        total = INTEGRAL[j + 1, 0] * rate[0]
        for node in range(1, 5):
            weight = INTEGRAL[j + 1, node]
            total += weight * (rate[node] - by_state[node] * own[node])
            equations[j, node - 1] = (1.0 if node == j + 1 else 0.0) - step * weight * by_state[node]
        equations[j, 4] = start + step * total
    eliminate(equations, 4)
    for j in range(4):
        own[j + 1] = equations[j, 4]
