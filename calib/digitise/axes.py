"""Calibration of axes: from pixels to numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import CalibError

READING_SIGMA_PIXELS = 0.3  # pixels: standard uncertainty of an axis point that is read to a whole pixel (1 / sqrt 12)
PRIOR_WEIGHT = 4.0  # of READING_SIGMA_PIXELS, in residuals of axis points
MIN_SPREAD_RATIO = 1e-3  # of axis points: smaller spread over larger, below which they are on one line


@dataclass(frozen=True, eq=False)
class AxisCalibration:
    """An affine map from pixels to axes: shift, scale, turn and shear of a page that was scanned askew.

    (x, y) = matrix (column, row, 1), of the logarithm to base 10 where an axis is logarithmic.

    Attributes
    ----------
    matrix : (2, 3)
    spread : (2, 3, 3) columns of each are the independent errors of a row of the matrix, one standard deviation large
    logarithmic : of x and of y
    residual : (m,) distance of the axis points from where the map puts them  [pixels]; zeros where the map is
        determined by as many equations as it has unknowns
    reading : standard uncertainty of an axis point, from the residuals and `READING_SIGMA_PIXELS`  [pixels]
    """

    matrix: np.ndarray
    spread: np.ndarray
    logarithmic: tuple[bool, bool]
    residual: np.ndarray
    reading: float

    def __call__(self, pixels: np.ndarray) -> np.ndarray:
        """Points (n, 2) on the axes of pixels (n, 2), column and row; infinite beyond what a number can be."""
        plain = _affine(pixels) @ self.matrix.T
        with np.errstate(over="ignore"):
            return np.where(self.logarithmic, 10.0**plain, plain)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of points (n, 2) on the axes."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        plain = points.copy()
        for axis in (0, 1):
            if self.logarithmic[axis]:
                plain[:, axis] = np.log10(points[:, axis])
        return np.linalg.solve(self.matrix[:, :2], (plain - self.matrix[:, 2]).T).T

    def rates(self, pixels: np.ndarray) -> np.ndarray:
        """Change (n, 2, 2) of x and y (second index) with column and row (third); not finite beyond that."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._stretch(pixels)[:, :, None] * self.matrix[None, :, :2]

    def modes(self, pixels: np.ndarray) -> np.ndarray:
        """Displacement of points by the errors of the calibration: (6, n, 2), each one standard deviation large."""
        modes = np.zeros((6, len(pixels), 2))
        for axis in (0, 1):
            modes[3 * axis : 3 * axis + 3, :, axis] = (_affine(pixels) @ self.spread[axis]).T
        with np.errstate(over="ignore", invalid="ignore"):
            return modes * self._stretch(pixels)

    @property
    def posture(self) -> tuple[float, float]:
        """Rotation of the page (clockwise), and deviation of its axes from a right angle  [degrees]."""
        along = np.linalg.inv(self.matrix[:, :2])  # columns: pixels along x and along y
        x, y = np.degrees(np.arctan2(along[1], along[0]))
        return float((x + 90.0) % 180.0 - 90.0), float((x - y) % 180.0 - 90.0)

    def _stretch(self, pixels: np.ndarray) -> np.ndarray:
        """Change (n, 2) of x with its logarithm to base 10 where an axis is logarithmic, 1 elsewhere."""
        return np.where(self.logarithmic, np.log(10.0) * self(pixels), 1.0)


def calibrated(
    pixels: Sequence[Sequence[float]] | np.ndarray,
    x: Sequence[float | None],
    y: Sequence[float | None],
    logarithmic: tuple[bool, bool] = (False, False),
    reading: float = READING_SIGMA_PIXELS,
) -> AxisCalibration:
    """Calibrate by least squares from axis points.

    With three axis points that carry both numbers the map is determined, and there is no residual; more show how well
    the page is one. Two points that carry x alone and two that carry y alone serve too: going along one pair the
    other number is taken not to change (so WebPlotDigitizer and Engauge have it).

    Parameters
    ----------
    pixels : (m, 2) column and row of each axis point
    x, y : (m,) numbers on the axes, None where a point does not carry one
    logarithmic : of x and of y
    reading : standard uncertainty of an axis point [pixels]

    Raises
    ------
    CalibError : too few points, all on one line, two at one point, or a number that a logarithmic axis cannot carry
    """
    points = np.asarray(pixels, dtype=float).reshape(-1, 2)
    values = [_on_axis(v, log, name) for v, log, name in zip((x, y), logarithmic, "xy", strict=True)]
    rows = []
    for axis in (0, 1):
        own, other = np.isfinite(values[axis]), np.isfinite(values[1 - axis])
        design, right = _affine(points[own]), values[axis][own]
        if len(right) == 2 and (other & ~own).sum() == 2:
            along = np.diff(points[other & ~own], axis=0)
            design = np.vstack([design, np.column_stack([along, [0.0]])])
            right = np.append(right, 0.0)
        _check(design, right, "xy"[axis])
        rows.append(_solved(design, right))
    matrix = np.array([row for row, _, _ in rows])
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:, :2])) < 1e-9 * np.prod(_lengths(matrix)):
        raise CalibError("the axis points make x and y parallel; give points off that line, or correct a number")
    lengths = _lengths(matrix)
    residuals = [own / length for (_, own, _), length in zip(rows, lengths, strict=True)]
    free = sum(len(own) - 3 for own in residuals)
    squares = sum(float(own @ own) for own in residuals)
    reading = float(np.sqrt((PRIOR_WEIGHT * reading**2 + squares) / (PRIOR_WEIGHT + free)))
    spread = np.array([root * length * reading for (_, _, root), length in zip(rows, lengths, strict=True)])
    most = max(len(own) for own in residuals)
    residual = np.sqrt(sum(np.pad(own, (0, most - len(own))) ** 2 for own in residuals))
    return AxisCalibration(matrix, spread, logarithmic, residual, reading)


def two_points(pixels: np.ndarray, points: np.ndarray) -> AxisCalibration:
    """Calibrate from two points of a map: one scale in all directions, y up."""
    [first, second], [start, end] = np.asarray(pixels, dtype=float), np.asarray(points, dtype=float)
    apart = complex(second[0] - first[0], first[1] - second[1])
    if apart == 0.0 or np.allclose(start, end):
        raise CalibError("the two axis points are one and the same; move one of them")
    turn = complex(*(end - start)) / apart
    linear = np.array([[turn.real, turn.imag], [turn.imag, -turn.real]])
    matrix = np.column_stack([linear, start - linear @ first])
    root = READING_SIGMA_PIXELS * abs(turn) / abs(apart) * np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, abs(apart)]])
    return AxisCalibration(matrix, np.array([root, root]), (False, False), np.zeros(2), READING_SIGMA_PIXELS)


def _affine(pixels: np.ndarray) -> np.ndarray:
    return np.column_stack([pixels, np.ones(len(pixels))])


def _lengths(matrix: np.ndarray) -> np.ndarray:
    """Length (2,) of the gradient of x and of y, per pixel."""
    return np.hypot(matrix[:, 0], matrix[:, 1])


def _on_axis(values: Sequence[float | None], logarithmic: bool, name: str) -> np.ndarray:
    numbers = np.array([np.nan if v is None else float(v) for v in values])
    if np.isinf(numbers).any():
        raise CalibError(f"an axis point has {name} = infinity; mend the number")
    if logarithmic and (numbers[np.isfinite(numbers)] <= 0.0).any():
        bad = float(numbers[np.isfinite(numbers)].min())
        raise CalibError(f"{name} is a logarithmic axis, which cannot carry {bad:g}; expected numbers above 0")
    return np.log10(numbers) if logarithmic else numbers


def _check(design: np.ndarray, right: np.ndarray, name: str) -> None:
    if len(right) < 3:
        raise CalibError(
            f"{len(right)} axis point(s) carry a number of {name}; expected 3 or more that are not on one line"
        )
    if not np.isfinite(design).all():
        raise CalibError("an axis point stands at no pixel (NaN or infinity); mend its column and row")
    whole = design[:, 2] == 1.0
    centred = design[:, :2] - whole[:, None] * design[whole][:, :2].mean(axis=0)
    singular = np.linalg.svd(centred, compute_uv=False)
    if singular[1] <= MIN_SPREAD_RATIO * singular[0]:
        raise CalibError(f"the axis points that carry {name} are on one line; add one off it")
    if np.ptp(right[whole]) <= 0.0:
        raise CalibError(f"all axis points have the same {name} = {right[0]:g}; add one at another {name}")


def _solved(design: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row (3,), residual of each equation, and a root (3, 3) of the covariance for unit noise."""
    scale = np.array([1.0, 1.0, np.abs(design[:, :2]).max()])  # keeps the columns of one size
    row, *_ = np.linalg.lstsq(design * scale, right, rcond=None)
    _, singular, turn = np.linalg.svd(design * scale, full_matrices=False)
    return row * scale, right - design @ (row * scale), scale[:, None] * turn.T / singular
