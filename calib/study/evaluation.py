"""A point simulated and scored."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
import xarray as xr

from calib.dynamics.stationary import stationary_record
from calib.dynamics.swept_response import swept_response
from calib.execution.pool import Failure
from calib.modelling.model import Model
from calib.modelling.parameter import values_for
from calib.objective import Objective, Score, simulations
from calib.store import Trial
from calib.store.trial import one_line
from calib.study.contracts import Outcome

Phase = Literal["screen", "search"]


class Evaluable(Protocol):
    """What an evaluation needs of a study."""

    @property
    def model(self) -> Model:
        """What is simulated."""
        ...

    @property
    def objective(self) -> Objective:
        """What it is compared with."""
        ...


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A point simulated and scored.

    Attributes
    ----------
    score : of all records together
    records : simulated record of each scored reference
    features : scalar features as dicts: label, record, body, unit, measured, simulated, tolerance
    seconds : wall-clock time  [s]
    simulations : runs of the simulator
    """

    score: Score
    records: Mapping[str, xr.Dataset]
    features: list[dict[str, Any]]
    seconds: float
    simulations: int = 1


def evaluate(study: Evaluable, values: Mapping[str, float]) -> Evaluation:
    """Simulate every record that the study's objective scores at `values` (SI), and score them.

    Parameters
    ----------
    study : such as a `calib.study.CalibrationStudy`

    Raises
    ------
    CalibError : an unknown parameter, or an excitation that the simulator cannot take
    """
    start = time.perf_counter()
    objective = study.objective
    records = {name: simulated(study.model, objective, name, values) for name in objective.scored}
    score, features = objective.judged(records)
    count = sum(simulations(record) for record in records.values())
    return Evaluation(score, records, [asdict(feature) for feature in features], time.perf_counter() - start, count)


def simulated(model: Model, objective: Objective, name: str, values: Mapping[str, float]) -> xr.Dataset:
    """Simulate the reference `name` at the values of all records (SI), its initial state solved for where it is free.

    Raises
    ------
    CalibError : an unknown parameter, or an excitation that the simulator cannot take
    """
    reference, own = objective.references[name], values_for(values, name)
    if reference.frees_initial_state:
        return objective.released(name, model, own).record
    if reference.is_swept:
        return swept_response(model, own, reference.excitation, reference.record)
    return stationary_record(model, own, reference.excitation, reference.request)


def outcome(result: Trial | Score | Failure) -> Outcome:
    """What an optimiser, or whoever differentiates, learns of a trial, a score or a call that failed."""
    if isinstance(result, Failure):
        return Outcome(math.inf, None, result.status, None)
    return Outcome(result.cost, result.residuals, result.status, result.kind)


def as_trial(
    number: int,
    u: Sequence[float],
    values: Mapping[str, float],
    result: Evaluation | Failure,
    phase: Phase,
    segment: int,
) -> Trial:
    """Trial at the point `u` of the unit cube, of what its evaluation gave; the rest as in `calib.store.Trial`."""
    failed = Trial(number, list(u), dict(values), math.inf, seconds=result.seconds, phase=phase, segment=segment)
    if isinstance(result, Failure):
        return replace(failed, status=result.status, reason=one_line(result.reason))
    score = result.score
    scored = math.isfinite(score.cost)
    return replace(
        failed,
        cost=float(score.cost) if scored else math.inf,
        terms={label: float(distance) for label, distance in score.terms.items()},
        status=score.status,
        reason=one_line(score.reason),
        kind=score.kind,
        features=result.features,
        residuals=np.asarray(score.residuals, dtype=float) if scored and score.residuals is not None else None,
        simulations=result.simulations,
    )
