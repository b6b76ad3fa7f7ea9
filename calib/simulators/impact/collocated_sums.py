"""Sums of the force laws at places over a step, where they are steep in the velocity.

Iterated with the sums of the last iterate the collocation converges only where a force law does little to the velocity
that it depends on over the step: not in friction that sticks, whose regularisation makes a strong damper of it, nor in
a power of the velocity below 1. There the sums are taken as linear in the velocity of their place at each node, and the
equations of the collocation are solved for them by Newton's method (Hairer and Wanner, Solving Ordinary Differential
Equations II (1996), section IV.8). What displacements do to the sums is left to the iteration.
"""

import numpy as np
from numba import njit

from calib.modelling.laws import STATES
from calib.simulators.compilation import ENCLOSED, WITHIN
from calib.simulators.impact.collocated_states import differentiate_rates
from calib.simulators.impact.elimination import eliminate
from calib.simulators.impact.polynomial import FIT, POINTS
from calib.simulators.impact.problem import CONTACT, FORCE_LAWS, Problem
from calib.simulators.impact.scratch import BY_VELOCITY, LOADING, POSITION, SUM, VELOCITY, Scratch
from calib.simulators.law_calls import force

VELOCITY_DIFFERENCE = 1e-6  # of a velocity, for the derivative of a law by it  [1]
MIN_VELOCITY_SHARE = 1e-6  # of the largest at the nodes without loads, the size of a velocity of zero  [1]


@njit(**ENCLOSED)
def differentiate_laws(problem: Problem, start: float, step: float, j: int, w: Scratch) -> None:
    """Write the derivatives of the laws at node `j`: of their sums by velocities, of their rates by their states."""
    t, z, dz, place = start + POINTS[j] * step, w.law_state[0], w.law_state[1], w.place
    for b in range(place.shape[1]):
        x, v, largest, moved = place[POSITION, b, j], place[VELOCITY, b, j], 0.0, 0.0
        for node in range(w.free_dq.shape[1]):
            largest = max(largest, abs(w.free_dq[b, node]))
        difference = VELOCITY_DIFFERENCE * max(abs(v), MIN_VELOCITY_SHARE * largest)
        for i in range(problem.counts[FORCE_LAWS]):
            if problem.acts[i, b]:
                for k in range(STATES):
                    z[k] = w.z[i, b, k, j]
                moved += force(problem.force[i], t, x, v + difference, problem.force_p[i], z, dz)
                differentiate_rates(problem, i, b, t, x, v, step, j, w)
        place[BY_VELOCITY, b, j] = (moved - place[SUM, b, j]) / difference if difference > 0.0 else 0.0


@njit(**ENCLOSED)
def set_couplings(problem: Problem, r: int, w: Scratch) -> None:
    """Write the velocities at places and nodes per unit of the sum of laws at each place and node."""
    contact, push, coupling = r == CONTACT, problem.push, w.coupling
    _couple(problem.regimes.shape[r], problem.regimes.project[r], problem.regimes.witness_y[r], contact, push,
            w.response_v, coupling)  # fmt: skip


@njit(**WITHIN)
def _couple(
    shape: np.ndarray, project: np.ndarray, witness: np.ndarray, contact: bool, push: np.ndarray, response: np.ndarray,
    coupling: np.ndarray,
) -> None:  # fmt: skip
    """`set_couplings` with the parts of its problem; the clearance does not move in contact."""
    n, nodes = push.size, FIT.shape[0]
    coupling[:] = 0.0
    for i in range(n):
        load_of_port = 0.0
        for b in range(n):
            load_of_port += project[i, b] * push[b]
        for j in range(nodes):
            for node in range(nodes):
                by_load = 0.0
                for k in range(nodes):
                    by_load += response[i, j, k] * FIT[k, node]
                for b in range(n + 1):
                    velocity = by_load * (shape[b, i] if b < n else 0.0 if contact else witness[i])
                    for c in range(n + 1):
                        load = project[i, c] if c < n else load_of_port
                        coupling[b * nodes + j, c * nodes + node] += velocity * load


@njit(**WITHIN)
def extrapolate_sums(place: np.ndarray) -> None:
    """Write the sums at the nodes beyond the first as linear in the velocities there, from that node on."""
    for b in range(place.shape[1]):
        value, slope = place[SUM, b, 0], place[BY_VELOCITY, b, 0]
        for j in range(FIT.shape[0]):
            place[LOADING, b, j], place[BY_VELOCITY, b, j] = value, slope
            place[SUM, b, j] = value + slope * (place[VELOCITY, b, j] - place[VELOCITY, b, 0])
        place[BY_VELOCITY, b, 0] = 0.0  # there neither velocity nor sum changes


@njit(**WITHIN)
def solve_sums(
    push: np.ndarray, place: np.ndarray, coupling: np.ndarray, equations: np.ndarray, law: np.ndarray
) -> None:
    """Write the sums at the nodes from those evaluated and their derivatives, and the laws of them.

    Only sums that depend on the velocity are unknown; the others are as they were evaluated.
    """
    n, nodes, lines, unknown = push.size, FIT.shape[0], coupling.shape[0], 0
    for line in range(lines):
        b, j, column = line // nodes, line % nodes, 0
        slope, change = place[BY_VELOCITY, b, j], place[SUM, b, j] - place[LOADING, b, j]
        if slope != 0.0:
            for other in range(lines):
                c, node = other // nodes, other % nodes
                if place[BY_VELOCITY, c, node] != 0.0:
                    equations[unknown, column] = (1.0 if other == line else 0.0) - slope * coupling[line, other]
                    column += 1
                else:
                    change += slope * coupling[line, other] * (place[SUM, c, node] - place[LOADING, c, node])
            equations[unknown, column] = change
            unknown += 1
    eliminate(equations, unknown)
    row = 0
    for b in range(n + 1):
        for j in range(nodes):
            if place[BY_VELOCITY, b, j] != 0.0:
                place[LOADING, b, j] += equations[row, unknown]
                row += 1
            else:
                place[LOADING, b, j] = place[SUM, b, j]
    for j in range(1, nodes):
        for b in range(n):
            law[b, j] = place[LOADING, b, j] + push[b] * place[LOADING, n, j]
