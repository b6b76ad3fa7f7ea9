"""`calib window`: where the model behaves as was measured, printed."""

import json
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.options import pool_table
from calib.cli.status import folder_of
from calib.confidence.window.artifacts import WINDOW_DATA
from calib.confidence.window.document import WINDOW_FILE, WindowResult
from calib.confidence.window.words import (
    admissible_in_words,
    alone,
    bounds,
    exact_in_words,
    mechanisms_in_words,
    percent,
    share_in_words,
    together,
)
from calib.errors import CalibError
from calib.execution.progress import Count
from calib.units import count
from calib.workflows.window import ALL_TERMS, WINDOW_PICTURE, window_study


def print_window(
    study: Path,
    out: Path | None,
    budget: int,
    tolerance: tuple[str, ...],
    seed: int | None,
    jobs: int | None,
    pool: str | None,
    fresh: bool,
    exact: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Evaluate the points, and print where the window is."""
    silent = quiet or as_json
    with Count("points", silent) as count, Count("slices continued", silent) as slices:
        result = window_study(
            study, out, budget=budget, tolerance=dict(map(tolerance_of, tolerance)), seed=seed, jobs=jobs,
            pool=pool_table(pool), fresh=fresh, exact=exact, on_point=count, on_slice=slices,
            on_note=lambda text: None if silent else click.echo(text, err=True),
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    elif not quiet:
        show(result, folder_of(study, out), Console(highlight=False))


def tolerance_of(text: str) -> tuple[str, float]:
    """Read TERM=VALUE or VALUE of an option.

    Raises
    ------
    CalibError : no number
    """
    label, _, value = text.rpartition("=")
    try:
        return label.strip() or ALL_TERMS, float(value)
    except ValueError:
        raise CalibError(f"--tolerance: expected a distance such as 0.05, or TERM=0.05, got {text!r}") from None


def show(result: WindowResult, folder: Path, console: Console) -> None:
    """Print the share of the box, what bounds the window, what each parameter may vary, and where the files are."""
    console.print(f"{escape(share_in_words(result))} over {', '.join(map(escape, result.windows))}", soft_wrap=True)
    console.print(f"admissible: {escape(admissible_in_words(result))}", soft_wrap=True)
    console.print(
        f"bounded by {escape(mechanisms_in_words(result.mechanisms, most=len(result.mechanisms)))}", soft_wrap=True
    )
    table = Table(title="what each parameter may vary", title_justify="left", show_lines=True)
    table.add_column("parameter")
    for heading in ("if all others stay", "together (largest box)", "what bounds the window"):
        table.add_column(heading)
    for own in result.parameters:
        table.add_row(*map(escape, (own.name, alone(own), together(own), bounds(own))))
    console.print(table)
    if result.box_share is not None:
        text = f"the largest box inside has {percent(result.box_share)} of the window's volume"
        if result.ellipsoid is not None:
            text += f", the largest ellipsoid {percent(result.ellipsoid.share)}"
        console.print(text, soft_wrap=True)
    for line in map(exact_in_words, result.exact):
        console.print(escape(line), soft_wrap=True)
    for failure in result.failures:
        ended = f"{count(failure.trials, 'point')} ended as {failure.status}"
        console.print(f"{ended}: {escape(failure.reason)}", soft_wrap=True)
    for remark in result.remarks:
        console.print(f"[yellow]mind:[/] {escape(remark)}", soft_wrap=True)
    effort = f"{count(result.points, 'point')}, {count(result.simulations, 'simulation')}"
    console.print(f"{effort}, {result.seconds:.1f} s")
    files = f"({WINDOW_FILE}, {WINDOW_DATA}, {WINDOW_PICTURE}, report.html)"
    console.print(f"files:  {escape(str(folder))}/ {files}", soft_wrap=True)
