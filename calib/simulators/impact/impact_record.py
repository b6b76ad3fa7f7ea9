"""All impacts of a run, however many there are."""

import numpy as np

from calib.simulators.impact import kernel
from calib.simulators.impact.problem import IMPACTS, ImpactState, Problem
from calib.simulators.impact.scratch import Scratch


def advance_with_impacts(
    problem: Problem,
    state: ImpactState,
    w: Scratch,
    periods: int,
    tolerance: float,
    budget: int,
    sections: np.ndarray,
    times: np.ndarray,
    samples: np.ndarray,
    capacity: int,
) -> tuple[int, np.ndarray]:
    """Go on as `kernel.advance` does; where the impacts outnumber `capacity`, run the same again with room for all.

    Returns
    -------
    outcome : of `kernel.advance`
    impacts : (k, 2 + 2 n) all impacts on the way, as `kernel.advance` writes them
    """
    arrays = [a for a in (*state, *w) if a is not None]
    before = [a.copy() for a in arrays]
    width = 2 + 2 * len(state.y)
    while True:
        impacts = np.empty((capacity, width))
        state.counters[IMPACTS] = 0
        outcome = kernel.advance(problem, state, w, periods, tolerance, budget, sections, times, samples, impacts)
        count = int(state.counters[IMPACTS])
        if count <= capacity or outcome not in (kernel.DONE, kernel.SETTLED):
            return outcome, impacts[:count]
        capacity = count
        for array, values in zip(arrays, before, strict=True):
            array[...] = values
