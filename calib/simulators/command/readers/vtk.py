"""The reader of series of VTK files."""

import io
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from calib.errors import CalibError
from calib.execution.apart import read_apart
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.histories import Histories, Names, refuse_missing
from calib.simulators.command.readers.lines import MAX_TEXT_BYTES, check_size
from calib.simulators.command.readers.rows import Count, Step
from calib.simulators.command.readers.series import REAL
from calib.simulators.command.readers.vtk_files import series_files

OUTSIDE_SHARE = 0.01  # of the diagonal of the mesh, by which a stated place may lie outside of its box
Place = Annotated[Sequence[float], Field(min_length=2, max_length=3)]
Points = Annotated[Mapping[str, Count | Place], Field(min_length=1)]


def read(path: Path, /, *, points: Points, step: Step | None = None, columns: Names | None = None) -> Columns:
    """Series of VTK files: a .pvd, or the first of numbered .vtu or .vtk files; needs ``calib[vtk]``.

    A column is called by the name that `points` gives to the point and the array of point data, ``"tip.pressure"``,
    with the component of a vector, counted from 1: ``"tip.displacement[3]"``.

    Parameters
    ----------
    points : name of each point that is read -> its number, which VTK counts from 0, or a place [x, y, z] in the file's
        unit of length, for which the nearest point of the first file is taken
    step : time between the numbers in the names of numbered files, in the unit of time; a .pvd states its times
    columns : names of those that are read; without it all

    Raises
    ------
    CalibError : no such file, one that is cut off or lies elsewhere, no such point, a place outside of the mesh, a mesh
        whose number of points changes, too large a file
    """
    files = series_files(path, step)
    _meshio(path)  # imported here: what a forked process imports is lost
    try:
        return read_apart(partial(_columns, path, files, points, columns), *(file for _, file in files))
    except OSError as error:
        raise CalibError(f"{path}: not a readable series ({error}); write fewer points or fewer steps") from error


def _columns(path: Path, files: Sequence[tuple[float, Path]], points: Points, columns: Names | None) -> Columns:
    histories = Histories(path)
    names: dict[str, None] = {}
    numbers: dict[str, int] = {}
    size = None
    for time, file in files:
        places, data = _mesh(file)
        if size is None:
            size = len(places)
            numbers = {name: _number(file, name, point, places) for name, point in points.items()}
        if len(places) != size:
            raise CalibError(f"{file}: expected the {size} points of the first file, got {len(places)}")
        for name, value in _values(numbers, data):
            names[name] = None
            if columns is None or name in columns:
                histories.add(name, time, value, 1)
    refuse_missing(path, columns or (), names, "point data")
    return histories.as_columns({name: name for name in columns or names})


def _mesh(path: Path) -> tuple[np.ndarray, Mapping[str, np.ndarray]]:
    """Return the places (point, axis) and the point data (point, ...) of one file."""
    check_size(path, MAX_TEXT_BYTES)
    meshio = _meshio(path)
    read_mesh: Any = meshio.vtu.read if path.suffix == ".vtu" else meshio.vtk.read
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # its remarks on every file of the series
            mesh = read_mesh(str(path))
        places = np.asarray(mesh.points, dtype=float)
        data = {str(name): np.asarray(array) for name, array in mesh.point_data.items()}
    except Exception as error:  # meshio decodes as it goes, and fails on damaged content in any way
        raise CalibError(f"{path}: not a readable VTK file ({error!r}); did the program stop?") from error
    if places.ndim != 2 or len(places) == 0 or not np.all(np.isfinite(places)):
        raise CalibError(f"{path}: expected finite coordinates of points, got an array of shape {places.shape}")
    return places, {name: array for name, array in data.items() if _is_usable(array, len(places))}


def _meshio(path: Path) -> Any:
    try:
        import meshio  # an extra, which only this reader needs
    except ImportError as error:
        raise CalibError(f"{path}: the reader 'vtk' needs meshio; install calib[vtk]") from error
    return meshio


def _is_usable(array: np.ndarray, size: int) -> bool:
    return array.dtype.kind in REAL and 1 <= array.ndim <= 2 and len(array) == size


def _number(path: Path, name: str, point: int | Sequence[float], places: np.ndarray) -> int:
    """Return the number of a point, counted from 0."""
    if isinstance(point, int):
        if point >= len(places):
            raise CalibError(f"{path}: point {name!r}: expected a number from 0 to {len(places) - 1}, got {point}")
        return point
    place = np.array([*point, 0.0])[: places.shape[1]]  # a plane mesh lies at z = 0
    low, high = places.min(axis=0), places.max(axis=0)
    margin = OUTSIDE_SHARE * np.linalg.norm(high - low)
    if not np.all((low - margin <= place) & (place <= high + margin)):
        raise CalibError(
            f"{path}: point {name!r}: expected a place in the box from {low.tolist()} to {high.tolist()} of the "
            f"mesh, got {list(point)}; is it in the unit of the file?"
        )
    return int(np.argmin(np.linalg.norm(places - place, axis=1)))


def _values(numbers: Mapping[str, int], data: Mapping[str, np.ndarray]) -> list[tuple[str, float]]:
    """Return name and value of each column at one time."""
    values = []
    for name, number in numbers.items():
        for array, rows in data.items():
            if rows.ndim == 1:
                values.append((f"{name}.{array}", float(rows[number])))
            else:
                values += [(f"{name}.{array}[{i}]", float(value)) for i, value in enumerate(rows[number], 1)]
    return values
