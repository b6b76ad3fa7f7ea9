"""What studies have left in their folders, read without simulator, effects and optimiser."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr

from calib.confidence.artifacts import read_confidence
from calib.confidence.bands import read_bands
from calib.confidence.document import ConfidenceResult
from calib.confidence.window.artifacts import read_drawn_window
from calib.confidence.window.document import WindowResult
from calib.diagnosis import artifacts
from calib.diagnosis.discovery.artifacts import read_discovery
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.document import DiagnosisResult
from calib.errors import CalibError
from calib.report.pages.base_study import BaseStudy
from calib.store import Trial
from calib.store.record_files import best_records
from calib.study import CalibrationResult, CalibrationStudy, Evaluation, ModelSummary, SearchEnd, result
from calib.study_file import StudyFile, base_path, extended_part, load, results_folder
from calib.workflows.calibrated import folder_of_results
from calib.workflows.evaluations import held_out_references

T = TypeVar("T")


def stored_study(
    path: str | Path,
    out: str | Path | None = None,
    jobs: int | None = None,
    pool: Mapping[str, Any] | None = None,
) -> tuple[StudyFile, dict[str, xr.Dataset]] | None:
    """Read a study whose result and best records tell all that a report shows; return it with these records.

    Its features are imported: they compare the records. None where something has to be simulated: there is no result,
    no trial ended ok, the records are not those of the result, or some are held out, whose prediction is not stored.

    Raises
    ------
    CalibError : every mistake of the study file
    """
    folder = folder_of_results(path, out)
    known = _of_the_result(folder)
    if known is None:
        return None
    model, records = known
    file = load(path, jobs=jobs, out=out, pool=pool, stored=model)
    return (file, records) if _tells_all(file, records) else None


def stored_records(file: StudyFile) -> dict[str, xr.Dataset] | None:
    """Read the best records of a study that is loaded already; None as in `stored_study`."""
    known = _of_the_result(file.folder)
    return known[1] if known is not None and _tells_all(file, known[1]) else None


def _of_the_result(folder: Path) -> tuple[ModelSummary, dict[str, xr.Dataset]] | None:
    """Model of a result and its best records; None where there is no result, no best trial, or they are of another."""
    summary = result.read(folder)
    if summary is None or summary.model is None or summary.best_trial is None:
        return None
    records = best_records(folder)
    if any(_origin(record) != (summary.best_trial, summary.confirmed) for record in records.values()):
        return None
    return summary.model, records


def _tells_all(file: StudyFile, records: Mapping[str, xr.Dataset]) -> bool:
    """Whether a report needs no simulation beside these records."""
    return not held_out_references(file) and set(records) == set(file.study.objective.scored)


def _origin(record: xr.Dataset) -> tuple[int, bool]:
    """Trial of a best record, and whether the confirming simulator has made it."""
    return int(record.attrs["trial"]), bool(json.loads(record.attrs["provenance"]).get("confirmed", False))


def scored(study: CalibrationStudy, records: Mapping[str, xr.Dataset]) -> Evaluation:
    """Score stored records as an evaluation."""
    return Evaluation(study.objective(records), records, [], 0.0)


def finished_result(folder: Path, trials: Sequence[Trial], top: Trial | None) -> CalibrationResult | None:
    """Return the result in a folder where it is of these trials, the best of which is `top`; else None."""
    summary = result.read(folder)
    if summary is None or summary.searched_best != (None if top is None else top.number):
        return None
    known = top is None or summary.best_trial in {trial.number for trial in trials}
    return summary if known else None


def end_of_search(folder: Path) -> SearchEnd | None:
    """How the search of the result in a folder ended; None where there is none, or no readable one: it is made anew."""
    try:
        ended = result.read(folder)
    except CalibError:
        return None
    if ended is None:
        return None
    return SearchEnd(ended.trials, ended.searched_best, ended.stopped, ended.agreement)


@dataclass(frozen=True)
class StoredFindings:
    """What other commands have left beside a calibration; None, or empty, where they left nothing that can be read.

    Attributes
    ----------
    diagnosis, motions : of diagnosis.json and diagnosis.nc
    discovery : of discovery.json
    confidence, predictions : of confidence.json, and bands of predicted records by name
    window : of window.json and window.nc
    left_out : a sentence for each file that cannot be shown, without its full stop
    """

    diagnosis: DiagnosisResult | None
    motions: Mapping[str, xr.Dataset]
    discovery: DiscoveryResult | None
    confidence: ConfidenceResult | None
    predictions: Mapping[str, xr.Dataset]
    window: tuple[WindowResult, xr.Dataset] | None
    left_out: tuple[str, ...]


def stored_findings(folder: Path) -> StoredFindings:
    """Read what stands in a folder beside a calibration; a file that cannot be read is left out, and said."""
    problems: list[str] = []

    def readable(read: Callable[[Path], T], instead: T) -> T:
        try:
            return read(folder)
        except CalibError as error:
            problems.append(str(error))
            return instead

    diagnosis = readable(artifacts.read, None)
    confidence = readable(read_confidence, None)
    sampled = confidence is not None and confidence.posterior is not None
    return StoredFindings(
        diagnosis=diagnosis,
        motions={} if diagnosis is None else readable(artifacts.read_motions, {}),
        discovery=readable(read_discovery, None),
        confidence=confidence,
        predictions=readable(read_bands, {}) if sampled else {},
        window=readable(read_drawn_window, None),
        left_out=tuple(problems),
    )


def base_study(file: StudyFile) -> BaseStudy | None:
    """Study that this one extends, from the folder where its results go; None where it has none there."""
    path, name = file.path, file.study.name
    part = extended_part(path)
    if not part:
        return None
    folder = results_folder(base_path(path))
    summary = result.read(folder)
    if summary is None or name != f"{summary.name} {part}":  # the folder of another study, or none
        return None
    return BaseStudy(summary, best_records(folder))
