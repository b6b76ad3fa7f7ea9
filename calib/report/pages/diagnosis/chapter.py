"""The chapter of a page that presents a diagnosis: misfit, suspects, causes, what the extension changes."""

from collections.abc import Mapping
from dataclasses import dataclass

import xarray as xr

from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF, UNEXPLAINED
from calib.report.pages.diagnosis.conclusion import headline, named_extension, points, stale
from calib.report.pages.diagnosis.extension import ExtensionSection, extension
from calib.report.pages.diagnosis.misfit import (
    BodyForce,
    FeatureRows,
    GateRow,
    RecordResidual,
    body_forces,
    clocks,
    feature_rows,
    gate_row,
    misfit_picture,
    record_residuals,
)
from calib.report.pages.diagnosis.next_measurement import NextMeasurement, next_measurement
from calib.report.pages.diagnosis.rounds import (
    RoundRow,
    distinction,
    explained_together,
    magnified_picture,
    round_rows,
    similar_effects,
)
from calib.report.pages.diagnosis.suspects import SuspectRows, outcome, strengths_picture, suspect_rows, wrong_signs
from calib.report.pages.picture import Picture
from calib.report.pages.verdict import Tone
from calib.study import CalibrationResult, CalibrationStudy
from calib.units import count

TONES: Mapping[str, Tone] = {NAMED: "good", NONE: "good", ONE_OF: "mind", UNEXPLAINED: "mind"}
QUESTIONS = {
    NAMED: "Why this cause",
    ONE_OF: "Why these causes",
    NONE: "Why no cause",
    UNEXPLAINED: "Why none of the effects",
}


@dataclass(frozen=True)
class DiagnosisChapter:
    """Everything that a page shows of a diagnosis, in the order of the page."""

    verdict: str
    tone: Tone
    stale: bool
    headline: str
    points: tuple[str, ...]
    gates: tuple[GateRow, ...]
    clocks: str
    loops: Picture | None
    features: FeatureRows
    residuals: tuple[RecordResidual, ...]
    forces: tuple[BodyForce, ...]
    strengths: Picture | None
    suspects: SuspectRows
    refused: Mapping[str, str]
    question: str
    why: tuple[str, ...]
    rounds: tuple[RoundRow, ...]
    explained: str
    magnified: Picture | None
    next_measurement: NextMeasurement | None
    extension: ExtensionSection | None
    effort: str


def chapter(
    diagnosis: DiagnosisResult,
    motions: Mapping[str, xr.Dataset],
    result: CalibrationResult,
    study: CalibrationStudy,
) -> DiagnosisChapter:
    """Everything that a page shows of a diagnosis.

    Parameters
    ----------
    motions : content of diagnosis.nc; may be empty
    result : of the calibration as it is now
    """
    outcomes = {suspect.effect: outcome(suspect, diagnosis) for suspect in diagnosis.suspects}
    forces, model = body_forces(motions), result.model
    return DiagnosisChapter(
        verdict=diagnosis.verdict.replace("_", " "),
        tone=_tone(diagnosis),
        stale=stale(diagnosis, result),
        headline=headline(diagnosis),
        points=(
            *points(diagnosis, any(force.significant for force in forces), not model or model.takes_laws),
            *similar_effects(diagnosis, outcomes),
            *wrong_signs(diagnosis, outcomes),
        ),
        gates=tuple(gate_row(gate, motions) for gate in diagnosis.gates),
        clocks=clocks(study.objective.references),
        loops=misfit_picture(motions),
        features=feature_rows(diagnosis),
        residuals=tuple(record_residuals(motions, named_extension(diagnosis))),
        forces=tuple(forces),
        strengths=strengths_picture(diagnosis, outcomes),
        suspects=suspect_rows(diagnosis, outcomes),
        refused=diagnosis.refused,
        question=QUESTIONS.get(diagnosis.verdict, "The search"),
        why=tuple(distinction(diagnosis, outcomes)),
        rounds=tuple(round_rows(diagnosis)),
        explained=explained_together(diagnosis),
        magnified=magnified_picture(diagnosis, motions),
        next_measurement=next_measurement(diagnosis),
        extension=extension(diagnosis, study.model.parameters),
        effort=f"{count(diagnosis.simulations, 'simulation')} in {diagnosis.seconds:.0f} s",
    )


def _tone(diagnosis: DiagnosisResult) -> Tone:
    """Good only where a named cause also reduces the misfit of data that the diagnosis did not use."""
    doubtful = diagnosis.verdict == NAMED and diagnosis.gain is not None and not diagnosis.gain.proven
    return "mind" if doubtful else TONES.get(diagnosis.verdict, "bad")
