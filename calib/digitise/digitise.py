"""From a file and the description of its figure to a record."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from calib.digitise.assembly import Findings, assembled
from calib.digitise.importers import read as read_export
from calib.digitise.reading import Figure, is_picture, read_figure
from calib.digitise.spec import FigureToml, read_spec
from calib.errors import CalibError
from calib.execution.files import checksum
from calib.records import check
from calib.study_file.mistakes import Mistakes, read_as


@dataclass(frozen=True, eq=False)
class Digitised:
    """A record made of a figure, and how.

    Attributes
    ----------
    record : the record
    findings : notes and warnings
    figure : what was read off
    """

    record: xr.Dataset
    findings: Findings
    figure: Figure


def digitise(path: str | Path, spec: str | Path | None = None, bodies: Sequence[str] | None = None) -> Digitised:
    """Make a record of a figure's picture, of another tool's export, or of a table that describes itself.

    Parameters
    ----------
    path : picture, project, or table
    spec : the figure's description (.toml); None where the table begins with one, in comments
    bodies : that are wanted, None for all

    Raises
    ------
    CalibError : whatever keeps the figure from becoming a record, with file, line and key
    """
    path = Path(path)
    shape, mistakes = read_spec(Path(spec)) if spec is not None else _own_spec(path)
    figure = read_figure(path, shape, mistakes, bodies)
    try:
        record, findings = assembled(figure.readings, shape)
    except CalibError as error:
        raise CalibError(f"{path}: {error}") from error
    record.attrs |= {
        "source": f"{shape.source}; digitised from {path.name} ({figure.form}), sha256 {checksum(path)}",
        "digitised": "; ".join(findings.notes),
    }
    if findings.warnings:
        record.attrs["warning"] = "; ".join(findings.warnings)
    return Digitised(check(record, str(path)), findings, figure)


def _own_spec(path: Path) -> tuple[FigureToml, Mistakes]:
    """Return the description at the head of a table."""
    if is_picture(path):
        raise CalibError(f"{path}: a picture needs a description of its axes and curves; give it with --spec")
    export = read_export(path)
    if not export.header:
        raise CalibError(
            f"{path}: its numbers are not described; give a description with --spec, "
            "or begin a table with one in comments (# source = ...)"
        )
    return read_as(FigureToml, path, export.header)
