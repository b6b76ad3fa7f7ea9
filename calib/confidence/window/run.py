"""The points of a window, asked batch by batch and evaluated into a store or read from it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from calib.confidence.window.design import WindowDesign, space_filling
from calib.confidence.window.margins import observed_of
from calib.errors import CalibError
from calib.execution.interrupt import uninterrupted
from calib.execution.pool import REFUSED, Failure, Pool
from calib.store import StudyHeader, Trial
from calib.store.trial import FORMER_CODE
from calib.study import CalibrationStudy
from calib.study.contracts import StoreContract
from calib.study.evaluation import as_trial

WINDOW_BATCH = 16  # points that are chosen at a time
SEARCH_KEYS = ("screen", "start", "batch", "optimiser")  # of a study's definition, of which a window has none


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
    logged = store.open(_header(study, start, tolerances, budget, seed), fresh)
    done = {trial.number: trial for trial in logged if trial.number < budget and trial.status != FORMER_CODE}
    design = WindowDesign(study.space.dim, seed)
    try:
        on_opened(len(done))
        first = 0
        while first < budget:
            with threadpool_limits(1):  # small matrices: more threads only wait for each other, and round otherwise
                points = _batch(design, [done[number] for number in range(first)], start, tolerances, budget - first)
            _evaluate(study, dict(enumerate(points, first)), done, store, pool, lambda n: on_point(n, budget))
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


def _evaluate(
    study: CalibrationStudy,
    points: Mapping[int, np.ndarray],
    done: dict[int, Trial],
    store: StoreContract,
    pool: Pool,
    on_point: Callable[[int], None],
) -> None:
    """Evaluate those of the points by number that are not done."""
    missing = [number for number in points if number not in done]
    values = [study.space.values(points[number]) for number in missing]
    for index, result in pool.map(values):
        if isinstance(result, Failure) and result.status == REFUSED and not done:
            raise CalibError(result.reason)
        number = missing[index]
        trial = as_trial(number, points[number].tolist(), values[index], result, "search", store.header.segment)
        with uninterrupted():
            done[number] = store.append(trial, None)
        on_point(len(done))


def _header(
    study: CalibrationStudy, start: np.ndarray, tolerances: Mapping[str, float], budget: int, seed: int
) -> StudyHeader:
    """What the store is opened with: the study without its search, and what decides the points."""
    of_study = {key: value for key, value in study.header.definition.items() if key not in SEARCH_KEYS}
    own: dict[str, Any] = {"start": start.tolist(), "tolerances": dict(tolerances), "batch": WINDOW_BATCH}
    return StudyHeader(study.name, {**of_study, "seed": seed, "window": own}, budget, budget, study.code)
