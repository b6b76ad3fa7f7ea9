"""The map of a period: the state at phase zero to the state one period on."""

import numpy as np

from calib.simulators.impact import kernel
from calib.simulators.impact.problem import IMPACTS, Problem
from calib.simulators.impact.run import start
from calib.simulators.impact.scratch import scratch


def period_map(problem: Problem, x: np.ndarray, capacity: int = 4096) -> tuple[np.ndarray, np.ndarray]:
    """Go on from phase zero by one period.

    Parameters
    ----------
    x : (2 n,) coordinates [m] and velocities [m/s]; on the stop and not leaving it means contact. Internal states of
        force laws start at zero
    capacity : impacts that are kept

    Returns
    -------
    x : (2 n,) one period on; NaN where the motion diverges
    impacts : (k, 2 + 2 n) time since phase zero [s], closing speed [m/s], state before
    """
    n = len(x) // 2
    state = start(problem, x[:n], x[n:])
    row, impacts = np.zeros((1, 2 * n + 2)), np.zeros((capacity, 2 + 2 * n))
    code = kernel.advance(problem, state, scratch(n), 1, 0.0, kernel.UNLIMITED, row, np.zeros(0), row[:0], impacts)
    after = row[0, : 2 * n] if code == kernel.DONE else np.full(2 * n, np.nan)
    return after, impacts[: min(capacity, int(state.count[IMPACTS]))]
