"""The curve of series of changed parameters beside a known one: all of its points are corrected together.

Each point of the known curve is a guess of the new one, which Newton's method seeks in the plane across the known curve
there. So a curve costs a few evaluations of the equations, and is sampled as the known one is: what differs between
both is due to the parameters.
"""

import numpy as np

from calib.dynamics.orbits import MAX_ROUNDING_REDUCTION, RESIDUAL_TOLERANCE, ROUNDING_RESIDUAL
from calib.dynamics.series_curve import SeriesCurve
from calib.modelling.modal_system import Forces

MAX_CURVE_CORRECTIONS = 12  # of Newton's method, with the derivatives of an earlier step where these serve
MAX_CHORD_REDUCTION = 0.1  # of the largest residual by a step, above which derivatives are taken anew  [1]
MAX_MATRIX_ENTRIES = 20_000_000  # of the derivatives at all points, which are held together: 160 MB
MAX_SPACING_RATIO = 2.0  # of distances between neighbours on one curve over those on the other, and the inverse  [1]


def neighbour_curve(curve: SeriesCurve, known: np.ndarray) -> tuple[np.ndarray, list[Forces]] | None:
    """Points of a curve beside those of a known one, and the forces along their motions; None where none are found.

    They are not sought where the derivatives at all points would take too much memory. The first and the last point
    have the parameter of the known ones.

    Parameters
    ----------
    curve : of changed parameters
    known : (m, d), m >= 2, points of a curve, in the scaled coordinates of `curve`
    """
    if len(known) * known.shape[1] ** 2 > MAX_MATRIX_ENTRIES:
        return None
    z, normals, matrices, largest = known, _normals(known), np.zeros(0), np.inf
    for _ in range(MAX_CURVE_CORRECTIONS):
        forces, matrices = _linearised(curve, z, normals) if not matrices.size else (_forces(curve, z), matrices)
        residuals = curve.residuals(z, forces)
        before, largest = largest, float(np.linalg.norm(residuals, axis=1).max())
        if largest <= RESIDUAL_TOLERANCE or MAX_ROUNDING_REDUCTION * before < largest <= ROUNDING_RESIDUAL:
            return (z, forces) if _is_beside(z, known) else None
        if not largest < before or not np.isfinite(matrices).all():  # true for NaN
            return None
        if MAX_CHORD_REDUCTION * before < largest:
            matrices = _linearised(curve, z, normals)[1]
        across = np.append(residuals, np.zeros((len(z), 1)), axis=1)
        try:
            z = z - np.linalg.solve(matrices, across[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            return None
    return None


def _normals(known: np.ndarray) -> np.ndarray:
    """Unit normals (m, d) of planes across a curve; at its ends they hold the parameter."""
    normals = np.zeros_like(known)
    normals[1:-1] = known[2:] - known[:-2]
    normals[[0, -1], -1] = 1.0
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _forces(curve: SeriesCurve, z: np.ndarray) -> list[Forces]:
    return curve.balance.forces_of_all(*curve.unpacked_all(z))


def _linearised(curve: SeriesCurve, z: np.ndarray, normals: np.ndarray) -> tuple[list[Forces], np.ndarray]:
    """Forces along the motions at points (m, d), and the derivatives (m, d, d) of the equations and planes there."""
    forces, matrices = list[Forces](), np.empty((*z.shape, z.shape[1]))
    matrices[:, -1] = normals
    for point, matrix in zip(z, matrices, strict=True):
        forces.append(curve.balance.forces(*curve.unpacked(point)))  # which the derivative asks for, too
        matrix[:-1] = curve.derivative(point)
    return forces, matrices


def _is_beside(z: np.ndarray, known: np.ndarray) -> bool:
    """Whether points (m, d) follow one another as those of the known curve."""
    own, chords = np.diff(z, axis=0), np.diff(known, axis=0)
    ratio = np.linalg.norm(own, axis=1) / np.linalg.norm(chords, axis=1)
    onward = (own * chords).sum(axis=1) > 0.0
    return bool(onward.all() and ratio.max() < MAX_SPACING_RATIO and ratio.min() > 1.0 / MAX_SPACING_RATIO)
