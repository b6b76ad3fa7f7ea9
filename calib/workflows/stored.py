"""What studies have left in their folders, read without simulator, effects and optimiser."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from calib.confidence.artifacts import read_confidence
from calib.confidence.bands import read_bands
from calib.confidence.document import ConfidenceResult
from calib.errors import CalibError
from calib.report.pages.base_study import BaseStudy
from calib.store.record_files import best_records
from calib.study import CalibrationStudy, Evaluation, SearchEnd, result
from calib.study_file import StudyFile, base_path, extended_part, load, located, results_folder
from calib.workflows.evaluations import held_out_references


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
    folder = results_folder(located(path)) if out is None else Path(out)
    summary = result.read(folder)
    if summary is None or summary.model is None or summary.best_trial is None:
        return None
    records = best_records(folder)
    if any(_origin(record) != (summary.best_trial, summary.confirmed) for record in records.values()):
        return None
    file = load(path, jobs=jobs, out=out, pool=pool, stored=summary.model)
    if held_out_references(file) or set(records) != set(file.study.objective.scored):
        return None
    return file, records


def _origin(record: xr.Dataset) -> tuple[int, bool]:
    """Trial of a best record, and whether the confirming simulator has made it."""
    return int(record.attrs["trial"]), bool(json.loads(record.attrs["provenance"]).get("confirmed", False))


def scored(study: CalibrationStudy, records: Mapping[str, xr.Dataset]) -> Evaluation:
    """Score stored records as an evaluation."""
    return Evaluation(study.objective(records), records, [], 0.0)


def end_of_search(folder: Path) -> SearchEnd | None:
    """How the search of the result in a folder ended; None where there is none, or no readable one: it is made anew."""
    try:
        ended = result.read(folder)
    except CalibError:
        return None
    if ended is None:
        return None
    return SearchEnd(ended.trials, ended.searched_best, ended.stopped, ended.agreement)


def stored_confidence(folder: Path) -> tuple[ConfidenceResult | None, Mapping[str, xr.Dataset], str]:
    """What the confidence.json of a folder says, its predictions, and why one of them is left out; "" where none is."""
    try:
        confidence = read_confidence(folder)
    except CalibError as error:
        return None, {}, str(error)
    if confidence is None or confidence.posterior is None:
        return confidence, {}, ""
    try:
        return confidence, read_bands(folder), ""
    except CalibError as error:
        return confidence, {}, str(error)


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
