"""Points of a study that are evaluated without a search: those of a sensitivity, or of a window."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from calib.errors import CalibError
from calib.execution.interrupt import uninterrupted
from calib.execution.pool import REFUSED, Failure, Pool
from calib.store import StudyHeader, Trial
from calib.study.contracts import StoreContract
from calib.study.evaluation import Phase, as_trial
from calib.study.study import CalibrationStudy

SEARCH_KEYS = ("screen", "start", "batch", "optimiser")  # of a study's definition, which its search alone has


def header_without_search(
    study: CalibrationStudy, seed: int, what: str, decides: Mapping[str, Any], size: int
) -> StudyHeader:
    """Header of a store of points: the study without its search, and what decides the points.

    Parameters
    ----------
    what : the points are for, a key of the definition
    decides : the points, beside the seed
    size : points in all
    """
    of_study = {key: value for key, value in study.header.definition.items() if key not in SEARCH_KEYS}
    return StudyHeader(study.name, {**of_study, "seed": seed, what: dict(decides)}, size, size, study.code)


def evaluate_points(
    study: CalibrationStudy,
    points: Mapping[int, np.ndarray],
    done: dict[int, Trial],
    store: StoreContract,
    pool: Pool,
    phase: Phase,
    on_point: Callable[[int], None],
) -> None:
    """Evaluate points (dim,) of the unit cube by their numbers, and add their trials to the store and to `done`.

    Parameters
    ----------
    pool : maps values to an `Evaluation` or `Failure`
    phase : of the trials
    on_point : called with the number of points that are done

    Raises
    ------
    CalibError : the model refuses the first point of all
    KeyboardInterrupt : stopped by Ctrl-C; the points evaluated until then are kept
    """
    numbers = list(points)
    values = [study.space.values(points[number]) for number in numbers]
    for index, result in pool.map(values):
        if isinstance(result, Failure) and result.status == REFUSED and not done:
            raise CalibError(result.reason)
        number = numbers[index]
        trial = as_trial(number, points[number].tolist(), values[index], result, phase, store.header.segment)
        with uninterrupted():
            done[number] = store.append(trial, None)
        on_point(len(done))
