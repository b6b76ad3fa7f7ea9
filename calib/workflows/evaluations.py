"""Where a calibration evaluates: one pool of processes for all its stages."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Self

from calib.execution.pool import Failure, OnCompiling, OpenPool, Pool
from calib.execution.pools.results import FOLDER, ResultFolder
from calib.execution.workers import workers
from calib.modelling.model import Model
from calib.objective import Objective, Reference
from calib.records.held_response import is_held
from calib.store.environment import environment
from calib.store.plain import plain
from calib.study import CalibrationStudy, Evaluation, evaluate
from calib.study_file import StudyFile

SEARCH, CONFIRM, HOLD_OUT = "search", "confirm", "hold-out"  # stages; each may compile kernels of its own
HOLD_OUT_STAGES = (HOLD_OUT, False), (f"{HOLD_OUT} at a held amplitude", True)  # and whether it is that
IDLE_ASKS = 10  # times that an optimiser has asked, of whose points the mean is taken
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
    """The evaluations of a study file, in one pool of processes; use it in a with block.

    Parameters
    ----------
    file : of the study
    folder : of its results, in which workers elsewhere keep what they evaluate until it is taken over
    on_note : told, in one line each, what a user may want to know
    on_compiling : told that kernels begin to be compiled, and that they are; see `LocalPool`
    """

    def __init__(
        self,
        file: StudyFile,
        folder: Path,
        on_note: Callable[[str], None] = lambda text: None,
        on_compiling: OnCompiling | None = None,
    ):
        study, held_out = file.study, held_out_references(file)
        objectives = {CALIBRATED: study.objective}
        objectives |= {name: study.objective.on({name: reference}) for name, reference in held_out.items()}
        self._held = {name for name, reference in held_out.items() if is_held(reference.record)}
        models = {False: study.model}
        if study.model.confirming is not None:
            models[True] = study.model.confirming
        cases = {
            Case(confirming, record, afresh): _Judged(model.afresh() if afresh else model, objective)
            for confirming, model in models.items()
            for record, objective in objectives.items()
            for afresh in (False, True)
        }
        results = ResultFolder(folder.resolve() / FOLDER, _identity(study), _content)
        self._pool = workers(
            partial(_evaluated, cases), study.evaluated_by, study.timeout,
            modules=study.code, results=results, on_note=on_note, on_compiling=on_compiling,
        )  # fmt: skip
        for remark in getattr(study.model.simulator, "remarks", ()):
            on_note(remark)
        oversubscribed = _oversubscription(study)
        if oversubscribed is not None:
            on_note(oversubscribed)

    @property
    def width(self) -> int | None:
        """Evaluations that go on side by side at present; None where that is not known."""
        return self._pool.width

    def calibrated(self, stage: str, confirming: bool = False, afresh: bool = False) -> Pool:
        """Return the pool that evaluates values on the calibrated records."""
        return _StagePool(self._pool, stage, Case(confirming, afresh=afresh))

    def each(
        self, tasks: Sequence[tuple[Case, Mapping[str, float]]], stage: str
    ) -> Iterator[tuple[int, Evaluation | Failure]]:
        """Evaluate values, each on a case of its own; yield (index, evaluation) as they end."""
        return self._pool.map(tasks, stage)

    def at(self, values: Mapping[str, float], cases: Sequence[Case]) -> dict[str, Evaluation | Failure]:
        """Evaluate the same values on several cases; return the evaluations by their record.

        Responses at a held amplitude take no kernel of the simulator, so that they compile nothing for the others.
        """
        stages = {
            stage: [case for case in cases if (case.record in self._held) == held] for stage, held in HOLD_OUT_STAGES
        }
        return {
            own[index].record: answer
            for stage, own in stages.items()
            for index, answer in self.each([(case, values) for case in own], stage)
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.close()


class IdleWorkers:
    """Says, once, where an optimiser asks for fewer points at a time than could be evaluated side by side."""

    def __init__(self, evaluations: Evaluations, on_note: Callable[[str], None]):
        self._evaluations, self._on_note = evaluations, on_note
        self._asked: list[int] = []

    def __call__(self, points: int) -> None:
        """Take in the number of points that were asked for."""
        self._asked.append(points)
        if len(self._asked) != IDLE_ASKS:
            return
        width, mean = self._evaluations.width or 1, sum(self._asked) / IDLE_ASKS
        if mean < width:
            self._on_note(
                f"the search asks for {mean:.3g} points at a time, and {width} evaluations could go on side by side: "
                f"with batch = {width} in [optimiser] (another study) none would be idle"
            )


def _oversubscription(study: CalibrationStudy) -> str | None:
    """Say where evaluations side by side use more cores than there are: they are slow, and may exceed their time."""
    pool, each = study.evaluated_by, getattr(study.model.simulator, "cores", 1)
    wanted, there = pool.local_jobs * each, len(os.sched_getaffinity(0))
    if pool.kind != "local" or wanted <= there:
        return None
    what = f"{pool.local_jobs} jobs" if each == 1 else f"{pool.local_jobs} jobs of {each} cores each are {wanted}"
    return (
        f"{what}, and this machine has {there} for them: runs slow each other down, and may exceed their time-out; "
        f"--jobs {max(there // each, 1)} uses what there is"
    )


def held_out_references(file: StudyFile) -> dict[str, Reference]:
    """References of a study file that are only predicted, by name."""
    return {name: reference for name, reference in file.others.items() if reference.use == "holdout"}


@dataclass(frozen=True)
class _StagePool:
    """A pool as one stage sees it: its payloads are values, of one case."""

    pool: OpenPool
    stage: str
    case: Case

    def map(self, payloads: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, Evaluation or Failure) as they end."""
        return self.pool.map(((self.case, values) for values in payloads), self.stage)


_Payload = tuple[Case, Mapping[str, float]]


def _evaluated(cases: Mapping[Case, _Judged], payload: _Payload) -> Evaluation:
    case, values = payload
    return evaluate(cases[case], values)


def _identity(study: CalibrationStudy) -> str:
    """Text of all that decides what an evaluation of a study gives, beside its values."""
    return json.dumps(plain([study.header.definition, study.code, environment()]), sort_keys=True)


def _content(payload: _Payload) -> str | None:
    """Text of a payload; None where the simulator has to run, though its result may be known."""
    case, values = payload
    return None if case.afresh else json.dumps([*case, dict(values)], sort_keys=True)
