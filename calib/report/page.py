"""The page of a study: what was found in a sentence, the pictures, the numbers, and how to make it again."""

import json
import math
import os
import platform
import re
import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import xarray as xr
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from calib.parameter import Window
from calib.record import OK
from calib.report import drawing, figures, residuals, search

PACKAGES = ("calib", "numpy", "scipy", "numba", "xarray", "optuna", "cma", "matplotlib")
LOOP = "Phase curves: velocity over displacement."
HISTORY = "Time histories."
IMPACTS = " Triangles and dashed lines mark impacts in the simulation."
OVER_PHASE = (
    "Measured minus simulated over the phase: mean of the cycles and two standard errors of it. "
    "What stands clear of zero is not noise."
)
STRUCTURE = (
    "Measured minus simulated: over time, against the motion (blue: mean in bins), its correlation with functions "
    "of displacement x and velocity v (blue bars: with what is linear in x and v taken out of both), its spectrum. "
    "A pattern or a long blue bar points to what the model lacks; near a resonance a missing force is seen a quarter "
    "of a period late: a spring's against the velocity."
)
COURSE = "Score of every trial in the order of asking, coloured by the kind of motion."
KINDS = "Where in the windows which kind of motion occurs: the score of every trial over each searched parameter."
NEAR_EDGE = 1e-3  # of the window; nearer than this is at its edge


def render(
    study,
    trials: Sequence,
    records: Mapping[str, xr.Dataset],
    result: Mapping[str, Any],
    command: str = "calib run study.toml",
) -> str:
    """HTML of the report, self-contained.

    Parameters
    ----------
    study : calib.study.Study; read are name, model, space, objective, budget, seed, definition
    trials : every trial of the ledger, in its order
    records : name of a reference -> record simulated at the best values, failed ones too; may be empty
    result : what result.json holds (see `calib.result`); what is not in it is left out of the page
    command : the command that makes it again
    """
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = number
    template = environment.from_string(resources.files("calib.report").joinpath("report.html.j2").read_text("utf-8"))
    best = next((t for t in trials if t.number == result.get("best_trial")), None)
    if best is None:
        best = min((t for t in trials if search.scored(t)), key=lambda t: t.total, default=None)
    return template.render(
        study=study,
        result=result,
        verdict=verdict(study, result),
        warnings=_warnings(study),
        sections=[_section(study, name, records.get(name), result) for name in _named(study, "calibrate")],
        others=[_section(study, name, records.get(name), result) for name in _named(study, "holdout", "name")],
        terms=_terms(study, result),
        parameters=_parameters(study, result),
        fixed=_fixed(study),
        groups=[_text(g) for g in result.get("undetermined", ())],
        unreachable=[_unreachable(entry) for entry in result.get("unreachable", ())],
        search=_search(study, trials, best),
        failures=_failures(trials),
        nuisances=_nuisances(result),
        provenance=_provenance(study, result, command),
        definition=json.dumps(study.definition, indent=2, default=str, ensure_ascii=False),
    )


def write(
    path: str | Path,
    study,
    trials: Sequence,
    records: Mapping[str, xr.Dataset],
    result: Mapping[str, Any],
    command: str = "calib run study.toml",
) -> Path:
    """Write the page so that the file is either whole or absent; arguments as for `render`."""
    path = Path(path)
    text = render(study, trials, records, result, command)
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
    return path


# --- the verdict ---------------------------------------------------------------------------------------------------


def verdict(study, result: Mapping[str, Any]) -> dict[str, Any]:
    """Say in sentences what was found: {"tone": "good" | "mind" | "bad", "headline": str, "points": [str]}."""
    total = (result.get("score") or {}).get("total")
    if total is None:
        return {
            "tone": "bad",
            "headline": "No trial ended with a score: nothing was calibrated.",
            "points": ["Why the trials failed is listed below."],
        }
    motion = result.get("motion") or {}
    wrong = motion.get("wrong") or []
    points = [_kind_sentence(motion), *_agreement(result), *_hold_out_sentence(result, total)]
    unreachable = result.get("unreachable") or []
    if unreachable:
        listed = "; ".join(_unreachable(entry)["sentence"] for entry in unreachable[:4])
        more = f"; and {len(unreachable) - 4} more" if len(unreachable) > 4 else ""
        points.append(
            f"No point of the windows reaches {_count(len(unreachable), 'measured feature')}: {listed}{more}. "
            "Windows that are too narrow, or a cause that the model lacks."
        )
    edges = _edges(study, result)
    if edges:
        points.append(
            f"At the edge of {'its window' if len(edges) == 1 else 'their windows'}: {', '.join(edges)}. "
            "A better value may lie outside."
        )
    points += [f"{_text(g)}." for g in result.get("undetermined", ())]
    confidence = result.get("confidence") or {}
    if confidence.get("status") == "not available":
        points.append(f"No standard errors: {confidence['reason']}.")
    elif confidence.get("reason"):
        points.append(f"Mind: {confidence['reason']}.")
    lost = [name for name, found in (result.get("holdout") or {}).items() if found.get("distance") is None]
    tone = "bad" if wrong else "mind" if unreachable or edges or lost else "good"
    headline = f"Best simulation at a distance of {number(total, 3)} from the measurement."
    if wrong:
        headline = f"{headline[:-1]}, but of another kind of motion."
    elif unreachable:
        headline = f"Nothing in the windows matches the measurement; the best is at a distance of {number(total, 3)}."
    return {"tone": tone, "headline": headline, "points": [p for p in points if p]}


def _kind_sentence(motion):
    kind = motion.get("kind")
    if not kind:
        return ""
    if kind == "not periodic":
        return "The excitation has no period: kinds of motion do not apply."
    if motion.get("wrong"):
        return (
            f"The best simulated motion is {kind}, which is not the measured kind in {', '.join(motion['wrong'])}: "
            "as long as the kinds differ, a distance between the curves says little."
        )
    return f"Kind of motion of the best simulation: {kind}{', as measured' if 'wrong' in motion else ''}."


def _agreement(result):
    found = result.get("agreement")
    if not found:
        return []
    if {"starts", "agree"} <= set(found):
        if found["starts"] < 2:
            return ["One start only: whether another would end elsewhere is not known."]
        one = f"{found['agree']} of {found['starts']} starts of the search ended at this point"
        return [f"{one}." if found["agree"] > 1 else f"{one}: it may not be the best of the windows."]
    said = [f"{k.replace('_', ' ')} {number(v)}" for k, v in found.items() if isinstance(v, int | float | str)]
    return [f"Of the search itself: {', '.join(said)}."] if said else []


def _hold_out_sentence(result, total):
    parts = []
    for name, found in (result.get("holdout") or {}).items():
        if found.get("distance") is None:
            parts.append(f"{name} failed ({found.get('status', 'no score')})")
        else:
            ratio = [f"{found['distance'] / total:.2g} times the calibrated one"] if total > 0.0 else []
            said = [found["kind"]] if found.get("kind") not in (None, "", "not periodic") else []
            kind = f" ({', '.join(said + ratio)})" if said + ratio else ""
            parts.append(f"{name} at {number(found['distance'], 3)}{kind}")
    return [f"Records held out are predicted: {'; '.join(parts)}."] if parts else []


def _edges(study, result):
    stated = result.get("at_edge") or []
    sides = (result.get("confidence") or {}).get("at_edge") or {}
    if isinstance(stated, Mapping):
        sides, stated = stated, list(stated)
    return [f"{name} ({sides[name]} end)" if name in sides else name for name in stated]


# --- sections ------------------------------------------------------------------------------------------------------


def _named(study, *uses):
    return [name for name, reference in study.objective.references.items() if reference.use in uses]


def _section(study, name, simulated, result):
    """Everything the page shows of one record."""
    reference = study.objective.references[name]
    measured = reference.record
    usable = simulated is not None and figures.usable(simulated)
    aligned = figures.beside(study.objective, name, simulated) if usable else None
    failed = ""
    if simulated is not None and not usable:
        failed = f"{simulated.attrs.get('status')}: {simulated.attrs.get('reason', 'no reason stated')}"
    loop = figures.phase_curves(measured, aligned)
    marked = IMPACTS if aligned is not None and figures.impact_times(aligned).size else ""
    pictures = [_pictured(loop, f"loop-{name}", LOOP + marked)] if loop is not None else []
    pictures.append(_pictured(figures.histories(measured, aligned), f"history-{name}", HISTORY + marked))
    return {
        "name": name,
        "use": reference.use,
        "source": measured.attrs.get("source", ""),
        "warning": measured.attrs.get("warning", ""),
        "driven": _driven(measured),
        "failed": failed,
        "found": (result.get("holdout") or {}).get(name),
        "pictures": pictures,
        "residuals": _residuals(name, measured, aligned, simulated) if reference.use == "calibrate" and usable else [],
        "rms": _relative_rms(measured, aligned) if usable else [],
    }


def _residuals(name, measured, aligned, simulated):
    over_phase = residuals.residual_over_phase(measured, aligned)
    if over_phase is not None:
        return [_pictured(over_phase, f"phase-{name}", OVER_PHASE)]
    if measured.attrs.get("frequency"):
        return []
    return [
        _pictured(
            residuals.residual_structure(measured, aligned, body, c, simulated),
            f"residual-{name}-{body}-{c}",
            STRUCTURE,
        )
        for body, c in figures.judged(measured, aligned)
    ]


def _relative_rms(measured, aligned):
    """Residual rms of every judged channel, relative to the rms of the measured one about its mean."""
    rows = []
    for body, channel in figures.judged(measured, aligned):
        truth = measured[channel].sel(body=body)
        residual = truth.values - aligned[channel].sel(body=body).values
        spread = float(truth.std())
        relative = math.sqrt(float((residual**2).mean())) / spread if spread > 0.0 else None
        rows.append({"body": body, "channel": channel, "relative": relative})
    return rows


def _driven(record):
    a = record.attrs
    quantity, place = a.get("quantity", ""), a.get("place", "")
    amplitude = ""
    if a.get("amplitude") is not None and a.get("frequency"):
        scale, unit = {"force": (1.0, "N")}.get(quantity, (1e3, "mm"))
        amplitude = f", {number(scale * float(a['amplitude']))} {unit}"
    frequency = f" at {number(float(a['frequency']))} Hz" if a.get("frequency") else ""
    if not quantity:
        return ""
    return f"driven by {quantity}{f' of the {place}' if place else ''}{amplitude}{frequency}"


def _warnings(study):
    found: dict[str, list[str]] = {}
    for name, reference in study.objective.references.items():
        if reference.record.attrs.get("warning"):
            found.setdefault(str(reference.record.attrs["warning"]), []).append(name)
    return [{"text": text, "records": names} for text, names in found.items()]


def _terms(study, result):
    distances = (result.get("score") or {}).get("terms") or {}
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


def _parameters(study, result):
    values = result.get("values") or {}
    return [
        _parameter(study, result, name, window, values[name])
        for name, window in study.space.windows.items()
        if name in values
    ]


def _parameter(study, result, name, window: Window, value):
    parameter = study.model.parameters.get(name.partition("@")[0])
    confidence = result.get("confidence") or {}
    interval = (result.get("intervals") or {}).get(name)
    error = (confidence.get("standard_error") or {}).get(name)
    position = window.position(value)
    remarks = []
    if name in (result.get("at_edge") or ()) or min(position, 1.0 - position) <= NEAR_EDGE:
        remarks.append(f"at the {'lower' if position < 0.5 else 'upper'} edge of its window")
    if any(name in g["members"] for g in result.get("undetermined", ()) if isinstance(g, Mapping)):
        remarks.append("not determined on its own")
    scale, unit = drawing.shown_unit(parameter.unit if parameter else "1", max(abs(window.low), abs(window.high)))
    scaled = None if error is None else scale * error
    return {
        "name": name,
        "meaning": parameter.meaning if parameter else "",
        "numerical": bool(parameter) and parameter.kind == "numerical",
        "unit": unit,
        "value": measured_number(scale * value, scaled),
        "error": number(2.0 * scaled, 2) if scaled is not None else None,
        "interval": [measured_number(scale * x, scaled) for x in interval] if interval else None,
        "window": [number(scale * window.low), number(scale * window.high)],
        "scale": window.scale,
        "bar": _bar(window, value, interval),
        "remarks": remarks,
    }


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


def _fixed(study):
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


def _unreachable(entry):
    if not isinstance(entry, Mapping):
        return {
            "sentence": str(entry),
            "feature": str(entry),
            "record": "",
            "body": "",
            "measured": "",
            "nearest": "",
            "off": "",
        }
    scale, unit = {"m": (1e3, "mm"), "s": (1e3, "ms")}.get(entry.get("unit") or "1", (1.0, entry.get("unit") or "1"))
    measured, nearest = (None if entry.get(k) is None else scale * entry[k] for k in ("measured", "nearest"))
    where = " ".join(x for x in (entry.get("body"), f"in {entry['record']}" if entry.get("record") else "") if x)
    shown = "" if unit == "1" else f" {unit}"
    off = entry.get("off")
    relative = ""
    if measured not in (None, 0.0) and nearest is not None:
        relative = f"{100.0 * (nearest - measured) / abs(measured):+.3g} %"
    given = "no trial gives it at all" if nearest is None else f"nearest {number(nearest)}{shown}"
    sentence = f"{entry['feature']}{f' of {where}' if where else ''}"
    sentence += f" (measured {number(measured)}{shown}, {given}{f', {relative}' if relative else ''})"
    return {
        "sentence": sentence,
        "feature": entry["feature"],
        "record": entry.get("record") or "",
        "body": entry.get("body") or "",
        "measured": f"{number(measured)}{shown}",
        "nearest": "none" if nearest is None else f"{number(nearest)}{shown}",
        "off": relative or (number(off) if off is not None else ""),
    }


def _search(study, trials, best):
    if not trials:
        return []
    kinds = search.kinds_of_motion(trials, study.space, study.model.parameters, best)
    return [_pictured(search.score_history(trials), "history", COURSE), _pictured(kinds, "kinds", KINDS)]


def _failures(trials):
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


def _nuisances(result):
    rows = []
    for record, found in (result.get("nuisances") or {}).items():
        rows += [{"record": record, "name": name, "value": value} for name, value in (found or {}).items()]
    return rows


def _provenance(study, result, command):
    stated = dict(result.get("provenance") or {})
    versions = stated.pop("versions", None) or {p: _version(p) for p in PACKAGES}
    rows = {
        "Command": stated.pop("command", command),
        "Model": study.model.name,
        "Seed": study.seed,
        "Budget": f"{study.budget} trials",
        "Trials made": f"{result.get('trials', '-')}, of which {result.get('failed', '-')} failed",
    }
    if result.get("simulations") is not None:
        rows["Simulations"] = result["simulations"]
    if result.get("seconds"):
        rows["Wall-clock time"] = f"{result['seconds']:.1f} s"
    if result.get("stopped"):
        rows["Search ended"] = result["stopped"]
    rows |= {key.capitalize(): value for key, value in stated.items()}
    rows["Versions"] = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    rows["Machine"] = (
        stated.get("processor") or f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}"
    )
    rows["Page written"] = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return rows


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _pictured(figure, name: str, caption: str) -> dict[str, Any]:
    return {"svg": Markup(drawing.svg(figure, name)), "caption": caption}


# --- words ---------------------------------------------------------------------------------------------------------


def number(x: Any, digits: int = 4) -> str:
    """Write a number for a reader: `digits` significant ones, powers of ten as such."""
    if x is None:
        return "-"
    if isinstance(x, bool | str):
        return str(x)
    if isinstance(x, int):
        return str(x)
    if not math.isfinite(x):
        return "∞" if x > 0 else "-∞" if x < 0 else "-"
    if x == 0.0:
        return "0"
    power = math.floor(math.log10(abs(x)))
    if -4 <= power < 6:
        text = f"{x:.{max(0, digits - 1 - power)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa = f"{x / 10.0**power:.{digits - 1}f}".rstrip("0").rstrip(".")
    return f"{mantissa}·10{str(power).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


def measured_number(value: float, error: float | None) -> str:
    """Write a value with the digits that its standard error leaves it, 4 to 8 of them."""
    if not error or not math.isfinite(error) or value == 0.0:
        return number(value)
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 2
    return number(value, min(8, max(4, digits)))


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _text(group) -> str:
    return group["text"] if isinstance(group, Mapping) else str(group)
