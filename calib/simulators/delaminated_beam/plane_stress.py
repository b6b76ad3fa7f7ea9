"""Plane stress in rectangles with incompatible modes, in the basis in which their stiffness is diagonal.

The nodal displacements of a quadrilateral are written as its mean, its difference along the element, its difference
across it, and the product pattern (+, -, +, -). On a rectangle the constant strains take the first three, and each
product amplitude is pure bending about one axis, whose energy with incompatible modes is that of a beam: the stiffness
of Wilson's and Taylor's element (QM6), exactly.

Source: R. L. Taylor, P. J. Beresford, E. L. Wilson, Int. J. Numer. Meth. Engng 10 (1976) 1211.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from calib.simulators.delaminated_beam.mesh import Mesh

ALONG = np.array([-0.5, 0.5, 0.5, -0.5])  # of the nodes lower left, lower right, upper right, upper left
ACROSS = np.array([-0.5, -0.5, 0.5, 0.5])
PRODUCT = np.array([0.25, -0.25, 0.25, -0.25])
MAX_ELEMENT_ASPECT_RATIO = 1e4  # of an element: beyond, bending is lost in the rounding of the stretch


@dataclass(frozen=True)
class Material:
    """Isotropic and linear: Young's modulus [Pa], Poisson's ratio [1], density [kg/m^3]."""

    young: float
    poisson: float
    density: float

    @property
    def plane(self) -> float:
        """Plane-stress modulus E / (1 - nu^2)  [Pa]."""
        return self.young / (1.0 - self.poisson**2)

    @property
    def shear(self) -> float:
        """Shear modulus  [Pa]."""
        return 0.5 * self.young / (1.0 + self.poisson)

    @property
    def bulk(self) -> float:
        """Bulk modulus E / (3 (1 - 2 nu))  [Pa]."""
        return self.young / (3.0 * (1.0 - 2.0 * self.poisson))


@dataclass(frozen=True, eq=False)
class Elements:
    """Stress-free shapes and stiffnesses of the elements of a strip; arrays are (m,) unless stated otherwise.

    Attributes
    ----------
    along : lengths  [m]
    across : height, one for all  [m]
    width : out of the plane  [m]
    cosine, sine : of the angle by which an element stands turned
    twist : (2, m) amplitudes of the product pattern that the stress-free shape has, in turned axes  [m]
    bending : (2, m) stiffness against the product amplitudes in turned axes  [N/m]

    Notes
    -----
    An element of an arched layer is taken as a rectangle, turned and with a twist: the strain by which it differs from
    that (some 1e-8) is left out, so that it is free of stress where it is put.
    """

    along: np.ndarray
    across: float
    width: float
    cosine: np.ndarray
    sine: np.ndarray
    twist: np.ndarray
    bending: np.ndarray

    @property
    def volume(self) -> np.ndarray:
        """Volumes  [m^3]."""
        return self.along * self.across * self.width

    @property
    def turned(self) -> bool:
        """Whether any stress-free element is other than a rectangle along x."""
        return bool(np.any(self.sine) or np.any(self.twist))


def elements(
    nodes: np.ndarray, quadrilaterals: np.ndarray, material: Material, width: float, bilinear: bool = False
) -> Elements:
    """Measure the elements of a strip in their stress-free place.

    Parameters
    ----------
    nodes : (n, 2)  [m]
    quadrilaterals : (m, 4) nodes: lower left, lower right, upper right, upper left
    width : out of the plane  [m]
    bilinear : bending as in the bilinear element with full integration, which locks; for comparison with other codes

    Raises
    ------
    ValueError : an element without area, or one whose sides differ by more than MAX_ELEMENT_ASPECT_RATIO
    """
    corner = nodes[quadrilaterals]
    xi, eta, product = (np.einsum("i,mic->cm", pattern, corner) for pattern in (ALONG, ACROSS, PRODUCT))
    if not (xi[0] * eta[1] > xi[1] * eta[0]).all():
        raise ValueError("an element has no area")
    along, across = np.hypot(*xi), float(np.hypot(*eta).mean())
    if not 1.0 / MAX_ELEMENT_ASPECT_RATIO < along.min() / across <= along.max() / across < MAX_ELEMENT_ASPECT_RATIO:
        raise ValueError(f"elements of {along.max():.3g} m by {across:.3g} m are too slender to compute with")
    cosine, sine = turn(np.array([xi / along, eta / across]))
    if np.ptp(nodes[quadrilaterals[:, :2], 1]) == 0.0:  # what is left is rounding
        cosine, sine, product = np.ones_like(along), np.zeros_like(along), 0.0 * product
    bend = 4.0 / 3.0 * width * np.array([across / along, along / across])
    return Elements(
        along=along,
        across=across,
        width=width,
        cosine=cosine,
        sine=sine,
        twist=np.array([cosine * product[0] + sine * product[1], cosine * product[1] - sine * product[0]]),
        bending=material.plane * bend + material.shear * bend[::-1] if bilinear else material.young * bend,
    )


def turn(gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine (m,) of the rotation in a deformation gradient (2, 2, m): [j, i] is the change of x_i along j."""
    (f11, f21), (f12, f22) = gradient
    a, b = f11 + f22, f21 - f12
    r = np.hypot(a, b)
    return a / r, b / r


def energy(e: Elements, displacement: np.ndarray, material: Material) -> float:
    """Elastic energy of the elements of a strip, corotational  [J].

    Parameters
    ----------
    displacement : (m, 4, 2) of the elements' nodes  [m]
    """
    xi, eta, product = (np.einsum("i,mic->cm", pattern, displacement) for pattern in (ALONG, ACROSS, PRODUCT))
    straight = np.array([[e.cosine, e.sine], [-e.sine, e.cosine]])
    (f11, f21), (f12, f22) = gradient = straight + np.array([xi / e.along, eta / e.across])
    c, s = turn(gradient)
    e11, e22, shear = c * f11 + s * f21 - 1.0, c * f22 - s * f12 - 1.0, c * (f12 + f21) + s * (f22 - f11)
    density = material.plane * (e11**2 + e22**2 + 2.0 * material.poisson * e11 * e22) + material.shear * shear**2
    tx, ty = e.twist
    x, y = product[0] + e.cosine * tx - e.sine * ty, product[1] + e.sine * tx + e.cosine * ty
    bending = e.bending[0] * (c * x + s * y - tx) ** 2 + e.bending[1] * (c * y - s * x - ty) ** 2
    return 0.5 * float((e.volume * density).sum() + bending.sum())


def stiffness(mesh: Mesh, material: Material, width: float, bilinear: bool = False) -> sparse.csr_array:
    """Assemble the stiffness (2 n, 2 n) about the stress-free shape; freedoms 2 i, 2 i + 1: x, y of node i  [N/m]."""
    size = 2 * len(mesh.nodes)
    total = sparse.csr_array((size, size))
    for strip in mesh.strips:
        quads = mesh.quadrilaterals(strip)
        k = _stiffness(elements(mesh.nodes, quads, material, width, bilinear), material)
        freedoms = np.stack([2 * quads, 2 * quads + 1], axis=2).reshape(-1, 8)
        rows, columns = np.repeat(freedoms, 8, axis=1), np.tile(freedoms, (1, 8))
        total = total + sparse.coo_array((k.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsr()
    return total


def _stiffness(e: Elements, material: Material) -> np.ndarray:
    """Stiffness (m, 8, 8) of the elements of a strip."""
    along = e.along[:, None]
    stretch, widening, shear = (
        _amplitude(e, ALONG, 0) / along,
        _amplitude(e, ACROSS, 1) / e.across,
        _amplitude(e, ALONG, 1) / along + _amplitude(e, ACROSS, 0) / e.across,
    )
    volume, nu = e.volume, material.poisson
    k = _outer(stretch, stretch, volume * material.plane) + _outer(widening, widening, volume * material.plane)
    k += _outer(stretch, widening, nu * volume * material.plane)
    k += _outer(widening, stretch, nu * volume * material.plane)
    k += _outer(shear, shear, volume * material.shear)
    turning = 0.5 * (_amplitude(e, ALONG, 1) / along - _amplitude(e, ACROSS, 0) / e.across)
    for axis, carried in ((0, e.twist[1]), (1, -e.twist[0])):  # a turn carries the stress-free twist along
        twist = _amplitude(e, PRODUCT, axis) + carried[:, None] * turning
        k += _outer(twist, twist, e.bending[axis])
    return k


def _amplitude(e: Elements, pattern: np.ndarray, axis: int) -> np.ndarray:
    """Rows (m, 8) that take nodal displacements to a pattern's amplitude along a turned axis."""
    x, y = (e.cosine, e.sine) if axis == 0 else (-e.sine, e.cosine)
    return np.stack([x[:, None] * pattern, y[:, None] * pattern], axis=2).reshape(-1, 8)


def _outer(p: np.ndarray, q: np.ndarray, factor: np.ndarray) -> np.ndarray:
    return np.einsum("mi,mj,m->mij", p, q, factor)


def masses(mesh: Mesh, material: Material, width: float) -> np.ndarray:
    """Lumped masses (n,): a quarter of each element at each of its nodes  [kg]."""
    total = np.zeros(len(mesh.nodes))
    for strip in mesh.strips:
        quads = mesh.quadrilaterals(strip)
        volume = elements(mesh.nodes, quads, material, width).volume
        total += np.bincount(quads.ravel(), np.repeat(0.25 * material.density * volume, 4), len(total))
    return total
