"""A sweep from the command line: its file, its pictures, and what it found in a few lines."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from calib.cli.given import bodies_drawn, grid, setting, state, windows
from calib.cli.options import pool_table
from calib.dynamics.orbit_kind import FAILED
from calib.errors import CalibError
from calib.execution.progress import Count
from calib.report.plots.bifurcation import bifurcation_diagram, impact_diagram
from calib.report.plots.maps import kind_map
from calib.report.plots.sections import sections
from calib.report.plots.style import DPI
from calib.report.plots.sweeps import parameters
from calib.study_file import load
from calib.sweep import NONE, Sweep, latin_hypercube, run
from calib.sweep.plan import Carry
from calib.units import shown

MAX_PRINTED_STRETCHES = 24  # stretches that are printed


def sweep_study(
    study: Path,
    over: Sequence[str],
    *,
    latin: int | None,
    seed: int,
    carry: Carry,
    starts: Sequence[str],
    phase: float,
    settle: int,
    cycles: int,
    settings: Sequence[str],
    record: str | None,
    best: bool,
    bodies: str | None,
    jobs: int | None,
    pool: str | None,
    out: Path | None,
    output: Path | None,
    fresh: bool,
    quiet: bool,
) -> bool:
    """Sweep a study's simulator, write the file and its pictures, and print what was found.

    Returns
    -------
    whether some motion was found at all
    """
    file = load(study, jobs=jobs, pool=pool_table(pool))
    held = setting(file, settings, record, best, out, phase)
    if len(over) > 2:
        raise CalibError(f"--over: a sweep is over one or two parameters, got {len(over)}")
    if latin is not None and carry != NONE:
        raise CalibError(f"--carry {carry}: a state is carried along a grid; the points of --latin have no order")
    axes = grid(over, held) if latin is None else latin_hypercube(windows(over, held), latin, seed)
    plan = Sweep(held, axes, paired=latin is not None, carry=carry, settle=settle, cycles=cycles)
    if starts:
        plan = replace(plan, starts=[state(text, plan.components()) for text in starts])
    path = output or (out or file.folder) / "sweep.nc"
    drawn = bodies_drawn(bodies, file, record)
    with Count("points", quiet) as count:
        motions = run(plan, path, fresh=fresh, on_done=count, pool=file.study.evaluated_by)
    if not quiet:
        for line in described(motions):
            click.echo(line)
        click.echo(f"sweep: {path}")
    for picture, figure in pictures(motions, drawn):
        name = path.with_name(f"{path.stem}{picture}.png")
        figure.savefig(name, dpi=DPI)
        if not quiet:
            click.echo(f"picture: {name}")
    return bool((motions.kind != FAILED).any())


def pictures(motions: xr.Dataset, bodies: Sequence[str]) -> Iterator[tuple[str, Figure]]:
    """Yield the pictures of a sweep with what is added to the file's name: those that show something of it."""
    if len(parameters(motions)) > 1:
        yield "", kind_map(motions)
        return
    yield "", sections(motions.sel(body=list(bodies))) or bifurcation_diagram(motions, bodies)
    impacts = impact_diagram(motions)
    if impacts is not None:
        yield "_impacts", impacts


def described(motions: xr.Dataset) -> Iterator[str]:
    """Say of each branch over which stretch of the parameter which motion was found; of a plane, how often."""
    failed = int((motions.kind == FAILED).sum())
    for name in motions.branch.values if "branch" in motions.dims else [""]:
        branch = motions.sel(branch=name) if name else motions
        yield f"{name}:" if name else "found:"
        lines = list(_stretches(branch) if len(parameters(motions)) == 1 else _counted(branch))
        yield from lines[:MAX_PRINTED_STRETCHES]
        if len(lines) > MAX_PRINTED_STRETCHES:
            yield f"  ... and {len(lines) - MAX_PRINTED_STRETCHES} more"
    if failed:
        reasons = np.unique(motions.status.values[motions.kind.values == FAILED])
        yield f"failed: {failed} of {motions.kind.size} ({', '.join(reasons)})"


def _label(branch: xr.Dataset, at: int) -> str:
    """What was found at one value: kind and impacts, what lies beside it, and whether rounding could change it."""
    kind, impacts = str(branch.kind.values[at]), int(branch.impacts.values[at])
    text = f"{kind}, {impacts} impact(s) a return" if kind.startswith("period-") and impacts > 0 else kind
    beside = sorted({str(other) for other in branch.other_kind.values[:, at] if other})
    text += f"; beside it {' and '.join(beside)}" if beside else ""
    return text if branch.certain.values[at] else f"{text} (uncertain: another rounding may lead to another kind)"


def _stretches(branch: xr.Dataset) -> Iterator[str]:
    [name] = parameters(branch)
    values, unit, label = branch[name].values, branch[name].attrs["units"], branch[name].attrs["name"]
    order = np.argsort(values)
    labels = [_label(branch, k) for k in order]
    first = 0
    for k in range(1, len(labels) + 1):
        if k == len(labels) or labels[k] != labels[first]:
            low, high = (shown(float(values[order[at]]), unit) for at in (first, k - 1))
            yield f"  {label} {low if low == high else f'{low} .. {high}'}: {labels[first]}"
            first = k


def _counted(branch: xr.Dataset) -> Iterator[str]:
    kinds, counts = np.unique(branch.kind.values, return_counts=True)
    for kind, count in sorted(zip(kinds, counts, strict=True), key=lambda pair: -pair[1]):
        yield f"  {kind}: {count} of {branch.kind.size}"
    doubtful = int((~branch.certain.values).sum())
    if doubtful:
        yield f"  uncertain, as another rounding may lead to another kind: {doubtful} of {branch.kind.size}"
