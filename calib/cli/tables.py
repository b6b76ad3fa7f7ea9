"""What the commands print: results, status and the catalogue, as tables on stdout."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.status import StudyStatus
from calib.dynamics.curves import BifurcationCurve
from calib.modelling.parameter import Parameter
from calib.objective import MISFIT
from calib.records import OK
from calib.report.pages.verdict import far_sentences, residual_sentences, starts_sentences
from calib.study import CalibrationResult
from calib.units import count, reading, shown

MAX_DECIMALS = 6  # beyond, a number is written with a power of ten
DEFAULT_COLUMNS = 120  # columns, where the output is no terminal


def show_result(result: CalibrationResult, folder: Path, console: Console | None = None) -> None:
    """Print what a study found (the content of its `result.json`)."""
    console = console or _console()
    if result.status != OK:
        console.print(f"[bold]{escape(result.name)}[/]: none of {count(result.trials, 'trial')} ended ok")
    else:
        console.print(_parameters(result))
        console.print(_scores(result))
        if result.holdout:
            console.print(_held_out(result))
        for line in _remarks(result):
            console.print(line, soft_wrap=True)
    console.print(f"trials: {result.trials}, of which {result.failed} failed; {result.seconds:.1f} s")
    for failure in result.failures:
        reason = escape(failure.reason.partition("\n")[0])
        console.print(f"failed: {failure.trials} ({escape(failure.status)}), such as: {reason}", soft_wrap=True)
    console.print(f"files:  {escape(str(folder))}/ (report.html, result.json, best.nc, trials.jsonl)", soft_wrap=True)


def _console() -> Console:
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=DEFAULT_COLUMNS)


def _parameters(result: CalibrationResult) -> Table:
    table = Table(title=escape(result.name), title_justify="left", title_style="bold")
    table.add_column("parameter")
    for heading in ("value", "± 2 s.e.", "window"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("")
    errors = {} if result.confidence is None else result.confidence.standard_error
    edges = {} if result.confidence is None else result.confidence.at_edge
    for name, window in result.windows.items():
        unit = result.units[name]
        error = errors.get(name)
        table.add_row(
            escape(name),
            *_measured(result.values[name], None if error is None else 2.0 * error, unit),
            f"{shown(window.low, unit)} .. {shown(window.high, unit)}",
            f"[yellow]at the {edges[name]} edge of its window[/]" if name in edges else "",
        )
    return table


def _measured(value: float, error: float | None, unit: str) -> tuple[str, str]:
    """Write value and error with as many decimals as the error's second digit has."""
    if not error:
        return shown(value, unit, 6), "-"
    factor, name = reading(unit, value)
    value, error = factor * value, factor * error
    place = 1 - math.floor(math.log10(error))
    value, error = round(value, place), round(error, place)
    decimals = max(0, place)
    form = f".{decimals}f"
    if decimals > MAX_DECIMALS and value:
        form = f".{max(1, decimals + math.floor(math.log10(abs(value))))}e"
    return f"{value:{form}} {name}".rstrip(), f"{error:{form if 'f' in form else '.1e'}} {name}".rstrip()


def _scores(result: CalibrationResult) -> Table:
    table = Table(title=None)
    table.add_column("distance")
    table.add_column("", justify="right")
    table.add_column("kind of motion")
    for label, distance in result.score.terms.items():
        table.add_row(escape(label), shown(distance, "1"))
    table.add_row("[bold]total[/]", f"[bold]{shown(result.score.total, '1')}[/]", result.motion.kind or "")
    return table


def _held_out(result: CalibrationResult) -> Table:
    """Misfit of each record that was held out; what that is stands below."""
    table = Table(caption=f"misfit: {MISFIT}", caption_justify="left")
    table.add_column("held out")
    table.add_column("misfit", justify="right")
    table.add_column("score of the study's terms", justify="right")
    table.add_column("kind of motion")
    for record, held in result.holdout.items():
        outcome = held.kind or "" if held.status == OK else f"{held.status}: {held.reason}"
        values = (shown(number, "1") for number in (held.misfit, held.score))
        table.add_row(escape(record), *values, escape(outcome))
    return table


def _remarks(result: CalibrationResult) -> list[str]:
    confidence = result.confidence
    wrong, evidence = ", ".join(result.motion.wrong), result.motion.evidence or ""
    lines = [f"[red]another kind of motion than measured[/] in {escape(wrong)}: {escape(evidence)}"] if wrong else []
    lines += [f"[yellow]mind:[/] {escape(group.text)}" for group in result.undetermined]
    if confidence is None or confidence.status != OK:
        why = "not worked out" if confidence is None else confidence.reason
        lines.append(f"[yellow]no intervals:[/] {escape(why)}")
    for feature in result.unreachable:
        lines.append(f"[yellow]no point of the window reaches[/] {escape(str(feature))}")
    far = far_sentences(result.score.total)
    lines += [f"[yellow]mind:[/] {escape(remark)}" for remark in (*result.remarks, *far)]
    doubt = "" if all(one.is_noise for one in result.residual) else "[yellow]mind:[/] "
    lines += [f"{doubt}{escape(sentence)}" for sentence in residual_sentences(result)]
    if result.confirmation is not None and result.confirmation.succeeded:
        leaders = count(len(result.confirmation.leaders), "leader")
        lines.append(f"{leaders} of the search confirmed, trial {result.confirmation.chosen} taken")
    return [*lines, *starts_sentences(result)]


def show_status(status: StudyStatus) -> None:
    """Print how far a study is."""
    console = _console()
    console.print(f"[bold]{escape(status.name)}[/]: {status.state}, {status.trials} of {count(status.budget, 'trial')}")
    best = status.best
    if best is not None:
        console.print(f"best score {shown(best.total, '1')} ({best.kind}) at trial {best.number}")
        for name, unit in status.units.items():
            console.print(f"  {escape(name)} = {shown(best.values[name], unit, 6)}")
    for reason, trials in status.failed.items():
        console.print(f"failed: {trials} ({escape(reason)})")
    if status.seconds is not None:
        console.print(f"{status.seconds:.3g} s a trial")
    console.print(f"files: {escape(status.folder)}", soft_wrap=True)


def show_catalogue(groups: Mapping[str, Mapping[str, str]]) -> None:
    """Print name and meaning of everything that a study file may name, by group."""
    console = _console()
    for group, things in groups.items():
        table = Table(title=group, title_justify="left", title_style="bold", show_header=False, box=None)
        for name, meaning in things.items():
            table.add_row(f"  {escape(name)}", escape(meaning))
        console.print(table)


def show_thing(facts: Iterable[tuple[str, str]], parameters: Sequence[Parameter]) -> None:
    """Print the facts about one simulator, effect, feature or optimiser, and its parameters."""
    console = _console()
    for what, text in facts:
        console.print(f"[bold]{what}[/]: {escape(text)}", soft_wrap=True)
    if parameters:
        table = Table("parameter", "unit", "nominal", "allowed", "meaning")
        for p in parameters:
            table.add_row(escape(p.name), p.unit, f"{p.nominal:.6g}", escape(p.interval), escape(p.meaning))
        console.print(table)


def show_curves(
    curves: Sequence[BifurcationCurve],
    names: tuple[str, str],
    units: tuple[str, str],
    console: Console | None = None,
) -> None:
    """Print the curves over `names` [units]: where they are, how they end, and their points of codimension two."""
    console = console or _console()
    table = Table()
    for heading in ("", "curve", "period", "impacts", *names, "points", "bounds stable motion"):
        table.add_column(heading, justify="left" if heading == "curve" else "right")
    for number, curve in enumerate(curves, start=1):
        spans = [_span(values, unit) for values, unit in zip((curve.a, curve.b), units, strict=True)]
        impacts = "/".join(str(count) for count in sorted(set(curve.impacts.tolist())))
        share = f"{100.0 * curve.bounding.mean():.0f} %" if curve.a.size else ""
        table.add_row(str(number), curve.kind, str(curve.periods), impacts, *spans, str(curve.a.size), share)
    console.print(table)
    for number, curve in enumerate(curves, start=1):
        for point in curve.points:
            where = ", ".join(
                f"{name} = {shown(value, unit, 8)}"
                for name, value, unit in zip(names, (point.a, point.b), units, strict=True)
            )
            text = f"  {number}: {point.kind} at {where}, a zero of: {point.test}; {point.evidence}"
            console.print(escape(text), soft_wrap=True)
        for end in dict.fromkeys(curve.ends):
            console.print(escape(f"  {number}: ends: {end}"), soft_wrap=True)


def _span(values: np.ndarray, unit: str) -> str:
    return f"{shown(values.min(), unit)} .. {shown(values.max(), unit)}" if values.size else ""
