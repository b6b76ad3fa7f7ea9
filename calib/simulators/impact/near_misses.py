"""Near misses: the local minima of the clearance between impacts."""

import math

import numpy as np
from numba import njit

from calib.simulators.compilation import COMPILED
from calib.simulators.impact.flow import flow
from calib.simulators.impact.problem import AT_PERIOD, FREE, REGIME, RELEASED, STEPS, TOUCH, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch
from calib.simulators.impact.step import UNCONVERGED, complete_step, next_step
from calib.simulators.impact.witness import FAILED, witness

SAMPLES_PER_PERIOD = 256  # of the clearance's rate in a period
BISECTIONS = 50  # of the interval that holds a minimum


@njit(**COMPILED)
def nearest_passes(
    problem: Problem, state: ImpactState, w: Scratch, budget: int, impacts: np.ndarray, minima: np.ndarray
) -> int:
    """Go on by one period and note the minima of the clearance.

    Parameters
    ----------
    state : State at phase zero, written
    budget : steps after which the search is given up
    impacts : (0, 2 + 2 n)
    minima : (k,) written  [m]

    Returns
    -------
    count : how many minima there were; -1 where the motion fails
    """
    count = 0
    ye, ve = state.y.copy(), state.v.copy()
    regimes, loaded = problem.regimes, problem.loads is not None
    while state.counters[AT_PERIOD] == 0:
        r, time = state.counters[REGIME], state.clock[0]
        outcome, tau, step = next_step(problem, state, w, ye, ve)
        if outcome in (FAILED, UNCONVERGED) or state.counters[STEPS] > budget:
            return -1
        if r == FREE:
            pieces = max(1, math.ceil(SAMPLES_PER_PERIOD * tau / problem.period))
            early, rate_early = 0.0, math.inf  # at the start of a flight the clearance opens
            for k in range(1 if state.counters[TOUCH] == RELEASED else 0, pieces + 1):
                at = tau * k / pieces
                flow(regimes, r, state.y, state.v, loaded, w.load, step, at, ye, ve)
                _, rate, _, _ = witness(
                    regimes, r, ye, ve, problem.omega, time + at, loaded, w.load, w.added, step, at, 0.0
                )
                if rate_early < 0.0 <= rate and count < minima.size:
                    low, high = early, at
                    for _ in range(BISECTIONS):
                        middle = 0.5 * (low + high)
                        flow(regimes, r, state.y, state.v, loaded, w.load, step, middle, ye, ve)
                        value, slope, _, _ = witness(
                            regimes, r, ye, ve, problem.omega, time + middle, loaded, w.load, w.added, step, middle, 0.0
                        )
                        if slope < 0.0:
                            low = middle
                        else:
                            high = middle
                    minima[count] = value
                    count += 1
                early, rate_early = at, rate
        if not complete_step(problem, state, outcome, tau, step, impacts, w, ye, ve):
            return -1
    return count
