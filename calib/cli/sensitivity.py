"""`calib sensitivity`: what moves which feature of the motion, printed."""

import json
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.options import pool_table
from calib.cli.status import folder_of
from calib.execution.progress import Count
from calib.sweep.sensitivity import SensitivityResult
from calib.sweep.sensitivity.design import Method
from calib.sweep.sensitivity.document import FILE_NAME, OutputSensitivity
from calib.sweep.sensitivity.words import in_words, measure, moving, negligible, shares_in_words, title
from calib.units import count
from calib.workflows.sensitivity import SENSITIVITY_PICTURE, sensitivity_study


def print_sensitivity(
    study: Path,
    out: Path | None,
    method: Method,
    trajectories: int | None,
    samples: int | None,
    seed: int | None,
    jobs: int | None,
    pool: str | None,
    fresh: bool,
    quiet: bool,
    as_json: bool,
) -> bool:
    """Evaluate the points, and print what was found.

    Returns
    -------
    whether any simulation ended well
    """
    silent = quiet or as_json
    with Count("points", silent) as count:
        result = sensitivity_study(
            study, out, method=method, trajectories=trajectories, samples=samples, seed=seed, jobs=jobs,
            pool=pool_table(pool), fresh=fresh, on_point=count,
            on_note=lambda text: None if silent else click.echo(text, err=True),
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    elif not quiet:
        show(result, folder_of(study, out), Console(highlight=False))
    return any(not one.failed for one in result.shares)


def show(result: SensitivityResult, folder: Path, console: Console) -> None:
    """Print the shares of the motions, what moves each output, and where the files are."""
    console.print(f"motion over the box of {', '.join(map(escape, result.parameters))}:", soft_wrap=True)
    for line in shares_in_words(result):
        console.print(f"  {escape(line)}", soft_wrap=True)
    for failure in result.failures:
        reason = escape(failure.reason)
        console.print(f"  {failure.trials} of them ended as {failure.status}: {reason}", soft_wrap=True)
    table = Table(title="what moves the motion", title_justify="left", caption=measure(result), show_lines=True)
    table.add_column("of the measured kind" if len(result.shares) > 1 else "of the motion", ratio=3)
    table.add_column("moved by, the strongest first", ratio=6)
    table.add_column("hardly by", ratio=2)
    table.add_column("points", justify="right")
    for output in result.outputs:
        table.add_row(escape(title(output, len(result.measured_kind))), *map(escape, _row(output)))
    console.print(table)
    for remark in result.remarks:
        console.print(escape(remark), soft_wrap=True)
    console.print(count(result.simulations, "simulation"))
    console.print(f"files:  {escape(str(folder))}/ ({FILE_NAME}, {SENSITIVITY_PICTURE})", soft_wrap=True)


def _row(output: OutputSensitivity) -> tuple[str, str, str]:
    if not output.influences:
        return output.reason, "", str(output.points)
    lines = [in_words(one, output) for one in moving(output)]
    lines += [f"{one.parameter}: {one.reason}" for one in output.influences if one.reason]
    return "\n".join(lines), ", ".join(negligible(output)), str(output.points)
