"""What the trials that fit nearly as well as the best one have in common."""

import math
from collections.abc import Sequence

import numpy as np

from calib.modelling.parameter import Space
from calib.store import Trial
from calib.units import plain_number

NEAR_OPTIMAL_RATIO = 1.25  # distance over the best one, up to which a trial fits nearly as well  [1]
MIN_NEAR_OPTIMAL_TRIALS = 12  # that fit nearly as well: fewer describe nothing  [count]
MAX_WINDOW_SPAN = 0.25  # of the window: a parameter that spans more is not determined  [1]


def describe_near_optimal(space: Space, trials: Sequence[Trial], units: dict[str, str]) -> str:
    """Describe the range of each parameter among the trials that fit nearly as well as the best one.

    It takes the place of intervals where the residuals are not differentiable. It covers only points of the search: a
    parameter that spans much of its window is not determined; one that spans little may owe that to the search.

    Parameters
    ----------
    trials : of the search
    units : SI unit of each parameter

    Returns
    -------
    one sentence without its full stop; empty where too few trials fit that well
    """
    best = min((trial.cost for trial in trials), default=math.inf)
    near = np.array([trial.u for trial in trials if trial.cost <= NEAR_OPTIMAL_RATIO * best < math.inf])
    if len(near) < MIN_NEAR_OPTIMAL_TRIALS:
        return ""
    low, high = near.min(axis=0), near.max(axis=0)
    wide = [name for name, span in zip(space.names, high - low, strict=True) if span > MAX_WINDOW_SPAN]
    ends = space.values(low), space.values(high)
    shared = [
        f"{n} {plain_number(ends[0][n], 3)} .. {plain_number(ends[1][n], 3)} {units[n]}"
        for n in space.names
        if n not in wide
    ]
    parts = []
    if shared:
        parts.append(f"have {', '.join(shared)} in common")
    if wide:
        parts.append(f"span more than a quarter of the windows of {', '.join(wide)}, which are not determined")
    percent = 100 * (NEAR_OPTIMAL_RATIO - 1)
    return f"{len(near)} trials are within {percent:.0f} % of the best distance; they {' and '.join(parts)}"
