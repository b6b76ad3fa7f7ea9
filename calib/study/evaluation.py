"""A point simulated and scored."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from calib.dynamics.stationary import stationary_record
from calib.objective import Score
from calib.parameter import values_for
from calib.pool import Failure
from calib.store import Trial
from calib.study.contracts import Outcome


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A point simulated and scored.

    Attributes
    ----------
    score : of all records together
    records : simulated record of each scored reference
    features : scalar features as dicts: label, record, body, unit, measured, simulated, tolerance
    seconds : wall-clock time  [s]
    """

    score: Score
    records: Mapping[str, xr.Dataset]
    features: list[dict[str, Any]]
    seconds: float


def evaluate(study, values: Mapping[str, float]) -> Evaluation:
    """Simulate every record that the study's objective scores at `values` (SI), and score them.

    Parameters
    ----------
    study : a `calib.study.Study`; its model and its objective are all that is looked at

    Raises
    ------
    CalibError : an unknown parameter, or an excitation that the simulator cannot take
    """
    start = time.perf_counter()
    objective = study.objective
    references = {name: objective.references[name] for name in objective.scored}
    records = {
        name: stationary_record(study.model, values_for(values, name), reference.excitation, reference.request)
        for name, reference in references.items()
    }
    score, features = objective.judged(records)
    return Evaluation(score, records, [asdict(feature) for feature in features], time.perf_counter() - start)


def outcome(result: Trial | Score | Failure) -> Outcome:
    """What an optimiser, or whoever differentiates, learns of a trial, a score or a call that failed."""
    if isinstance(result, Failure):
        return Outcome(math.inf, None, result.status, None)
    return Outcome(result.total, result.residuals, result.status, result.kind)


def as_trial(
    number: int, u: Sequence[float], values: Mapping[str, float], result: Evaluation | Failure, phase: str, segment: int
) -> Trial:
    """Trial at the point `u` of the unit cube, of what its evaluation gave; the rest as in `calib.store.Trial`."""
    known = {"number": number, "u": list(u), "values": dict(values), "seconds": result.seconds, "phase": phase}
    if isinstance(result, Failure):
        return Trial(**known, total=math.inf, status=result.status, reason=result.reason, segment=segment)
    score = result.score
    scored = math.isfinite(score.total)
    return Trial(
        **known,
        total=float(score.total) if scored else math.inf,
        terms={label: float(distance) for label, distance in score.terms.items()},
        status=score.status,
        reason=score.reason,
        kind=score.kind,
        features=result.features,
        residuals=np.asarray(score.residuals, dtype=float) if scored and score.residuals is not None else None,
        segment=segment,
    )
