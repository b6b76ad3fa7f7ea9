"""Where a calibration evaluates: one pool of processes for all its stages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Self

from calib.execution.pool import Failure, InProcess, Pool
from calib.execution.pools.local import LocalPool
from calib.execution.workers import workers
from calib.modelling.model import Model
from calib.objective import Objective, Reference
from calib.study import Evaluation, evaluate
from calib.study_file import StudyFile

SEARCH, CONFIRM, HOLD_OUT = "search", "confirm", "hold-out"  # stages; each may compile kernels of its own
CALIBRATED = ""  # in the place of a record held out: all calibrated records together


class Case(NamedTuple):
    """What values are evaluated on.

    `confirming` says by which model, the confirming one or that of the search; `record` is one that is held out, or
    `CALIBRATED`; `afresh` says whether the simulator has to run, though it may know the answer.
    """

    confirming: bool
    record: str = CALIBRATED
    afresh: bool = False


@dataclass(frozen=True, eq=False)
class _Judged:
    """What `calib.study.evaluate` needs of a study."""

    model: Model
    objective: Objective


class Evaluations:
    """The evaluations of a study file, in one pool of processes; use it in a with block."""

    def __init__(self, file: StudyFile):
        study = file.study
        objectives = {CALIBRATED: study.objective}
        objectives |= {
            name: study.objective.on({name: reference}) for name, reference in held_out_references(file).items()
        }
        models = {False: study.model}
        if study.model.confirming is not None:
            models[True] = study.model.confirming
        cases = {
            Case(confirming, record, afresh): _Judged(model.afresh() if afresh else model, objective)
            for confirming, model in models.items()
            for record, objective in objectives.items()
            for afresh in (False, True)
        }
        self._pool = workers(partial(_evaluated, cases), study.jobs, study.timeout)

    def calibrated(self, stage: str, confirming: bool = False, afresh: bool = False) -> Pool:
        """Return the pool that evaluates values on the calibrated records."""
        return _StagePool(self._pool, stage, Case(confirming, afresh=afresh))

    def at(self, values: Mapping[str, float], cases: Sequence[Case]) -> dict[str, Evaluation | Failure]:
        """Evaluate the same values on several cases; return the evaluations by their record."""
        answers = dict(self._pool.map([(case, values) for case in cases], HOLD_OUT))
        return {case.record: answers[index] for index, case in enumerate(cases)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.close()


def held_out_references(file: StudyFile) -> dict[str, Reference]:
    """References of a study file that are only predicted, by name."""
    return {name: reference for name, reference in file.others.items() if reference.use == "holdout"}


@dataclass(frozen=True)
class _StagePool:
    """A pool as one stage sees it: its payloads are values, of one case."""

    pool: LocalPool | InProcess
    stage: str
    case: Case

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, Evaluation or Failure) as they end."""
        return self.pool.map(((self.case, values) for values in payloads), self.stage)


def _evaluated(cases: Mapping[Case, _Judged], payload: tuple[Case, Mapping[str, float]]) -> Evaluation:
    case, values = payload
    return evaluate(cases[case], values)
