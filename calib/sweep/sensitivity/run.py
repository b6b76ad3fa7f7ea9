"""The points of a design, evaluated into a store or read from it."""

from collections.abc import Callable
from typing import Any

from calib.errors import CalibError
from calib.execution.interrupt import uninterrupted
from calib.execution.pool import REFUSED, Failure, Pool
from calib.store import StudyHeader, Trial
from calib.store.trial import FORMER_CODE
from calib.study import CalibrationStudy
from calib.study.contracts import StoreContract
from calib.study.evaluation import as_trial
from calib.sweep.sensitivity.design import MORRIS_LEVELS, SensitivityDesign

SEARCH_KEYS = ("screen", "start", "batch", "optimiser")  # of a study's definition, of which a sensitivity has none


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
    logged = store.open(_header(study, design), fresh)
    try:
        done = {t.number: t for t in logged if t.number < design.size and t.status != FORMER_CODE}
        on_opened(len(done))
        missing = [number for number in range(design.size) if number not in done]
        first = 0 if done else 1  # alone: a mistake of usage is found at once, and kernels are compiled only once
        for numbers in filter(None, (missing[:first], missing[first:])):
            values = [study.space.values(points[number]) for number in numbers]
            for index, result in pool.map(values):
                if isinstance(result, Failure) and result.status == REFUSED and not done:
                    raise CalibError(result.reason)
                number = numbers[index]
                segment = store.header.segment
                trial = as_trial(number, points[number].tolist(), values[index], result, "screen", segment)
                with uninterrupted():
                    done[number] = store.append(trial, None)
                on_point(len(done), design.size)
    finally:
        store.close()
    return [done[number] for number in range(design.size)]


def _header(study: CalibrationStudy, design: SensitivityDesign) -> StudyHeader:
    """What the store is opened with: the study without its search, and the design without its number of groups."""
    of_study = {key: value for key, value in study.header.definition.items() if key not in SEARCH_KEYS}
    own: dict[str, Any] = {"method": design.method, "levels": MORRIS_LEVELS}
    definition = {**of_study, "seed": design.seed, "sensitivity": own}
    return StudyHeader(study.name, definition, design.size, design.size, study.code)
