"""The input over a step as a polynomial: the table's piece, and what the laws of the excitation add."""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import ENCLOSED
from calib.simulators.impact.polynomial import BETWEEN, FIT, NODES, POINTS, PROBE_INDEX, polynomial
from calib.simulators.impact.problem import AT_PERIOD, EXCITATION_LAWS, PIECE, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch
from calib.simulators.law_calls import excitation

MAX_INPUT_ERROR = 1e-4  # of the polynomial between the nodes, over what the laws of the excitation add at them  [1]
MAX_INPUT_RATE_ERROR = 1e-3  # the same of its derivative, where the derivative of the input loads the structure  [1]
NEGLIGIBLE_INPUT = 1e-12  # of what these laws add, over the input: less is rounding  [1]
# largest derivative by x of the polynomial that vanishes at the nodes, over its value at the probe  [1]
RATE_OF_ERROR = float(np.prod(NODES[1:]) / abs(np.prod(POINTS[PROBE_INDEX] - NODES)))
MIN_INPUT_STEP = 2.0**-20  # of the longest step: shorter ones hold whatever the input does, which may jump  [1]


@njit(**ENCLOSED)
def set_input(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> bool:
    """Write the input U over the step (5,): the table's piece, and what the laws of the excitation add at the nodes.

    Returns
    -------
    resolved : whether the polynomial holds between the nodes
    """
    out = w.input
    for k in range(5):
        out[k] = 0.0
    if problem.knots.size > 1:
        piece = state.counters[PIECE]
        s = time - problem.knots[piece]
        row = problem.table[piece]
        c0, c1, c2, c3 = row[0], row[1], row[2], row[3]
        out[0] = c0 + s * (c1 + s * (c2 + s * c3))
        out[1] = (c1 + s * (2.0 * c2 + s * 3.0 * c3)) * step
        out[2] = (c2 + 3.0 * s * c3) * step * step
        out[3] = c3 * step * step * step
    if problem.counts[EXCITATION_LAWS] == 0:
        return True
    start = state.counters[AT_PERIOD] * problem.period + time
    error, size, largest, last, slope_size = 0.0, 0.0, abs(problem.amplitude), 0.0, 0.0
    for j in range(PROBE_INDEX + 1):
        local = time + POINTS[j] * step
        x = problem.amplitude * math.cos(problem.omega * local + problem.phase) + polynomial(out, POINTS[j])
        t = start + POINTS[j] * step
        change = 0.0
        for i in range(problem.counts[EXCITATION_LAWS]):
            change += excitation(
                problem.excitation[i], t, problem.omega * t + problem.phase, problem.amplitude, x,
                problem.excitation_p[i],
            )  # fmt: skip
        if j == PROBE_INDEX:
            error = abs(change - error)
            break
        w.base[0, j] = change
        error += BETWEEN[j] * change
        size, largest = max(size, abs(change)), max(largest, abs(x))
        if j > 0:
            slope_size = max(slope_size, abs(change - last) / (POINTS[j] - POINTS[j - 1]))
        last = change
    for k in range(5):
        for j in range(5):
            out[k] += FIT[k, j] * w.base[0, j]
    if step <= MIN_INPUT_STEP * problem.step or error <= NEGLIGIBLE_INPUT * largest:
        return True
    return error <= MAX_INPUT_ERROR * size and (
        not problem.loads.by_rate or RATE_OF_ERROR * error <= MAX_INPUT_RATE_ERROR * slope_size
    )
