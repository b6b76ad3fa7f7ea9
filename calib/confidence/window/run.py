"""The points of a window, asked batch by batch and evaluated into a store or read from it."""

from collections.abc import Callable, Mapping

import numpy as np
from threadpoolctl import threadpool_limits

from calib.confidence.window.design import WindowDesign, space_filling
from calib.confidence.window.margins import observed_of
from calib.execution.pool import Pool
from calib.store import Trial
from calib.store.trial import FORMER_CODE
from calib.study import CalibrationStudy
from calib.study.contracts import StoreContract
from calib.study.points import evaluate_points, header_without_search

WINDOW_BATCH = 16  # points that are chosen at a time


def explored(
    study: CalibrationStudy,
    start: np.ndarray,
    tolerances: Mapping[str, float],
    budget: int,
    seed: int,
    store: StoreContract,
    pool: Pool,
    fresh: bool = False,
    on_opened: Callable[[int], None] = lambda done: None,
    on_point: Callable[[int, int], None] = lambda done, total: None,
) -> list[Trial]:
    """Evaluate points until there are `budget` of them; return their trials in asking order.

    The first point is `start`; a space-filling design follows, then batches where the boundary is least certain. The
    next batch depends on the points before it alone: a run that was killed goes on with the same points.

    Parameters
    ----------
    start : (dim,) the calibrated point, in the unit cube
    tolerances : term -> largest distance of an admissible point
    store : closed at the end
    pool : maps values to an `Evaluation` or `Failure`
    fresh : set aside what the store has
    on_opened : called with the number of points that the store has already
    on_point : called with the number of points that are done, and of all

    Raises
    ------
    CalibError : the store belongs to another study, point or tolerances; the model refuses the first point
    KeyboardInterrupt : stopped by Ctrl-C; the points evaluated until then are kept
    """
    decides = {"start": start.tolist(), "tolerances": dict(tolerances), "batch": WINDOW_BATCH}
    logged = store.open(header_without_search(study, seed, "window", decides, budget), fresh)
    done = {trial.number: trial for trial in logged if trial.number < budget and trial.status != FORMER_CODE}
    design = WindowDesign(study.space.dim, seed)
    try:
        on_opened(len(done))
        first = 0
        while first < budget:
            with threadpool_limits(1):  # small matrices: more threads only wait for each other, and round otherwise
                points = _batch(design, [done[number] for number in range(first)], start, tolerances, budget - first)
            missing = {number: point for number, point in enumerate(points, first) if number not in done}
            evaluate_points(study, missing, done, store, pool, "search", lambda n: on_point(n, budget))
            first += len(points)
    finally:
        store.close()
    return [done[number] for number in range(budget)]


def _batch(
    design: WindowDesign, trials: list[Trial], start: np.ndarray, tolerances: Mapping[str, float], left: int
) -> np.ndarray:
    """Points that are evaluated after those of the trials, at most `left`."""
    if not trials:
        return start[None]
    whole = WINDOW_BATCH - len(trials) % WINDOW_BATCH  # whatever the budget: a larger one asks for the same points
    observed = observed_of(trials, tolerances)
    if not observed.right.any():
        return space_filling(design.dim, len(trials) + whole, design.seed)[len(trials) :][:left]
    return design.next_points(observed, whole)[:left]
