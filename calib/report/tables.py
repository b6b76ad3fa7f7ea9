"""The rows of the page's tables."""

import re
from datetime import UTC, datetime
from typing import Any

from markupsafe import Markup

from calib.confidence.identifiability import COLLINEAR
from calib.confidence.local import EDGE
from calib.modelling.parameter import Window
from calib.records import OK
from calib.report import drawing
from calib.report.words import measured_number, number, number_beside
from calib.study import CalibrationResult, UndeterminedGroup, UnreachableFeature
from calib.units import MILLI, shown


def terms(study, result: CalibrationResult) -> list[dict[str, Any]]:
    """Distance of each term, its weight, and its share of the largest [%]."""
    distances = result.score.terms
    weights = {t.label: t.weight for t in study.objective.terms}
    largest = max((d for d in distances.values() if d is not None), default=0.0)
    return [
        {
            "label": label,
            "weight": weights.get(label),
            "distance": d,
            "share": 100.0 * d / largest if d is not None and largest > 0.0 else 0.0,
        }
        for label, d in distances.items()
    ]


def parameters(study, result: CalibrationResult) -> list[dict[str, Any]]:
    """Value, error, interval and place in the window of each searched parameter, in the unit of a reader."""
    values = result.values
    return [
        _parameter(study, result, name, window, values[name])
        for name, window in study.space.windows.items()
        if name in values
    ]


def _parameter(study, result: CalibrationResult, name, window: Window, value):
    parameter = study.model.parameters.get(name.partition("@")[0])
    interval = result.intervals.get(name)
    error = None if result.confidence is None else result.confidence.standard_error.get(name)
    position = window.position(value)
    remarks = []
    if name in result.at_edge or min(position, 1.0 - position) <= EDGE:
        remarks.append(f"at the {'lower' if position < 0.5 else 'upper'} edge of its window")
    remarks += [_undetermined(name, group) for group in result.undetermined if name in group.members]
    scale, unit = drawing.shown_unit(parameter.unit if parameter else "1", max(abs(window.low), abs(window.high)))
    scaled = None if error is None else scale * error
    return {
        "name": name,
        "meaning": parameter.meaning if parameter else "",
        "numerical": bool(parameter) and parameter.kind == "numerical",
        "unit": unit,
        "value": measured_number(scale * value, scaled),
        "error": number_beside(2.0 * scaled, scale * value) if scaled is not None else None,
        "interval": [measured_number(scale * x, scaled) for x in interval] if interval else None,
        "window": [number(scale * window.low), number(scale * window.high)],
        "scale": window.scale,
        "bar": _bar(window, value, interval),
        "remarks": remarks,
    }


def _undetermined(name: str, group: UndeterminedGroup) -> str:
    """Say how a parameter is undetermined: not at all, or because it is nearly collinear with others."""
    others = [other for other in group.members if other != name]
    if others and group.reason == COLLINEAR:
        return f"nearly collinear with {', '.join(others)}"
    return "not determined on its own"


def _bar(window: Window, value: float, interval) -> Markup:
    """Position in the window as an SVG of 130 x 16: track, interval, value."""

    def place(x: float) -> float:
        return 5.0 + 120.0 * min(1.0, max(0.0, window.position(x)))

    band = ""
    if interval:
        left, right = place(interval[0]), place(interval[1])
        band = f'<rect x="{left:.1f}" y="4" width="{max(1.0, right - left):.1f}" height="8" rx="2" fill="#9ecae1"/>'
    at = place(value)
    edge = min(at - 5.0, 125.0 - at) < 0.2
    return Markup(
        f'<svg class="bar" viewBox="0 0 130 16" width="130" height="16" role="img" '
        f'aria-label="at {100 * window.position(value):.0f} % of the window">'
        '<line x1="5" x2="125" y1="8" y2="8" stroke="#b5b5b5" stroke-width="1.5"/>'
        '<line x1="5" x2="5" y1="3" y2="13" stroke="#777"/><line x1="125" x2="125" y1="3" y2="13" stroke="#777"/>'
        f'{band}<circle cx="{at:.1f}" cy="8" r="3.6" fill="{"#D55E00" if edge else "#0072B2"}"/></svg>'
    )


def fixed(study) -> list[dict[str, Any]]:
    """Parameters that are not searched: those the study fixes, then those left at their nominal value."""
    searched = {name.partition("@")[0] for name in study.space.windows if "@" not in name}
    rows = []
    for name, parameter in study.model.parameters.items():
        if name not in searched:
            value = study.space.fixed.get(name, parameter.nominal)
            how = "fixed by the study" if name in study.space.fixed else "nominal"
            rows.append(
                {
                    "name": name,
                    "value": number(value),
                    "unit": parameter.unit or "1",
                    "how": how,
                    "meaning": parameter.meaning,
                }
            )
    return rows


def unreachable(feature: UnreachableFeature) -> dict[str, str]:
    """Say of a feature that no trial reaches what was measured, what came nearest and how far off that is."""
    scale, unit = MILLI.get(feature.unit or "1", (1.0, feature.unit or "1"))
    measured, nearest = (None if x is None else scale * x for x in (feature.measured, feature.nearest))
    where = " ".join(x for x in (feature.body, f"in {feature.record}" if feature.record else "") if x)
    shown = "" if unit == "1" else f" {unit}"
    off = feature.off
    relative = ""
    if measured not in (None, 0.0) and nearest is not None:
        relative = f"{100.0 * (nearest - measured) / abs(measured):+.3g} %"
    given = "no trial gives it at all" if nearest is None else f"nearest {number(nearest)}{shown}"
    sentence = f"{feature.feature}{f' of {where}' if where else ''}"
    sentence += f" (measured {number(measured)}{shown}, {given}{f', {relative}' if relative else ''})"
    return {
        "sentence": sentence,
        "feature": feature.feature,
        "record": feature.record,
        "body": feature.body,
        "measured": f"{number(measured)}{shown}",
        "nearest": "none" if nearest is None else f"{number(nearest)}{shown}",
        "off": relative or (f"{number(scale * off)}{shown}" if off is not None else ""),
    }


def leaders(result: CalibrationResult) -> list[dict[str, Any]]:
    """Leaders of the search: distance there and confirmed, kind of motion or why there is none; empty where unasked."""
    if result.confirmation is None:
        return []
    return [
        {
            "trial": leader.trial,
            "searched": leader.searched,
            "confirmed": leader.confirmed,
            "said": leader.kind if leader.status == OK else f"{leader.status}: {leader.reason}",
            "failed": leader.status != OK,
            "chosen": leader.trial == result.confirmation.chosen,
        }
        for leader in result.confirmation.leaders
    ]


def failures(trials) -> list[dict[str, Any]]:
    """Failed trials by status and by reason with its numbers struck out, the most frequent first."""
    groups: dict[tuple[str, str], list] = {}
    for trial in trials:
        if trial.status != OK:
            reason = re.sub(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?", "…", trial.reason or "")
            groups.setdefault((trial.status, reason), []).append(trial)
    ordered = sorted(groups.items(), key=lambda item: -len(item[1]))
    return [
        {
            "status": status,
            "example": members[0].reason or "",
            "count": len(members),
            "trials": [t.number for t in members[:8]],
        }
        for (status, _), members in ordered
    ]


def nuisances(result: CalibrationResult) -> list[dict[str, Any]]:
    """Record, name and value of each nuisance that was solved for."""
    solved = {**result.nuisances, **{name: held.nuisances for name, held in result.holdout.items()}}
    return [
        {"record": record, "name": name, "value": _with_unit(value, result.nuisance_units.get(name))}
        for record, own in solved.items()
        for name, value in own.items()
    ]


def _with_unit(value: float, unit: str | None) -> str:
    return number(value) if unit in (None, "1") else shown(value, unit)


def provenance(study, result: CalibrationResult, command, header) -> dict[str, Any]:
    """Everything that is needed to make the page again, by what it is called."""
    rows = {
        "Command": command,
        "Model": study.model.name,
        "Seed": study.seed,
        "Budget": f"{study.budget} trials",
        "Trials made": f"{result.trials}, of which {result.failed} failed",
    }
    if result.simulations is not None:
        rows["Simulations"] = result.simulations
    if result.seconds:
        rows["Wall-clock time"] = f"{result.seconds:.1f} s"
    if result.stopped:
        rows["Search ended"] = result.stopped
    if header:
        rows["Versions"] = ", ".join(f"{name} {version}" for name, version in header["versions"].items())
        rows["Processor"] = header["processor"]
    rows["Page written"] = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return rows
