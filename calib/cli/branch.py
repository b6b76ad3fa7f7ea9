"""A branch of periodic motions from the command line: its file, its pictures and its special points."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from calib.cli.curves import follow_and_draw, plane_of
from calib.cli.given import bodies_drawn, map_at, quantity, setting, spare_other_files, state, windows
from calib.dynamics.branch import Branch, follow
from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.netcdf import write_dataset
from calib.report.plots.continuation import branch_diagram
from calib.report.plots.style import DPI
from calib.study_file import load
from calib.units import count, shown


def follow_branch(
    study: Path,
    over: str,
    *,
    at: str,
    start: str | None,
    phase: float,
    most: int,
    curve: str | None,
    settings: Sequence[str],
    record: str | None,
    best: bool,
    bodies: str | None,
    out: Path | None,
    output: Path | None,
) -> bool:
    """Settle to a periodic motion, follow it over one parameter, write file and pictures, and say what is on it.

    Returns
    -------
    whether there is a branch
    """
    file = load(study)
    held = setting(file, settings, record, best, out, phase)
    [(name, window)] = windows([over], held).items()
    if window.scale == "log":
        raise CalibError('--over: a branch is followed on a linear scale; drop ":log"')
    unit, drawn = held.unit(name), bodies_drawn(bodies, file, record)
    path = output or (out or file.folder) / "branch.nc"
    spare_other_files(path, "special_kind", "calib branch")
    where = quantity("--at", at, unit)
    if not window.low <= where <= window.high:
        low, high = shown(window.low, unit), shown(window.high, unit)
        raise CalibError(f"--at: expected {name} in the window of --over, {low} .. {high}, got {at}")
    for end in (window.low, window.high):
        map_at(f"--over: {name} = {shown(end, unit)}", held, {name: end})
    curves_path = path.with_name(f"{path.stem}_curves.nc")
    second, plane = plane_of(held, name, window, curve, curves_path) if curve else ("", None)
    periods, guess = _settled(held, name, where, start)
    branch = follow(lambda value: held.map({name: value}), guess, where, (window.low, window.high), periods, most)
    for line in described(branch, name, unit):
        click.echo(line)
    if not branch.parameter.size:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    dataset = branch.dataset(name, unit).assign_attrs(model=held.model.name, phase=phase)
    write_dataset(dataset, path)
    click.echo(f"branch: {path}")
    for body in drawn:
        picture = path.with_name(f"{path.stem}_{body}.png")
        branch_diagram([dataset], body).savefig(picture, dpi=DPI)
        click.echo(f"picture: {picture}")
    if plane is not None:
        follow_and_draw(held, branch, plane, (name, second), most, curves_path)
    elif curves_path.exists():
        click.echo(f"{curves_path} is of an earlier branch; delete it, or follow the curves of this one with --curve")
    return True


def _settled(held: Setting, name: str, where: float, start: str | None) -> tuple[int, np.ndarray]:
    """Period of the motion at one value of the parameter, and a state of it."""
    place = f"{name} = {shown(where, held.unit(name))}"
    map = map_at(f"--at: {place}", held, {name: where})
    given = state(start, dict(zip(map.names, map.units, strict=True))) if start else {}
    begin = np.array([given.get(n, own) for n, own in zip(map.names, map.initial, strict=True)], dtype=float)
    orbit = kind_of_orbit(map, begin)
    if not orbit.period:
        raise CalibError(f"the motion at {place} is {orbit.kind} ({orbit.evidence}): choose another --at or --start")
    click.echo(f"at {place}: {orbit.kind}, {orbit.evidence}")
    return orbit.period, orbit.state


def described(branch: Branch, name: str, unit: str) -> Iterator[str]:
    """Say how far a branch reaches, what is on it, and why it ends."""
    if branch.parameter.size:
        low, high = shown(branch.parameter.min(), unit, 7), shown(branch.parameter.max(), unit, 7)
        yield f"period-{branch.periods} over {name} {low} .. {high}, {count(branch.parameter.size, 'point')}"
    for point in branch.points:
        yield f"  {point.kind} at {name} = {shown(point.parameter, unit, 8)}: {point.evidence}"
    for end, reason in zip(("one end", "other end"), branch.ends, strict=True):
        yield f"  {end}: {reason}"
