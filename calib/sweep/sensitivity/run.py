"""The points of a design, evaluated into a store or read from it."""

from collections.abc import Callable

from calib.execution.pool import Pool
from calib.store import Trial
from calib.store.trial import FORMER_CODE
from calib.study import CalibrationStudy
from calib.study.contracts import StoreContract
from calib.study.points import evaluate_points, header_without_search
from calib.sweep.sensitivity.design import MORRIS_LEVELS, SensitivityDesign


def evaluated(
    study: CalibrationStudy,
    design: SensitivityDesign,
    store: StoreContract,
    pool: Pool,
    fresh: bool = False,
    on_opened: Callable[[int], None] = lambda done: None,
    on_point: Callable[[int, int], None] = lambda done, total: None,
) -> list[Trial]:
    """Evaluate the points of a design that the store does not have; return the trials of all, in the design's order.

    The store may hold a design of fewer or more groups with the same method and seed: its points are taken over.

    Parameters
    ----------
    store : closed at the end
    pool : maps values to an `Evaluation` or `Failure`
    fresh : set aside what the store has
    on_opened : called with the number of points that the store has already
    on_point : called with the number of points that are done, and of all

    Raises
    ------
    CalibError : the store belongs to another study; the model refuses the first point
    KeyboardInterrupt : stopped by Ctrl-C; the points evaluated until then are kept
    """
    points = design.points
    decides = {"method": design.method, "levels": MORRIS_LEVELS}
    logged = store.open(header_without_search(study, design.seed, "sensitivity", decides, design.size), fresh)
    try:
        done = {t.number: t for t in logged if t.number < design.size and t.status != FORMER_CODE}
        on_opened(len(done))
        missing = [number for number in range(design.size) if number not in done]
        first = 0 if done else 1  # alone: a mistake of usage is found at once, and kernels are compiled only once
        for numbers in filter(None, (missing[:first], missing[first:])):
            asked = {number: points[number] for number in numbers}
            evaluate_points(study, asked, done, store, pool, "screen", lambda n: on_point(n, design.size))
    finally:
        store.close()
    return [done[number] for number in range(design.size)]
