"""Projects of WebPlotDigitizer: JSON of versions 3 and 4, alone or in a .tar."""

import io
import tarfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calib.digitise.axes import AxisCalibration, calibrated
from calib.digitise.curve import Curve
from calib.digitise.importers.content import MAX_CONTENT_BYTES, content, parsed
from calib.digitise.importers.imported import CLICK_SIGMA, Imported, clicked
from calib.errors import CalibError

MAX_MEMBERS = 1000  # of an archive, at most
KINDS = {
    "BarAxes": "a bar chart, whose points carry one number each",
    "PolarAxes": "on polar axes",
    "TernaryAxes": "on ternary axes",
    "MapAxes": "on a map",
    "ImageAxes": "on an image without axes, in pixels",
    "CircularChartRecorderAxes": "on a circular chart",
}
MAX_MISMATCH = 1e-3  # of stored numbers with the stored calibration, over the extent of the curve


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class _Point(_Part):
    px: float = Field(allow_inf_nan=False)
    py: float = Field(allow_inf_nan=False)
    dx: float | str | None = None
    dy: float | str | None = None


class _Axes(_Part):
    name: str
    type: str
    logarithmic_x: bool = Field(default=False, alias="isLogX")
    logarithmic_y: bool = Field(default=False, alias="isLogY")
    points: list[_Point] = Field(default=[], alias="calibrationPoints")


class _Datum(_Part):
    x: float = Field(allow_inf_nan=False)
    y: float = Field(allow_inf_nan=False)
    value: list[Any] = []


class _Dataset(_Part):
    name: str
    axes: str = Field(alias="axesName")
    data: list[_Datum]


class _Project(_Part):
    axes: list[_Axes] = Field(alias="axesColl")
    datasets: list[_Dataset] = Field(alias="datasetColl")


class _OldSettings(_Part):
    logarithmic_x: bool = Field(default=False, alias="isLogX")
    logarithmic_y: bool = Field(default=False, alias="isLogY")


class _OldSeries(_Part):
    name: str
    data: list[_Datum]


class _Old(_Part):
    type: str = Field(alias="axesType")
    settings: _OldSettings = Field(default=_OldSettings(), alias="axesParameters")
    points: list[_Point] = Field(default=[], alias="calibration")
    series: list[_OldSeries] = Field(alias="dataSeries")


class _Info(_Part):
    json_: str = Field(alias="json")


def read_json(path: Path) -> Imported:
    """Read a project of version 3 or 4.

    Raises
    ------
    CalibError : no JSON, or no project
    """
    return _project(path, parsed(path, content(path)))


def read_tar(path: Path) -> Imported:
    """Read a project archive; nothing is written, and nothing but its info.json and the project it names is read.

    Raises
    ------
    CalibError : no plain archive, too large, or no project in it
    """
    raw = content(path)
    try:
        with tarfile.open(fileobj=io.BytesIO(raw), mode="r:") as archive:
            members = _members(path, archive)
            where = next((name for name in members if name.rpartition("/")[2] == "info.json"), None)
            if where is None:
                listed = ", ".join(sorted(members)[:5]) or "no file"
                raise CalibError(f"{path}: not a WebPlotDigitizer project: it has no info.json (it holds {listed})")
            info = _shaped(path, _Info, parsed(path / where, _member(path, archive, members[where])))
            wanted = f"{where.rpartition('/')[0]}/{info.json_}".lstrip("/")
            if wanted not in members:
                raise CalibError(f"{path}: its info.json names {info.json_!r}, which is not in the archive")
            project = parsed(path / wanted, _member(path, archive, members[wanted]))
    except (tarfile.TarError, OSError, ValueError, OverflowError, MemoryError) as error:
        raise CalibError(f"{path}: not a readable plain .tar ({error}); unpack it if it is compressed") from error
    return _project(path, project)


def _members(path: Path, archive: tarfile.TarFile) -> dict[str, tarfile.TarInfo]:
    """Plain files of an archive by name."""
    members = {}
    for number, member in enumerate(archive):
        if number >= MAX_MEMBERS:
            raise CalibError(f"{path}: more than {MAX_MEMBERS} members; expected the few of a WebPlotDigitizer project")
        if member.isreg():
            members[member.name.removeprefix("./")] = member
    return members


def _member(path: Path, archive: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    if member.size > MAX_CONTENT_BYTES:
        raise CalibError(
            f"{path}: its member {member.name!r} is larger than the {MAX_CONTENT_BYTES} bytes that are read"
        )
    file = archive.extractfile(member)
    if file is None:
        raise CalibError(f"{path}: its member {member.name!r} is no file; save the project again")
    with file:
        return file.read(MAX_CONTENT_BYTES + 1)


Shape = TypeVar("Shape", bound=_Part)


def _shaped(path: Path, model: type[Shape], document: Any) -> Shape:
    """Return a part of a project's JSON `document` where it has the shape of `model`."""
    try:
        return model.model_validate(document)
    except ValidationError as invalid:
        first = invalid.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the file"
        raise CalibError(
            f"{path}: not a WebPlotDigitizer project as versions 3 and 4 write it: {key}: {first['msg']}; "
            "open it in WebPlotDigitizer and save it again"
        ) from invalid


def _project(path: Path, document: Any) -> Imported:
    if isinstance(document, dict) and "wpd" in document:
        old = _shaped(path, _Old, document["wpd"])
        axes = _Axes(
            name="the axes",
            type=old.type,
            isLogX=old.settings.logarithmic_x,
            isLogY=old.settings.logarithmic_y,
            calibrationPoints=old.points,
        )
        datasets = [_Dataset(name=s.name, axesName=axes.name, data=s.data) for s in old.series]
        return _read(path, "WebPlotDigitizer project, version 3", [axes], datasets)
    if isinstance(document, dict) and "axesColl" not in document and "json" in document:
        beside = str(document["json"])[:40]
        raise CalibError(f"{path}: the index of a project, not the project; give {beside!r} beside it")
    project = _shaped(path, _Project, document)
    return _read(path, "WebPlotDigitizer project, version 4", project.axes, project.datasets)


def _read(path: Path, form: str, axes: Sequence[_Axes], datasets: Sequence[_Dataset]) -> Imported:
    known = {a.name: a for a in axes}
    curves, refused = list[Curve](), dict[str, str]()
    for number, dataset in enumerate(datasets, 1):
        name = dataset.name
        if name in refused or name in {curve.name for curve in curves}:
            name = f"{name} ({number})"
        try:
            if dataset.axes not in known:
                raise CalibError(f"its axes {dataset.axes!r} are not in the project")
            curves.append(_curve(name, known[dataset.axes], dataset.data))
        except CalibError as error:
            refused[name] = str(error)
    return Imported(path, form, curves, refused)


def _curve(name: str, axes: _Axes, data: Sequence[_Datum]) -> Curve:
    if axes.type != "XYAxes":
        raise CalibError(f"it is {KINDS.get(axes.type, f'on axes of type {axes.type!r}')}; expected a plot of y over x")
    if len(data) < 2:
        raise CalibError(f"it has {len(data)} point(s); expected two at least")
    calibration = _calibration(axes)
    pixels = np.array([[datum.x, datum.y] for datum in data])
    own = calibration(pixels)
    points = np.array([_value(datum, row) for datum, row in zip(data, own, strict=True)])
    notes = []
    plain = np.log10 if any(calibration.logarithmic) else np.asarray
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(points - own).max(axis=0) / np.maximum(np.ptp(plain(np.abs(own)), axis=0), 1e-300)
    if not any(calibration.logarithmic) and (off > MAX_MISMATCH).any():
        notes.append("its numbers are not those that the axes stored with them give: calibrated again since then?")
    return clicked(name, points, pixels, calibration, notes)


def _value(datum: _Datum, own: np.ndarray) -> list[float]:
    """Numbers of a point: those the project holds, else those of its pixel."""
    if not datum.value:
        return own.tolist()
    if len(datum.value) != 2 or not all(isinstance(v, int | float) and abs(v) < 1e300 for v in datum.value):
        raise CalibError(f"a point holds {str(datum.value)[:60]} where two numbers are expected")
    return [float(v) for v in datum.value]


def _calibration(axes: _Axes) -> AxisCalibration:
    """WebPlotDigitizer takes x from its first two axis points and y from the other two."""
    if len(axes.points) != 4:
        number = len(axes.points)
        raise CalibError(f"its axes {axes.name!r} have {number} calibration points; expected 4: X1, X2, Y1, Y2")
    x = [_number(p.dx, axes.name, "x") for p in axes.points[:2]] + [None, None]
    y = [None, None] + [_number(p.dy, axes.name, "y") for p in axes.points[2:]]
    pixels = [(p.px, p.py) for p in axes.points]
    try:
        return calibrated(pixels, x, y, (axes.logarithmic_x, axes.logarithmic_y), CLICK_SIGMA)
    except CalibError as error:
        raise CalibError(f"axes {axes.name!r}: {error}") from error


def _number(text: float | str | None, axes: str, name: str) -> float:
    try:
        number = None if text is None else float(text)
    except ValueError:
        number = None
    if number is not None and abs(number) < 1e300:
        return number
    date = isinstance(text, str) and any(mark in text for mark in ":/")
    what = "carries dates or times of day" if date else "is calibrated by something that is no number"
    raise CalibError(f"{name} of its axes {axes!r} {what} ({str(text)[:40]!r}); calibrate that axis in seconds")
