"""The page of a study: verdict, figures, tables, and how to make it again."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from calib.confidence.document import ConfidenceResult
from calib.confidence.window.document import WindowResult
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.document import DiagnosisResult
from calib.objective import MISFIT
from calib.objective.objective import MIN_COST_OF_WRONG_KIND
from calib.report.formatting import number
from calib.report.pages import tables
from calib.report.pages.base_study import BaseStudy, base_points
from calib.report.pages.confidence import confidence_chapter
from calib.report.pages.diagnosis.chapter import chapter
from calib.report.pages.discovery import discovery_chapter
from calib.report.pages.picture import Picture, drawn, pictured
from calib.report.pages.sections import RecordSection, record_section
from calib.report.pages.verdict import verdict
from calib.report.pages.window import window_chapter
from calib.report.plots.search import kinds_of_motion, score_history
from calib.store import Header, Trial
from calib.study import CalibrationResult, CalibrationStudy

SCORE_HISTORY = "Score of every trial in the order of the search, coloured by the kind of motion."
KINDS = "Score of every trial over each searched parameter, coloured by the kind of motion."


@dataclass(frozen=True)
class RecordWarning:
    """A warning that stands in one record or more."""

    text: str
    records: tuple[str, ...]


def render(
    study: CalibrationStudy,
    trials: Sequence[Trial],
    records: Mapping[str, xr.Dataset],
    result: CalibrationResult,
    command: str = "calib run study.toml",
    header: Header | None = None,
    diagnosis: DiagnosisResult | None = None,
    motions: Mapping[str, xr.Dataset] | None = None,
    jobs: int = 1,
    base: BaseStudy | None = None,
    discovery: DiscoveryResult | None = None,
    confidence: ConfidenceResult | None = None,
    predictions: Mapping[str, xr.Dataset] | None = None,
    window: tuple[WindowResult, xr.Dataset] | None = None,
    left_out: Sequence[str] = (),
) -> str:
    """HTML of the report, self-contained.

    Parameters
    ----------
    trials : every trial of the ledger, in its order
    records : name of a reference -> record simulated at the best values, failed ones too; may be empty
    result : of the calibration; what it does not know is left out of the page
    command, header : that makes the page again; of the ledger, whose versions and processor are shown
    diagnosis, discovery, confidence, window : None where there was none; of the window document and arrays
    motions, jobs : content of diagnosis.nc (see `calib.report.plots.diagnosed_cycles`); processes that draw figures
    base : the study that this one extends; None where it extends none, or none is known
    predictions, left_out : bands of predicted records by name; why something cannot be shown, without full stops
    """
    illustrated = {
        **_record_sections(study, records, result, base),
        "d": None if diagnosis is None else chapter(diagnosis, motions or {}, result, study),
        "f": None if discovery is None else discovery_chapter(discovery, result),
        "c": None if confidence is None else confidence_chapter(confidence, result, predictions or {}),
        "w": None if window is None else window_chapter(*window, result),
        "search": _search(study, trials, result),
    }
    return _template().render(
        illustrated,
        drawn=drawn(illustrated, jobs),
        study=study,
        result=result,
        verdict=verdict(result),
        base_points=base_points(base),
        left_out=left_out,
        warnings=_warnings(study),
        terms=tables.terms(study, result),
        parameters=tables.parameters(study, result),
        fixed=tables.fixed(study, result),
        groups=[group.text for group in result.undetermined],
        unreachable=[tables.unreachable(feature) for feature in result.unreachable],
        leaders=tables.leaders(result),
        failures=tables.failures(trials),
        nuisances=tables.nuisances(result),
        provenance=tables.provenance(study, result, command, header),
        misfit=MISFIT,
        wrong=MIN_COST_OF_WRONG_KIND,
        definition=json.dumps(study.definition, indent=2, default=str, ensure_ascii=False),
    )


def _record_sections(
    study: CalibrationStudy, records: Mapping[str, xr.Dataset], result: CalibrationResult, base: BaseStudy | None
) -> dict[str, list[RecordSection]]:
    """Sections of the records that were calibrated on, and of the others."""
    names = {name: reference.use for name, reference in study.objective.references.items()}
    before = {} if base is None else base.records
    shown = {n: record_section(study, n, records.get(n), result, before.get(n)) for n in names}
    return {
        "sections": [shown[n] for n, use in names.items() if use == "calibrate"],
        "others": [shown[n] for n, use in names.items() if use != "calibrate"],
    }


def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("calib.report.pages", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"], environment.filters["distance"] = number, distance
    return environment.get_template("report.html.j2")


def distance(total: float | None) -> str:
    """Write a total distance, with a note where it is the penalty for another kind of motion."""
    wrong = total is not None and total >= MIN_COST_OF_WRONG_KIND
    return f"{number(total)}{', another kind of motion' if wrong else ''}"


def _warnings(study: CalibrationStudy) -> list[RecordWarning]:
    """Warnings of the records, each once with the records that it stands in."""
    names_by_text: dict[str, list[str]] = {}
    for name, reference in study.objective.references.items():
        if reference.record.attrs.get("warning"):
            names_by_text.setdefault(str(reference.record.attrs["warning"]), []).append(name)
    return [RecordWarning(text, tuple(names)) for text, names in names_by_text.items()]


def _search(study: CalibrationStudy, trials: Sequence[Trial], result: CalibrationResult) -> list[Picture | None]:
    """Figures of the search; none where there is no trial yet."""
    if not trials:
        return []
    best = next((t for t in trials if t.number == result.best_trial), None)
    kinds = kinds_of_motion(trials, study.space, study.model.parameters, best)
    return [pictured(score_history(trials), "history", SCORE_HISTORY), pictured(kinds, "kinds", KINDS)]
