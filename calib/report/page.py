"""The page of a study: what was found in a sentence, the pictures, the numbers, and how to make it again."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined

from calib.objective import CLOCK_RATE, MISFIT, misfit, squares_of
from calib.objective.objective import MIN_COST_OF_WRONG_KIND
from calib.report import figures, residuals, search, tables
from calib.report.diagnosis import chapter
from calib.report.picture import drawn, pictured
from calib.report.verdict import verdict
from calib.report.words import number, percent
from calib.study import CalibrationResult
from calib.units import MILLI

LOOP = "Phase curves: velocity over displacement."
HISTORY = "Time histories."
IMPACTS = " Triangles and dashed lines mark impacts in the simulation."
OVER_PHASE = (
    "Measured minus simulated over the phase: mean of the cycles and two standard errors of it. "
    "What stands clear of zero is not noise."
)
STRUCTURE = (
    "Measured minus simulated: over time, against the motion (blue: mean in bins), its correlation with functions "
    "of displacement x and velocity v, which are simulated, or prescribed where the record prescribes them (blue bars: "
    "with what is linear in x and v taken out of both; a function of which that leaves nothing has no bar), its "
    "spectrum. "
    "A pattern or a long blue bar points to what the model lacks; near a resonance a missing force is seen a quarter "
    "of a period late: a spring's against the velocity."
)
COURSE = "Score of every trial in the order of asking, coloured by the kind of motion."
KINDS = "Where in the windows which kind of motion occurs: the score of every trial over each searched parameter."


def render(
    study,
    trials: Sequence,
    records: Mapping[str, xr.Dataset],
    result: CalibrationResult,
    command: str = "calib run study.toml",
    header: Mapping[str, Any] | None = None,
    diagnosis: Mapping[str, Any] | None = None,
    motions: Mapping[str, xr.Dataset] | None = None,
    jobs: int = 1,
) -> str:
    """HTML of the report, self-contained.

    Parameters
    ----------
    study : calib.study.CalibrationStudy; read are name, model, space, objective, budget, seed, definition
    trials : every trial of the ledger, in its order
    records : name of a reference -> record simulated at the best values, failed ones too; may be empty
    result : of the calibration; what it does not know is left out of the page
    command : the command that makes it again
    header : of the ledger; read are versions and processor
    diagnosis : what diagnosis.json holds; None where there was no diagnosis
    motions : what diagnosis.nc holds (see `calib.report.residual_plots`)
    jobs : number of processes that draw its figures
    """
    environment = Environment(
        loader=PackageLoader("calib.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"], environment.filters["distance"] = number, distance
    template = environment.get_template("report.html.j2")
    best = next((t for t in trials if t.number == result.best_trial), None)
    content = dict(
        study=study,
        result=result,
        verdict=verdict(result),
        warnings=_warnings(study),
        sections=[_section(study, name, records.get(name), result) for name in _named(study, "calibrate")],
        others=[_section(study, name, records.get(name), result) for name in _named(study, "holdout", "name")],
        terms=tables.terms(study, result),
        parameters=tables.parameters(study, result),
        fixed=tables.fixed(study),
        groups=[group.text for group in result.undetermined],
        unreachable=[tables.unreachable(feature) for feature in result.unreachable],
        leaders=tables.leaders(result),
        confirmed=result.confirmed,
        d=None if diagnosis is None else chapter(diagnosis, motions or {}, result, study),
        search=_search(study, trials, best),
        failures=tables.failures(trials),
        nuisances=tables.nuisances(result),
        provenance=tables.provenance(study, result, command, header or {}),
        misfit=MISFIT,
        wrong=MIN_COST_OF_WRONG_KIND,
        definition=json.dumps(study.definition, indent=2, default=str, ensure_ascii=False),
    )
    return template.render(content, drawn=drawn(content, jobs))


def distance(total: float | None) -> str:
    """Write a total distance; one that is the penalty for another kind of motion is said to be that."""
    return (
        f"{number(total)}{', another kind of motion' if total is not None and total >= MIN_COST_OF_WRONG_KIND else ''}"
    )


# --- sections ------------------------------------------------------------------------------------------------------


def _named(study, *uses):
    return [name for name, reference in study.objective.references.items() if reference.use in uses]


def _section(study, name, simulated, result):
    """Everything the page shows of one record."""
    reference, found = study.objective.references[name], result.holdout.get(name)
    measured = reference.record
    usable = simulated is not None and figures.usable(simulated)
    aligned = figures.beside(study.objective, name, simulated) if usable else None
    failed = ""
    if simulated is not None and not usable:
        failed = f"{simulated.attrs.get('status')}: {simulated.attrs.get('reason', 'no reason stated')}"
    loop = figures.phase_curves(measured, aligned)
    marked = IMPACTS if aligned is not None and figures.impact_times(aligned).size else ""
    pictures = [pictured(loop, f"loop-{name}", LOOP + marked)] if loop is not None else []
    pictures.append(pictured(figures.histories(measured, aligned), f"history-{name}", HISTORY + marked))
    return {
        "name": name,
        "use": reference.use,
        "source": measured.attrs.get("source", ""),
        "warning": measured.attrs.get("warning", ""),
        "driven": _driven(measured),
        "failed": failed,
        "kind": None if found is None else found.kind,
        "misfit": percent(None if found is None else found.misfit, 3),
        "score": None if found is None else found.score,
        "pictures": pictures,
        "residuals": _residuals(name, measured, aligned, simulated) if reference.use == "calibrate" and usable else [],
        "rms": _relative_rms(measured, aligned) if usable else [],
    }


def _residuals(name, measured, aligned, simulated):
    over_phase = residuals.residual_over_phase(measured, aligned)
    if over_phase is not None:
        return [pictured(over_phase, f"phase-{name}", OVER_PHASE)]
    if measured.attrs.get("frequency"):
        return []
    return [
        pictured(
            residuals.residual_structure(measured, aligned, body, c, simulated),
            f"residual-{name}-{body}-{c}",
            STRUCTURE,
        )
        for body, c in figures.judged(measured, aligned)
    ]


def _relative_rms(measured, aligned):
    """Misfit of every judged channel: residual rms relative to the rms of the measured one about its mean."""
    rows = []
    for body, channel in figures.judged(measured, aligned):
        relative = misfit([squares_of(measured, aligned, [(body, channel)])])
        moves = float(measured[channel].sel(body=body).std()) > 0.0
        rows.append({"body": body, "channel": channel, "relative": relative if moves else None})
    return rows


def _driven(record):
    a = record.attrs
    quantity, place = a.get("quantity", ""), a.get("place", "")
    amplitude = ""
    if a.get("amplitude") is not None and a.get("frequency"):
        scale, unit = {"force": (1.0, "N")}.get(quantity, MILLI["m"])
        amplitude = f", {number(scale * float(a['amplitude']))} {unit}"
    frequency = f" at {number(float(a['frequency']))} Hz" if a.get("frequency") else ""
    if not quantity:
        return ""
    return f"driven by {quantity}{f' of the {place}' if place else ''}{amplitude}{frequency}{_clock(a)}"


def _clock(attrs):
    """What the cycles say of the recorder's clock."""
    rate = attrs.get(CLOCK_RATE, 0.0)
    side = "slow" if rate > 0.0 else "fast"
    return f"; the recorder's clock is {number(1e6 * abs(rate))} ppm {side} against the drive's" if rate else ""


def _warnings(study):
    found: dict[str, list[str]] = {}
    for name, reference in study.objective.references.items():
        if reference.record.attrs.get("warning"):
            found.setdefault(str(reference.record.attrs["warning"]), []).append(name)
    return [{"text": text, "records": names} for text, names in found.items()]


def _search(study, trials, best):
    if not trials:
        return []
    kinds = search.kinds_of_motion(trials, study.space, study.model.parameters, best)
    return [pictured(search.score_history(trials), "history", COURSE), pictured(kinds, "kinds", KINDS)]
