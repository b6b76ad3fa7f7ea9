"""`calib discover`: the force that was found, printed."""

import json
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.diagnose import DiagnosisProgress
from calib.cli.options import pool_table
from calib.cli.status import folder_of
from calib.diagnosis.discovery.discover import FOUND
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.units import shown
from calib.workflows.discover import DISCOVERY, FORCE_PICTURE, discover_study


def print_discovery(
    study: Path, out: Path | None, jobs: int | None, pool: str | None, seed: int | None, quiet: bool, as_json: bool
) -> None:
    """Search for a force law, and print what was found."""
    with DiagnosisProgress(quiet or as_json) as progress:
        result = discover_study(
            study, out, seed=seed, jobs=jobs, on_stage=progress.stage, on_progress=progress.simulated,
            pool=pool_table(pool),
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    elif not quiet:
        show(result, folder_of(study, out), Console(highlight=False))


def show(result: DiscoveryResult, folder: Path, console: Console) -> None:
    """Print the verdict, the force over its region, the models that were compared, and where the files are."""
    colour = "green" if result.verdict == FOUND else "yellow"
    console.print(f"[bold {colour}]{result.verdict}[/]: {escape(result.summary)}", soft_wrap=True)
    for function in result.functions:
        for argument, unit, (low, high) in zip(function.arguments, function.units, function.region, strict=True):
            console.print(
                f"visited {argument}: {shown(low, unit)} to {shown(high, unit)}; linear beyond", soft_wrap=True
            )
        force = np.array(function.force)[np.array(function.visited)]
        console.print(f"force per unit mass there: {force.min():.3g} to {force.max():.3g} m/s^2", soft_wrap=True)
    for text in result.undetermined:
        console.print(f"not determined beside the calibrated parameters: {text}", soft_wrap=True)
    if result.trials:
        console.print(_trials(result))
    console.print(f"{result.simulations} simulations in {result.seconds:.1f} s")
    names = ", ".join([DISCOVERY, *([FORCE_PICTURE] if result.functions else [])])
    console.print(f"files:  {escape(str(folder))}/ ({names})", soft_wrap=True)


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
