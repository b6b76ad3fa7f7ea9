"""The curve of series of changed parameters beside a known one: all of its points are corrected together.

Each point of the known curve is a guess of the new one, which Newton's method seeks in the plane across the known curve
there. So a curve costs a few evaluations of the equations, and is sampled as the known one is: what differs between
both is due to the parameters.
"""

from typing import Protocol

import numpy as np

from calib.dynamics.orbits import MAX_ROUNDING_REDUCTION, RESIDUAL_TOLERANCE, ROUNDING_RESIDUAL
from calib.modelling.modal_system import Forces

MAX_CURVE_CORRECTIONS = 12  # of Newton's method, with the derivatives of an earlier step where these serve
MAX_CHORD_REDUCTION = 0.1  # of the residual of a point by a step, above which derivatives are taken anew  [1]
MAX_MATRIX_ENTRIES = 20_000_000  # of the derivatives at all points, which are held together: 160 MB
MAX_SPACING_RATIO = 2.0  # of distances between neighbours on one curve over those on the other, and the inverse  [1]


class SeriesEquations(Protocol):
    """SeriesEquations of a curve of series, in its scaled coordinates z (d,).

    Attributes
    ----------
    run_over : number of the component over whose window the curve runs
    """

    @property
    def run_over(self) -> int:
        """Number of the component over whose window the curve runs."""
        ...

    def residual(self, z: np.ndarray) -> np.ndarray:
        """What is left of the equations (d - 1,) at a point."""
        ...

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """The same (m, d - 1) at points (m, d)."""
        ...

    def derivative(self, z: np.ndarray) -> np.ndarray:
        """Derivative (d - 1, d) of the residual."""
        ...

    def forces(self, z: np.ndarray) -> list[Forces]:
        """Forces along the motions of points (m, d)."""
        ...


def neighbour_curve(curve: SeriesEquations, known: np.ndarray) -> tuple[np.ndarray, list[Forces]] | None:
    """Points of a curve beside those of a known one, and the forces along their motions; None where none are found.

    They are not sought where the derivatives at all points would take too much memory. The first and the last point
    have that component of the known ones over whose window the curve runs.

    Parameters
    ----------
    curve : of changed parameters
    known : (m, d), m >= 2, points of a curve, in the scaled coordinates of `curve`
    """
    if _is_too_large(known):
        return None
    z, normals, matrices = (
        known.copy(),
        _normals(known, curve.run_over),
        np.full((*known.shape, known.shape[1]), np.nan),
    )
    residuals, largest = curve.residuals(z), np.inf
    size, left = np.linalg.norm(residuals, axis=1), np.arange(len(z))  # points that are not found yet
    slow = left
    for _ in range(MAX_CURVE_CORRECTIONS):
        before, largest = largest, float(size.max())
        if largest <= RESIDUAL_TOLERANCE or MAX_ROUNDING_REDUCTION * before < largest <= ROUNDING_RESIDUAL:
            forces = curve.forces(z)  # NaN where instants do not resolve internal states
            resolved = all(np.isfinite(own.value).all() for own in forces)
            return (z, forces) if resolved and _is_beside(z, known) else None
        if not largest < before:  # true for NaN
            return None
        matrices[slow] = _linearised(curve, z[slow], normals[slow])
        ahead = _corrected(z[left], matrices[left], residuals[left])
        if ahead is None:
            return None
        z[left], behind = ahead, size[left]
        residuals[left] = curve.residuals(ahead)
        size[left] = np.linalg.norm(residuals[left], axis=1)
        slow = left[size[left] > MAX_CHORD_REDUCTION * behind]
        left = np.flatnonzero(size > RESIDUAL_TOLERANCE)
        slow = np.intersect1d(slow, left)
    return None


def first_order_curve(curve: SeriesEquations, known: np.ndarray) -> np.ndarray | None:
    """Points (m, d) of a curve beside a known one to first order in the change of parameters; None as above.

    By one step of Newton's method: whoever differences curves for a derivative needs no more.
    """
    if _is_too_large(known):
        return None
    residuals, matrices = np.empty((len(known), known.shape[1] - 1)), np.empty((*known.shape, known.shape[1]))
    matrices[:, -1] = _normals(known, curve.run_over)
    for point, residual, matrix in zip(known, residuals, matrices, strict=True):
        residual[:] = curve.residual(point)
        if not np.isfinite(residual).all():  # internal states do not repeat, or instants do not resolve them
            return None
        matrix[:-1] = curve.derivative(point)
    z = _corrected(known, matrices, residuals)
    return z if z is not None and _is_beside(z, known) else None


def _is_too_large(known: np.ndarray) -> bool:
    """Whether the derivatives at all points (m, d) would take too much memory."""
    return len(known) * known.shape[1] ** 2 > MAX_MATRIX_ENTRIES


def _corrected(z: np.ndarray, matrices: np.ndarray, residuals: np.ndarray) -> np.ndarray | None:
    """Points (m, d) after a step of Newton's method in their planes; None where that is not determined."""
    if not np.isfinite(matrices).all():
        return None
    across = np.append(residuals, np.zeros((len(z), 1)), axis=1)
    try:
        return np.asarray(z - np.linalg.solve(matrices, across[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        return None


def _normals(known: np.ndarray, run_over: int) -> np.ndarray:
    """Unit normals (m, d) of planes across a curve; at its ends they hold one component, and turn in between.

    Planes across the curve up to its ends would crowd the points there, or draw them apart.
    """
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(known, axis=0), axis=1)))
    normals = np.zeros_like(known)
    normals[1:-1] = known[2:] - known[:-2]
    onward = np.sign(known[-1, run_over] - known[0, run_over])
    normals[[0, -1], run_over] = onward
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards_end = np.abs(2.0 * along / along[-1] - 1.0)
    normals *= 1.0 - towards_end[:, None]
    normals[:, run_over] += towards_end * onward
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _linearised(curve: SeriesEquations, z: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Derivatives (m, d, d) of the equations and planes at points (m, d)."""
    matrices = np.empty((*z.shape, z.shape[1]))
    matrices[:, -1] = normals
    for point, matrix in zip(z, matrices, strict=True):
        matrix[:-1] = curve.derivative(point)
    return matrices


def _is_beside(z: np.ndarray, known: np.ndarray) -> bool:
    """Whether points (m, d) follow one another as those of the known curve."""
    own, chords = np.diff(z, axis=0), np.diff(known, axis=0)
    ratio = np.linalg.norm(own, axis=1) / np.linalg.norm(chords, axis=1)
    onward = (own * chords).sum(axis=1) > 0.0
    return bool(onward.all() and ratio.max() < MAX_SPACING_RATIO and ratio.min() > 1.0 / MAX_SPACING_RATIO)
