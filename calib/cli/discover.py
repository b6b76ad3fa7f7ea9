"""`calib discover`: the force that was found, printed."""

import json
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.diagnose import DiagnosisProgress
from calib.cli.options import CauseSearch
from calib.cli.status import folder_of
from calib.diagnosis.discovery.artifacts import DISCOVERY
from calib.diagnosis.discovery.document import DescribingFunctionResult, DiscoveryResult, NumberResult
from calib.diagnosis.discovery.outcome import FOUND
from calib.units import count, plain_number, shown
from calib.workflows.command_line import command_line
from calib.workflows.discover import FORCE_PICTURE, discover_study


def print_discovery(study: Path, options: CauseSearch) -> None:
    """Search for a force law, and print what was found."""
    with DiagnosisProgress(options.silent) as progress:
        result, extended = discover_study(
            study, on_stage=progress.stage, on_progress=progress.simulated, **options.keywords
        )
    if options.as_json:
        click.echo(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    elif not options.quiet:
        show(result, folder_of(study, options.out), Console(highlight=False), extended)


def show(result: DiscoveryResult, folder: Path, console: Console, extended: Path | None = None) -> None:
    """Print the verdict, the force over its region, its formulas, the models compared, and where the files are."""
    colour = "green" if result.verdict == FOUND else "yellow"
    console.print(f"[bold {colour}]{result.verdict}[/]: {escape(result.summary)}", soft_wrap=True)
    for function in result.functions:
        for argument, unit, (low, high) in zip(function.arguments, function.units, function.region, strict=True):
            console.print(
                f"visited {argument}: {shown(low, unit)} to {shown(high, unit)}; linear beyond", soft_wrap=True
            )
        force = np.array(function.force)[np.array(function.visited)]
        console.print(
            f"force per unit mass there: {plain_number(force.min(), 3)} to {plain_number(force.max(), 3)} m/s^2",
            soft_wrap=True,
        )
    _formulas(result, console)
    _histories(result, console)
    for text in result.curves:
        console.print(escape(f"{text[:1].upper()}{text[1:]}."), soft_wrap=True)
    if result.describing_function is not None:
        console.print(escape(f"{result.describing_function.limits}."), soft_wrap=True)
        console.print(_describing_function(result.describing_function))
    for text in result.undetermined:
        console.print(f"not determined beside the calibrated parameters: {text}", soft_wrap=True)
    if result.trials:
        console.print(_trials(result))
    console.print(f"{count(result.simulations, 'simulation')} in {result.seconds:.1f} s")
    names = ", ".join([DISCOVERY, *([FORCE_PICTURE] if result.functions else []), "report.html"])
    console.print(f"files:  {escape(str(folder))}/ ({names})", soft_wrap=True)
    if extended is not None:
        told = f"extended study:  {extended}   ({command_line('run', extended)})"
        console.print(escape(told), soft_wrap=True)


def _formulas(result: DiscoveryResult, console: Console) -> None:
    """Print the formula of the force with its numbers, and the others that were refitted."""
    formula = result.formula
    if formula is not None:
        console.print(f"[bold]formula[/]: {escape(formula.text)}", soft_wrap=True)
        _numbers(formula.numbers, console)
    elif result.functions and not result.depends_on_history:
        console.print("no formula of the dictionary predicts as well as the free function", soft_wrap=True)
    if result.formulas:
        table = Table(title="formulas, refitted in the simulator", title_justify="left")
        table.add_column("formula")
        for heading in ("numbers", "chi-square", "left out", "RIC"):
            table.add_column(heading, justify="right")
        table.add_column("")
        least = min(f.ric for f in result.formulas)
        for own in result.formulas:
            left_out = "-" if own.left_out_deviance is None else f"{own.left_out_deviance:.5g}"
            remarks = [text for text, holds in (("tie", own.ties), ("front", own.on_front)) if holds]
            row = str(len(own.numbers)), f"{own.chi2:.5g}", left_out, f"+{own.ric - least:.1f}", ", ".join(remarks)
            table.add_row(escape(own.text), *row)
        console.print(table)


def _histories(result: DiscoveryResult, console: Console) -> None:
    """Print laws with internal states, and the numbers of the one that the force is where it depends on history."""
    if not result.histories:
        return
    if result.depends_on_history:
        best = result.histories[0]
        console.print(f"[bold]law[/]: {escape(best.effect)}, {escape(best.equation)}", soft_wrap=True)
        _numbers(best.numbers, console)
    table = Table(title="laws with internal states, refitted in its place", title_justify="left")
    table.add_column("law")
    for heading in ("chi-square", "left out"):
        table.add_column(heading, justify="right")
    for own in result.histories:
        left_out = "-" if own.left_out_deviance is None else f"{own.left_out_deviance:.5g}"
        table.add_row(escape(own.effect), f"{own.chi2:.5g}", left_out)
    console.print(table)


def _numbers(numbers: Sequence[NumberResult], console: Console) -> None:
    for n in numbers:
        error = "" if n.error is None else f" +- {plain_number(n.error, 1)}"
        console.print(
            f"  {n.name} = {plain_number(n.value)}{error} {escape(n.unit)}: {escape(n.meaning)}", soft_wrap=True
        )


def _describing_function(own: DescribingFunctionResult) -> Table:
    """Equivalent stiffness and damping per unit mass over the amplitude, as far as there is any."""
    table = Table(title=f"describing function per unit mass at {own.frequency:.4g} Hz", title_justify="left")
    columns = {"amplitude": [shown(a, "m") for a in own.amplitudes]}
    for name, values, errors in (
        ("equivalent stiffness [1/s^2]", own.stiffness, own.stiffness_error),
        ("equivalent damping [1/s]", own.damping, own.damping_error),
    ):
        if any(errors):
            pairs = zip(values, errors, strict=True)
            columns[name] = [f"{plain_number(n, 3)} +- {plain_number(e, 2)}" for n, e in pairs]
    for name in columns:
        table.add_column(escape(name), justify="right")
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    return table


def _trials(result: DiscoveryResult) -> Table:
    table = Table(title="forces that were fitted", title_justify="left")
    table.add_column("body", no_wrap=True)
    table.add_column("force")
    for heading in ("chi-square", "left out", "parameters"):
        table.add_column(heading, justify="right")
    for trial in result.trials:
        left_out = "-" if trial.left_out_deviance is None else f"{trial.left_out_deviance:.5g}"
        row = f"{trial.chi2:.5g}", left_out, f"{trial.effective_parameters:.1f}"
        table.add_row(escape(trial.body), trial.functions, *row)
    return table
