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
    budget: int,
    sections: np.ndarray,
    times: np.ndarray,
    samples: np.ndarray,
    capacity: int,
) -> tuple[int, np.ndarray]:
    """Go on by so many periods; where the impacts outnumber `capacity`, run the same again with room for all.

    The arguments are those of `kernel.advance`.

    Returns
    -------
    outcome : of `kernel.advance`
    impacts : (k, 2 + 2 n) all impacts of a run that is done, as `kernel.advance` writes them
    """
    arrays = [a for a in (*state, *w) if a is not None]
    before = [a.copy() for a in arrays]
    width = 2 + 2 * len(state.y)
    while True:
        impacts = np.empty((capacity, width))
        state.counters[IMPACTS] = 0
        outcome = kernel.advance(problem, state, w, periods, 0.0, budget, sections, times, samples, impacts)
        count = int(state.counters[IMPACTS])
        if count <= capacity or outcome != kernel.DONE:
            return outcome, impacts[:count]
        capacity = count
        for array, values in zip(arrays, before, strict=True):
            array[...] = values
