"""Digitised figures from the command line: the list of curves, the record, its pictures and what was found."""

from collections.abc import Sequence
from pathlib import Path

import click

from calib.digitise import digitise
from calib.digitise.importers import read as read_export
from calib.digitise.reading import is_picture
from calib.digitise.spec import read_spec
from calib.errors import CalibError
from calib.records import read, write
from calib.report.plots.digitised import overlay
from calib.report.plots.reference import reference_picture
from calib.report.record_description import record_description, record_warnings


def list_curves(path: Path, spec: Path | None) -> None:
    """Name the curves of a file, and those that cannot be read with the reason."""
    if is_picture(path):
        if spec is None:
            raise CalibError(f"{path}: a picture names no curves; --list shows those of its description, --spec")
        shape, _ = read_spec(spec)
        for table in shape.curve:
            click.echo(f"{table.body}: {table.kind}, {table.colour}, panel {table.panel or shape.panel[0].name}")
        return
    export = read_export(path)
    click.echo(f"{path}: {export.form}")
    for curve in export.curves:
        (left, low), (right, high) = curve.points.min(axis=0), curve.points.max(axis=0)
        spans = f"x {left:.6g} .. {right:.6g}, y {low:.6g} .. {high:.6g}"
        click.echo(f"  {curve.name}: {len(curve.points)} points, {spans}")
        for note in curve.notes:
            click.echo(f"    note: {note}")
    for name, reason in export.refused.items():
        click.echo(f"  {name}: not read: {reason}")


def digitise_figure(path: Path, spec: Path | None, output: Path, bodies: Sequence[str]) -> None:
    """Make a record, write it with the pictures to check it by, and say what was found."""
    digitised = digitise(path, spec, bodies or None)
    if output.parent != Path():
        output.parent.mkdir(parents=True, exist_ok=True)
    write(digitised.record, output)
    click.echo(f"record: {output}")
    for note in digitised.findings.notes:
        click.echo(f"  {note}")
    for warning in digitised.findings.warnings:
        click.echo(f"  warning: {warning}")
    if digitised.figure.light is not None:
        drawn = output.with_name(f"{output.stem}.overlay.png")
        overlay(digitised.figure, drawn)
        click.echo(f"overlay: {drawn}  (look at it: do the lines lie on the curves?)")
    click.echo(f"what it holds: calib reference show {output}")


def show_reference(path: Path, output: Path | None) -> None:
    """Draw a record and say what it holds."""
    record = read(path)
    drawn = output or path.with_suffix(".png")
    for text in record_description(record):
        click.echo(text)
    for text in record_warnings(record):
        click.echo(f"warning: {text}")
    reference_picture(record, drawn)
    click.echo(f"picture: {drawn}")
