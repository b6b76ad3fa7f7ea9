"""Basins of attraction from the command line: the file and the picture."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np
import xarray as xr

from calib.cli.given import map_at, setting, spaced, state
from calib.cli.options import pool_table
from calib.dynamics.basins import Plane, basins
from calib.execution.progress import Count
from calib.report.plots.sections import basin_map
from calib.report.plots.style import DPI
from calib.study_file import load


def map_basins(
    study: Path,
    x: str,
    y: str,
    *,
    start: str | None,
    phase: float,
    settle: int,
    settings: Sequence[str],
    record: str | None,
    best: bool,
    jobs: int | None,
    pool: str | None,
    out: Path | None,
    output: Path | None,
    fresh: bool,
    quiet: bool,
) -> bool:
    """Find where the states of a plane lead, write file and picture, and say which motions there are.

    Returns
    -------
    whether some state leads to a motion
    """
    file = load(study, jobs=jobs, pool=pool_table(pool))
    held = setting(file, settings, record, best, out, phase)
    map = map_at("--set" if settings else str(file.path), held)
    units = dict(zip(map.names, map.units, strict=True))
    columns, rows = spaced("--x", x, units), spaced("--y", y, units)
    plane = Plane(held, columns, rows, state(start, units) if start else {}, settle)
    path = output or (out or file.folder) / "basins.nc"
    with Count("states", quiet) as count:
        motions = basins(plane, path, fresh=fresh, on_done=count, pool=file.study.evaluated_by)
    picture = path.with_suffix(".png")
    basin_map(motions).savefig(picture, dpi=DPI)
    if not quiet:
        for line in described(motions):
            click.echo(line)
        click.echo(f"basins: {path}\npicture: {picture}")
    return bool((motions.attractor >= 0).any())


def described(motions: xr.Dataset) -> Iterator[str]:
    """Say which motions there are, and to what share of the plane."""
    for k in range(motions.sizes.get("attractor", 0)):
        one = motions.isel(attractor=k)
        impacts = int(one.attractor_impacts)
        text = f", {impacts} impact(s) a return" if impacts > 0 else ""
        yield f"  {k}: {str(one.attractor_kind.values)}{text}: {100.0 * float(one.attractor_share):.1f} % of the states"
    failed = motions.attractor.values < 0
    if failed.any():
        statuses = ", ".join(np.unique(motions.status.values[failed]))
        yield f"  without a motion: {100.0 * failed.mean():.1f} % of the states ({statuses})"
