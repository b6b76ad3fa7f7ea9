"""Stiffness of quadrilaterals by numerical quadrature: bilinear, and with incompatible modes that are condensed.

Source: R. L. Taylor, P. J. Beresford, E. L. Wilson, Int. J. Numer. Meth. Engng 10 (1976) 1211.
"""

import numpy as np
from scipy import sparse

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GAUSS = CORNERS / np.sqrt(3.0)


def strains(gradients):
    """Rows (3, 2 k) that take the amplitudes of k shape functions to e11, e22 and the shear; gradients (k, 2)."""
    rows = np.zeros((3, 2 * len(gradients)))
    rows[0, 0::2], rows[1, 1::2] = gradients[:, 0], gradients[:, 1]
    rows[2, 0::2], rows[2, 1::2] = gradients[:, 1], gradients[:, 0]
    return rows


def bilinear(point):
    """Derivatives (4, 2) of the nodal shape functions in the parent square."""
    return 0.25 * CORNERS * (1.0 + CORNERS[:, ::-1] * point[::-1])


def stiffness(corner, elasticity, width, incompatible=True):
    """Stiffness (8, 8) of a quadrilateral with these corners (4, 2) [m], by 2 x 2 points  [N/m]."""
    centre = corner.T @ bilinear(np.zeros(2))
    total = np.zeros((12, 12))
    for point in GAUSS:
        jacobian = corner.T @ bilinear(point)
        compatible = bilinear(point) @ np.linalg.inv(jacobian)
        # QM6: the gradients of 1 - xi^2 and 1 - eta^2 with the centre's jacobian, so that constant stress is passed
        bubbles = np.diag(-2.0 * point) @ np.linalg.inv(centre) * (np.linalg.det(centre) / np.linalg.det(jacobian))
        b = np.hstack([strains(compatible), strains(bubbles)])
        total += width * np.linalg.det(jacobian) * b.T @ elasticity @ b
    nodal, mixed, inner = total[:8, :8], total[:8, 8:], total[8:, 8:]
    return nodal - mixed @ np.linalg.solve(inner, mixed.T) if incompatible else nodal


def assemble(mesh, material, width, incompatible=True):
    """Stiffness (2 n, 2 n) of a mesh in plane stress  [N/m]."""
    nu = material.poisson
    elasticity = material.plane * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]])
    size = 2 * len(mesh.nodes)
    total = sparse.lil_array((size, size))
    for strip in mesh.strips:
        for quad in mesh.quadrilaterals(strip):
            freedoms = np.stack([2 * quad, 2 * quad + 1], axis=1).ravel()
            total[np.ix_(freedoms, freedoms)] += stiffness(mesh.nodes[quad], elasticity, width, incompatible)
    return total.tocsr()
