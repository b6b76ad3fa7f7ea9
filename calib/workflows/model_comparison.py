"""A study's model beside those of other studies of the same records, by their evidence."""

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.confidence import fitted, sampled
from calib.confidence.document import ComparedModelResult, ComparisonResult
from calib.confidence.model_comparison import ComparableModel, comparable, in_words, width_in_words
from calib.confidence.notes import NOTES, PointNotes
from calib.confidence.posterior import Posterior, expected_evaluations
from calib.confidence.profile import Centre
from calib.confidence.profiles import LocalAnalysis
from calib.diagnosis import artifacts
from calib.errors import CalibError
from calib.store.lock import Lock
from calib.study import CalibrationStudy
from calib.study_file import StudyFile
from calib.workflows.calibrated import calibrated_values
from calib.workflows.command_line import command_line
from calib.workflows.evaluations import Evaluations
from calib.workflows.texts import diagnosis_text

CONFIDENCE_STAGE = "confidence"
POINTS_FORMAT_VERSION = 1  # of the points: those of another are forgotten


@dataclass(frozen=True, eq=False)
class OpenModel:
    """A study with its evaluations and the notes of its points, and its best point.

    Attributes
    ----------
    analysis, centre : of the best point
    """

    file: StudyFile
    evaluations: Evaluations
    notes: PointNotes
    analysis: LocalAnalysis
    centre: Centre


def identity_of_points(study: CalibrationStudy, u: np.ndarray) -> list[Any]:
    """All that decides what the points about `u` (dim,) of the unit cube are."""
    return [POINTS_FORMAT_VERSION, study.header.definition, study.code, u.tolist()]


def check_comparable(file: StudyFile, others: Sequence[StudyFile]) -> None:
    """Refuse studies that compare other records or terms than this one.

    Raises
    ------
    CalibError : one of them does, is this study, or was not calibrated
    """
    own = file.study.objective
    for other in others:
        if other.path.resolve() == file.path.resolve():
            raise CalibError(f"--compare: {other.path} is the study itself; give one with another model")
        theirs = other.study.objective
        if set(theirs.scored) != set(own.scored):
            raise CalibError(
                f"--compare: {other.path} calibrates on {', '.join(theirs.scored)}, and {file.path} on "
                f"{', '.join(own.scored)}; models are compared on the same records"
            )
        for name in own.scored:
            if not own.references[name].record.equals(theirs.references[name].record):
                raise CalibError(f"--compare: record {name!r} of {other.path} is another one than that of {file.path}")
        if [term.label for term in theirs.terms] != [term.label for term in own.terms]:
            raise CalibError(f"--compare: {other.path} has other terms than {file.path}; give it the same")
        calibrated_values(other, other.folder)


def compared_models(
    own: OpenModel,
    others: Sequence[StudyFile],
    on_stage: Callable[[str], None],
    on_progress: Callable[[int, int], None],
) -> ComparisonResult:
    """Evidence of the models of studies of the same records; points are kept in the folder of each.

    on_progress : called with the number of evaluations that are done, and of those that are foreseen

    Raises
    ------
    CalibError : the models cannot be compared, or another process works on one of them
    """
    with ExitStack() as stack:
        models = [own, *(_opened(other, stack, on_stage) for other in others)]
        names = [model.file.study.name for model in models]
        shared = comparable([model.analysis for model in models], names)
        foreseen = [expected_evaluations(model.file.study.space.dim) for model in models]
        samples: list[Posterior] = []
        for model, common in zip(models, shared, strict=True):
            on_stage(f"evidence of {model.file.study.name}")
            done = sum(sample.evaluations for sample in samples)
            later = sum(foreseen[len(samples) + 1 :])

            def progress(number: int, of: int, done: int = done, later: int = later) -> None:
                on_progress(done + number, done + of + later)

            study, centre = model.file.study, replace(model.centre, likelihood=common.likelihood)
            pool = model.evaluations.calibrated(CONFIDENCE_STAGE)
            priors = model.file.priors
            samples.append(sampled(study, pool, model.analysis, centre, model.notes, priors, on_progress=progress))
    compared = tuple(_compared(own, *pair) for pair in _with_first(models, shared, samples))
    noise = names[int(np.argmax([common.log_best for common in shared]))]
    return ComparisonResult(compared, noise, _diagnosis(own.file))


def expected_comparison(others: Sequence[StudyFile], dim: int) -> int:
    """Evaluations that a comparison of a study of `dim` parameters with others takes, roughly; 0 without others."""
    dims = [dim, *(other.study.space.dim for other in others)]
    return sum(map(expected_evaluations, dims)) if others else 0


def _opened(file: StudyFile, stack: ExitStack, on_stage: Callable[[str], None]) -> OpenModel:
    study, folder = file.study, file.folder
    lock = Lock(folder, folder / NOTES)
    lock.acquire()
    stack.callback(lock.release)
    u = study.space.point(calibrated_values(file, folder))
    notes = stack.enter_context(PointNotes(folder / NOTES, identity_of_points(study, u)))
    evaluations = stack.enter_context(Evaluations(file, folder, on_stage))
    on_stage(f"best point of {study.name}")
    analysis, centre = fitted(study, evaluations.calibrated(CONFIDENCE_STAGE), u, notes)
    return OpenModel(file, evaluations, notes, analysis, centre)


_Sampled = tuple[OpenModel, ComparableModel, Posterior]


def _with_first(
    models: Sequence[OpenModel], shared: Sequence[ComparableModel], samples: Sequence[Posterior]
) -> list[tuple[_Sampled, _Sampled]]:
    """Each model beside the first."""
    sampled_models = list(zip(models, shared, samples, strict=True))
    return [(sampled_models[0], one) for one in sampled_models]


def _compared(own: OpenModel, first: _Sampled, other: _Sampled) -> ComparedModelResult:
    (_, base, reference), (model, common, sample) = first, other
    study = model.file.study
    evidence = sample.log_evidence + common.log_best
    factor = evidence - reference.log_evidence - base.log_best
    error = math.hypot(sample.log_evidence_error, reference.log_evidence_error)
    further = tuple(name for name in study.space.names if name not in own.file.study.space.names)
    text = ""
    if model is not own:
        side = "for" if factor > 0.0 else "against"
        text = f"the evidence {side} this model is {in_words(factor)}"
        if further and factor > 0.0:
            text += f"; {width_in_words(factor)}"
    if not sample.complete:
        text += f"{'; ' if text else ''}its sampling ended at the limit of evaluations: evidence may be missing"
    return ComparedModelResult(
        study.name, tuple(effect.name for effect in study.model.effects), further, common.log_best, evidence,
        sample.log_evidence_error, 0.0 if model is own else factor, 0.0 if model is own else error, sample.evaluations,
        text,
    )  # fmt: skip


def _diagnosis(file: StudyFile) -> str:
    try:
        diagnosis = artifacts.read(file.folder)
    except CalibError as error:
        return str(error)
    if diagnosis is None:
        return f"no diagnosis: `{command_line('diagnose', file.path)}` makes one"
    return diagnosis_text(file.study.name, diagnosis).replace("\n  ", "; ")
