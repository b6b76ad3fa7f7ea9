"""`calib rehearse` from the command line: the cases, the picture, and the table."""

import math
from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.options import pool_table
from calib.diagnosis.rehearse import NOTHING, RehearsalRates, Rehearsed, rates, smallest
from calib.errors import CalibError
from calib.execution.progress import Count
from calib.report.formatting import quantity
from calib.report.plots.rehearsal import rehearsal
from calib.report.plots.style import DPI
from calib.study_file import load
from calib.workflows.rehearse import PICTURE, REHEARSAL, rehearse_study


def print_rehearsal(
    study: Path,
    out: Path | None,
    seeds: int,
    strengths: str,
    jobs: int | None,
    pool: str | None,
    fresh: bool,
    quiet: bool,
) -> None:
    """Play the cases, write the picture, and print what the experiment could show."""
    try:
        sizes = [float(text) for text in strengths.split(",")]
    except ValueError:
        raise CalibError(f"--strengths takes numbers with commas between, such as 5,10,20; got {strengths!r}") from None
    folder = out or load(study).folder
    with Count("cases", quiet) as count:
        played = rehearse_study(
            study, out, seeds=seeds, strengths=sizes, jobs=jobs, fresh=fresh, on_case=count, pool=pool_table(pool)
        )
    picture = folder / PICTURE
    rehearsal(played).savefig(picture, dpi=DPI)
    if not quiet:
        show(played, Console(highlight=False))
        click.echo(f"cases:   {folder / REHEARSAL}\npicture: {picture}")


def show(played: Sequence[Rehearsed], console: Console) -> None:
    """Print detection, naming and coverage by effect, and the smallest size that is reliably named."""
    least = smallest(played)
    groups: dict[str, list[RehearsalRates]] = {}
    for row in rates(played):
        groups.setdefault(row.hidden.effect, []).append(row)
    table = Table(title="rehearsal", title_justify="left")
    table.add_column("hidden", no_wrap=True, min_width=20)
    for heading in ("cases", "detected", "named", "in the class", "reliably named from"):
        table.add_column(heading, justify="right")
    for effect, rows in groups.items():
        cases = sum(row.cases for row in rows)
        detected = sum(row.detected * row.cases for row in rows) / cases
        named = sum(row.named * row.cases for row in rows) / cases
        covered = sum(row.covered * row.cases for row in rows) / cases
        right = [f"{share:.0%}" for share in (detected, named, covered)]
        if effect == NOTHING:
            right[1:] = ["-", "-"]
        table.add_row(escape(effect), str(cases), *right, _from(least.get(effect)))
    console.print(table)
    failed = [one for one in played if one.verdict == "failed"]
    if failed:
        console.print(f"{len(failed)} cases failed, such as {escape(failed[0].case.key)}: {escape(failed[0].reason)}")


def _from(row: RehearsalRates | None) -> str:
    if row is None:
        return "-"
    name, value = next((n, v) for n, v in row.hidden.values.items() if v)
    strength = row.hidden.strength
    z = "" if math.isnan(strength) else f" (z = {strength:g})"
    return f"{name} = {quantity(value, row.hidden.units.get(name))}{z}"
