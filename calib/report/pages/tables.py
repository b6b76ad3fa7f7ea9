"""The rows of the tables of a page, as text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from markupsafe import Markup

from calib.confidence.identifiability import COLLINEAR
from calib.confidence.local import MAX_EDGE_DISTANCE
from calib.modelling.parameter import Window
from calib.records import OK
from calib.report.formatting import measured_number, number, number_and_half, raised
from calib.store import Header, Trial
from calib.store.trial import failures as by_cause
from calib.study import CalibrationResult, CalibrationStudy, UndeterminedGroup, UnreachableFeature
from calib.units import MILLI, count, shown, shown_unit

MAX_LISTED_TRIALS = 8  # numbers of failed trials that a row lists


@dataclass(frozen=True)
class TermRow:
    """Distance and weight of a term, and its share of the largest distance [%]."""

    label: str
    weight: float | None
    distance: float | None
    share: float


@dataclass(frozen=True)
class ParameterRow:
    """A searched parameter: value, twice its standard error, 95 % interval and window, in the unit shown."""

    name: str
    meaning: str
    numerical: bool
    unit: str
    value: str
    error: str | None
    interval: tuple[str, str] | None
    window: tuple[str, str]
    scale: str
    bar: Markup
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class FixedRow:
    """A parameter that is not searched, and why."""

    name: str
    value: str
    unit: str
    how: str
    meaning: str


@dataclass(frozen=True)
class UnreachableRow:
    """A measured feature that no trial reaches, as a row and as part of a sentence."""

    sentence: str
    feature: str
    record: str
    body: str
    measured: str
    nearest: str
    off: str


@dataclass(frozen=True)
class LeaderRow:
    """A leader of the search: its distances there and confirmed, and its kind of motion or why it failed."""

    trial: int
    searched: float | None
    confirmed: float | None
    motion: str
    failed: bool
    chosen: bool


@dataclass(frozen=True)
class FailureRow:
    """Trials that failed for one reason: how many, the reason of the first, and the first numbers."""

    status: str
    example: str
    number: int
    trials: tuple[int, ...]


@dataclass(frozen=True)
class NuisanceRow:
    """A nuisance of a record with its value."""

    record: str
    name: str
    value: str


def terms(study: CalibrationStudy, result: CalibrationResult) -> list[TermRow]:
    """Distance of each term of the score."""
    distances = result.score.terms
    weights = {t.label: t.weight for t in study.objective.terms}
    largest = max((d for d in distances.values() if d is not None), default=0.0)
    return [
        TermRow(label, weights.get(label), d, 100.0 * d / largest if d is not None and largest > 0.0 else 0.0)
        for label, d in distances.items()
    ]


def parameters(study: CalibrationStudy, result: CalibrationResult) -> list[ParameterRow]:
    """Value, error, interval and place in the window of each searched parameter, in the unit shown."""
    windows = study.space.windows
    return [_parameter(study, result, name, windows[name]) for name in windows if name in result.values]


def _parameter(study: CalibrationStudy, result: CalibrationResult, name: str, window: Window) -> ParameterRow:
    parameter, value = study.model.parameters.get(name.partition("@")[0]), result.values[name]
    interval = result.intervals.get(name)
    error = None if result.confidence is None else result.confidence.standard_error.get(name)
    position = window.position(value)
    remarks = []
    if name in result.at_edge or min(position, 1.0 - position) <= MAX_EDGE_DISTANCE:
        remarks.append(f"at the {'lower' if position < 0.5 else 'upper'} edge of its window")
    remarks += [_undetermined(name, group) for group in result.undetermined if name in group.members]
    scale, unit = shown_unit(parameter.unit if parameter else "1", max(abs(window.low), abs(window.high)))
    scaled = None if error is None else scale * error
    written, half = number_and_half(scale * value, None if scaled is None else 2.0 * scaled)
    return ParameterRow(
        name=name,
        meaning=parameter.meaning if parameter else "",
        numerical=parameter is not None and parameter.kind == "numerical",
        unit=raised(unit),
        value=written,
        error=half or None,
        interval=None
        if interval is None
        else (measured_number(scale * interval[0], scaled), measured_number(scale * interval[1], scaled)),
        window=(number(scale * window.low), number(scale * window.high)),
        scale=window.scale,
        bar=_bar(window, value, interval),
        remarks=tuple(remarks),
    )


def _undetermined(name: str, group: UndeterminedGroup) -> str:
    """Say how a parameter is undetermined: alone, only in combination with others, or nearly collinear with them."""
    others = [other for other in group.members if other != name]
    if others and group.reason == COLLINEAR:
        return f"nearly collinear with {', '.join(others)}"
    return f"determined only in combination with {', '.join(others)}" if others else "not determined inside its window"


def _bar(window: Window, value: float, interval: tuple[float, float] | None) -> Markup:
    """Position in the window as an SVG of 130 x 16: track, interval, value."""

    def place(x: float) -> float:
        return 5.0 + 120.0 * min(1.0, max(0.0, window.position(x)))

    band = ""
    if interval:
        left, right = place(interval[0]), place(interval[1])
        band = f'<rect x="{left:.1f}" y="4" width="{max(1.0, right - left):.1f}" height="8" rx="2" fill="#9ecae1"/>'
    centre = place(value)
    edge = min(centre - 5.0, 125.0 - centre) < 0.2
    return Markup(
        f'<svg class="bar" viewBox="0 0 130 16" width="130" height="16" role="img" '
        f'aria-label="at {100 * window.position(value):.0f} % of the window">'
        '<line x1="5" x2="125" y1="8" y2="8" stroke="#b5b5b5" stroke-width="1.5"/>'
        '<line x1="5" x2="5" y1="3" y2="13" stroke="#777"/><line x1="125" x2="125" y1="3" y2="13" stroke="#777"/>'
        f'{band}<circle cx="{centre:.1f}" cy="8" r="3.6" fill="{"#D55E00" if edge else "#0072B2"}"/></svg>'
    )


def fixed(study: CalibrationStudy, result: CalibrationResult) -> list[FixedRow]:
    """Parameters that are not searched, with the value that the study fixes or the nominal one.

    Those that are solved for with records as their nuisances have no value of the study.
    """
    solved = _solved(result)
    searched = {name.partition("@")[0] for name in study.space.windows if "@" not in name}
    rows = []
    for name, parameter in study.model.parameters.items():
        if name not in searched:
            value = study.space.fixed.get(name, parameter.nominal)
            how = "fixed by the study" if name in study.space.fixed else "nominal"
            own = [record for record, nuisances in solved.items() if name in nuisances]
            if own:
                how = f"nuisance, solved for in {', '.join(own)}"
            shown_value, unit = "-" if own else number(value), raised(parameter.unit or "1")
            rows.append(FixedRow(name, shown_value, unit, how, parameter.meaning))
    return rows


def unreachable(feature: UnreachableFeature) -> UnreachableRow:
    """Say of a feature that no trial reaches what was measured, what came nearest and how far off that is."""
    scale, unit = MILLI.get(feature.unit or "1", (1.0, feature.unit or "1"))
    measured, nearest = (None if x is None else scale * x for x in (feature.measured, feature.nearest))
    where = " ".join(x for x in (feature.body, f"in {feature.record}" if feature.record else "") if x)
    suffix = "" if unit == "1" else f" {unit}"
    relative = ""
    if measured and nearest is not None:
        relative = f"{100.0 * (nearest - measured) / abs(measured):+.3g} %"
    given = "no trial shows it" if nearest is None else f"nearest {number(nearest)}{suffix}"
    sentence = f"{feature.feature}{f' of {where}' if where else ''}"
    sentence += f" (measured {number(measured)}{suffix}, {given}{f', {relative}' if relative else ''})"
    return UnreachableRow(
        sentence=sentence,
        feature=feature.feature,
        record=feature.record,
        body=feature.body,
        measured=f"{number(measured)}{suffix}",
        nearest="none" if nearest is None else f"{number(nearest)}{suffix}",
        off=relative or ("" if feature.off is None else f"{number(scale * feature.off)}{suffix}"),
    )


def leaders(result: CalibrationResult) -> list[LeaderRow]:
    """Leaders of the search; empty where they were not to be confirmed."""
    if result.confirmation is None:
        return []
    return [
        LeaderRow(
            trial=leader.trial,
            searched=leader.searched,
            confirmed=leader.confirmed,
            motion=leader.kind or "" if leader.status == OK else f"{leader.status}: {leader.reason}",
            failed=leader.status != OK,
            chosen=leader.trial == result.confirmation.chosen,
        )
        for leader in result.confirmation.leaders
    ]


def failures(trials: Sequence[Trial]) -> list[FailureRow]:
    """Failed trials by status and cause; the most frequent first."""
    return [
        FailureRow(own[0].status, own[0].reason, len(own), tuple(t.number for t in own[:MAX_LISTED_TRIALS]))
        for own in by_cause(trials)
    ]


def nuisances(result: CalibrationResult) -> list[NuisanceRow]:
    """Value of each nuisance that was solved for, record by record."""
    units = result.nuisance_units
    return [
        NuisanceRow(record, name, _with_unit(value, units.get(name)))
        for record, own in _solved(result).items()
        for name, value in own.items()
    ]


def _solved(result: CalibrationResult) -> dict[str, Mapping[str, float]]:
    """Nuisances that were solved for, by record."""
    return {**result.nuisances, **{name: held.nuisances for name, held in result.holdout.items()}}


def _with_unit(value: float, unit: str | None) -> str:
    return number(value) if unit is None or unit == "1" else shown(value, unit)


def provenance(
    study: CalibrationStudy, result: CalibrationResult, command: str, header: Header | None
) -> dict[str, str]:
    """Everything that is needed to make the page again, by its heading."""
    rows = {
        "Command": command,
        "Model": study.model.name,
        "Seed": str(study.seed),
        "Budget": count(study.budget, "trial"),
        "Trials made": f"{result.trials}, of which {result.failed} failed",
    }
    if result.simulations is not None:
        rows["Simulations"] = str(result.simulations)
    if result.seconds:
        rows["Wall-clock time"] = f"{result.seconds:.1f} s"
    if result.stopped:
        rows["Search ended"] = result.stopped
    if result.reproduced is not None:
        rows["Best trial evaluated again"] = "same score" if result.reproduced else "another score: not reproducible"
    if header is not None:
        rows["Versions"] = ", ".join(f"{name} {version}" for name, version in header.versions.items())
        rows["Processor"] = header.processor
        if header.code:
            rows["Code of the study"] = ", ".join(f"{name} ({text})" for name, text in header.code.items())
    rows["Page written"] = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return rows
