"""The curves of an imported file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.digitise.axes import AxisCalibration
from calib.digitise.curve import Curve
from calib.errors import CalibError, nearest

CLICK_SIGMA = 0.5  # pixels: standard uncertainty of a point that was clicked, or is the centre of a blob


@dataclass(frozen=True)
class Imported:
    """The curves of a file, and its other contents.

    Attributes
    ----------
    path : the file
    form : what kind of file it is
    curves : that can be read, in the order of the file
    refused : name of a curve that cannot -> why
    columns : name -> (n,) of a plain table, NaN where a cell is empty; empty for other files
    header : TOML text at the head of a plain table, "" without one
    """

    path: Path
    form: str
    curves: Sequence[Curve] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    header: str = ""

    def curve(self, name: str | None) -> Curve:
        """Return the curve of that name, or the only one.

        Raises
        ------
        CalibError : there is no such curve, it is refused, or none was named where there are several
        """
        known = [curve.name for curve in self.curves]
        if name is None and len(known) == 1:
            return self.curves[0]
        if name is None:
            raise CalibError(f"{self.path} holds {len(known)} curves, {known}; say which one is meant: name = ...")
        if name in self.refused:
            raise CalibError(f"{self.path}: curve {name!r} is not read: {self.refused[name]}")
        if name not in known:
            raise CalibError(f"{self.path}: there is no curve {name!r}{nearest(name, known)}; it holds {known}")
        return self.curves[known.index(name)]

    def pair(self, first: str, second: str) -> Curve:
        """Return the curve that two columns of a plain table make.

        Raises
        ------
        CalibError : no such column, or fewer than two rows in which both are filled
        """
        for name in (first, second):
            if name not in self.columns:
                known = list(self.columns)
                raise CalibError(f"{self.path}: there is no column {name!r}{nearest(name, known)}; it has {known}")
        points = np.column_stack([self.columns[first], self.columns[second]])
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2:
            raise CalibError(f"{self.path}: columns {first!r} and {second!r} share {len(points)} row(s); expected more")
        return Curve(second, points)


def clicked(
    name: str, points: np.ndarray, pixels: np.ndarray, calibration: AxisCalibration, notes: Sequence[str] = ()
) -> Curve:
    """Curve of points that were clicked.

    points : (n, 2) numbers on the axes
    pixels : (n, 2) column and row of the same

    Raises
    ------
    CalibError : numbers beyond all bounds, or uncertainties
    """
    modes, (columns, rows) = calibration.modes(pixels), np.moveaxis(calibration.rates(pixels), 2, 0)
    with np.errstate(over="ignore"):
        sigma = CLICK_SIGMA * np.hypot(columns, rows)
    if not all(np.isfinite(one).all() for one in (points, sigma, modes)):
        raise CalibError("its numbers are beyond all bounds; check the calibration of its axes")
    return Curve(name, points, sigma, modes, notes=tuple(notes))
