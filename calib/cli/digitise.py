"""Digitised figures from the command line: the list of curves, the record, its pictures and what was found."""

from collections.abc import Sequence
from pathlib import Path

import click
import xarray as xr

from calib.digitise import digitise
from calib.digitise.importers import read as read_export
from calib.digitise.reading import is_picture
from calib.digitise.spec import read_spec
from calib.errors import CalibError
from calib.records import is_response, read, write
from calib.records.response_table import has_frequencies
from calib.report.plots.digitised import overlay
from calib.report.plots.reference import reference_picture
from calib.report.record_description import record_description, record_warnings
from calib.study_file.mistakes import located, read_study
from calib.study_file.references import references
from calib.units import count
from calib.workflows.command_line import command_line

TABLES = (".csv", ".txt", ".dat", ".tsv", ".json", ".mat")  # suffixes of what [record.table] reads


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
        click.echo(f"  {curve.name}: {count(len(curve.points), 'point')}, {spans}")
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
    click.echo(f"what it holds: {command_line('reference', 'show', output)}")


def show_reference(path: Path, output: Path | None) -> None:
    """Draw a record, or every record of a study file as the study reads it, and say what it holds.

    Raises
    ------
    CalibError : a table, whose columns only a study file describes, or no readable record
    """
    if path.is_dir() or path.suffix.lower() == ".toml":
        file = located(path)
        for name, record in _records_of(file).items():
            click.echo(f"record {name!r}")
            _show(record, (output or file).with_name(f"{(output or file).stem}.{name}.png"))
        return
    if path.suffix.lower() in TABLES and not has_frequencies(path):
        raise CalibError(
            f"{path} is a table, and only a study file says what its columns are: write one with "
            f'`calib new study NAME`, put path = "{path.resolve()}" into its [[record]] and the columns into '
            "[record.table], then `calib reference show NAME/study.toml`"
        )
    _show(read(path), output or path.with_suffix(".png"))


def _records_of(path: Path) -> dict[str, xr.Dataset]:
    """Records of a study file by name, each with the excitation that the file states."""
    shape, mistakes = read_study(path)
    known = references(shape, None, mistakes)
    mistakes.tell()
    stated = {name: reference for name, reference in known.items() if reference is not None}
    return {
        name: reference.record.assign_attrs(
            {
                key: value
                for key in ("place", "quantity", "frequency", "amplitude")
                if (value := getattr(reference.excitation, key)) is not None
                and not (is_response(reference.record) and key in ("frequency", "amplitude"))
            }
        )
        for name, reference in stated.items()
    }


def _show(record: xr.Dataset, drawn: Path) -> None:
    for text in record_description(record):
        click.echo(text)
    for text in record_warnings(record):
        click.echo(f"warning: {text}")
    reference_picture(record, drawn)
    click.echo(f"picture: {drawn}")
