"""Curves of folds, flips and grazings from the command line: their file, their picture and the table."""

from collections.abc import Sequence
from pathlib import Path

import click

from calib.cli.given import map_at, spare_other_files, windows
from calib.cli.tables import show_curves
from calib.dynamics.branch import Branch
from calib.dynamics.curve_dataset import curves_dataset
from calib.dynamics.curves import BifurcationCurve, follow_curves
from calib.dynamics.defining import ParameterPlane
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.netcdf import read_dataset, write_dataset
from calib.execution.progress import Count
from calib.modelling.parameter import Window
from calib.report.plots.curves import curve_map
from calib.report.plots.style import DPI
from calib.units import shown


def plane_of(held: Setting, name: str, window: Window, curve: str, path: Path) -> tuple[str, ParameterPlane]:
    """Read --curve into the name of the second parameter, and the plane of both.

    Raises
    ------
    CalibError : it is the first one, has a logarithmic window or one without the value of the study, or nothing could
        move at a corner of the plane; or a file of something else is at `path`
    """
    [(second, own)] = windows([curve], held, "--curve").items()
    if second == name:
        raise CalibError(f"--curve: {name} is that of --over; choose another parameter")
    if own.scale == "log":
        raise CalibError('--curve: a curve is followed on a linear scale; drop ":log"')
    value, unit = held.value(second), held.unit(second)
    if not own.low <= value <= own.high:
        low, high = shown(own.low, unit), shown(own.high, unit)
        raise CalibError(
            f"--curve: {second} = {shown(value, unit)} of the study, where the branch is, is outside {low} .. {high}; "
            f"widen the window, or choose another value with --set {second}=VALUE"
        )
    for a in (window.low, window.high):
        for b in (own.low, own.high):
            map_at(
                f"--curve: {name} = {shown(a, held.unit(name))}, {second} = {shown(b, unit)}",
                held,
                {name: a, second: b},
            )
    spare_other_files(path, "curve_kind", "calib branch --curve")
    return second, ParameterPlane(
        lambda a, b: held.map({name: a, second: b}), (window.low, window.high), (own.low, own.high)
    )


def follow_and_draw(
    held: Setting, branch: Branch, plane: ParameterPlane, names: tuple[str, str], most: int, path: Path
) -> None:
    """Follow the special points of a branch over a plane, write file and picture, and say what was found.

    The file is written after each curve: what was found before a kill is kept.
    """
    units = held.unit(names[0]), held.unit(names[1])

    def write(made: Sequence[BifurcationCurve]) -> None:
        dataset = curves_dataset(made, plane, names, units)
        write_dataset(dataset.assign_attrs(model=held.model.name, phase=held.phase), path)

    with Count("special points continued") as count:

        def kept(made: Sequence[BifurcationCurve], done: int, total: int) -> None:
            write(made)
            count(done, total)

        curves = follow_curves(branch, plane, held.value(names[1]), most, kept)
    if not curves:
        click.echo("curves: none, as there is no fold, flip or grazing on the branch")
        return
    show_curves(curves, names, units)
    click.echo(f"curves: {path}")
    picture = path.with_suffix(".png")
    curve_map(read_dataset(path), _place(held, names, plane)).savefig(picture, dpi=DPI)
    click.echo(f"picture: {picture}")


def _place(held: Setting, names: tuple[str, str], plane: ParameterPlane) -> tuple[float, float] | None:
    """Values of both parameters in the study, where they are in the plane."""
    a, b = held.value(names[0]), held.value(names[1])
    return (a, b) if plane.a[0] <= a <= plane.a[1] and plane.b[0] <= b <= plane.b[1] else None
