"""Component modes of the beam with its contact line, and the one nonlinearity that its bending has.

The modes are those with the driven node at rest; the static shape of the driven node is added. What the modes left out
yield under contact forces is a static compliance of the contact line. Bending stretches the layer between its
ends, and less so the remaining beam: with the rotations theta of the elements,

    E = 1/2 int theta^2 (layer) - 1/2 int theta^2 (beam),      V = N E + 1/2 kappa E^2

where N is the tension of the layer in the linear motion and kappa its stiffness against such an elongation, as far as
the modes do not carry it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import eigsh, splu

from calib.simulators.delaminated_beam.plane_stress import ALONG
from calib.simulators.delaminated_beam.structure import MeshedStructure


@dataclass(frozen=True, eq=False)
class Modes:
    """A structure in its lowest modes; coordinates are n modal ones and, last, the displacement X of the driven node.

    Attributes
    ----------
    omega : (n,)  [rad/s]
    inertia : (n,) modal force for an acceleration of the driven node  [kg^1/2]
    shape : (2 * nodes, n + 1) displacement of every freedom; the last column is the static shape
    across : (m, n + 1) opening of the contact pairs
    compliance : (m, m) opening of the pairs under unit forces that push them apart, as far as no mode carries it  [m/N]
    quadratic : (n + 1, n + 1) E = 1/2 y . quadratic y
    tension : (n + 1,) N = tension . y
    kappa : [N/m]
    """

    omega: np.ndarray
    inertia: np.ndarray
    shape: np.ndarray
    across: np.ndarray
    compliance: np.ndarray
    quadratic: np.ndarray
    tension: np.ndarray
    kappa: float


def modes(structure: MeshedStructure, count: int) -> Modes:
    """Compute the lowest `count` modes of a structure."""
    free, size = structure.free, structure.stiffness.shape[0]
    mass = np.repeat(structure.mass, 2)[free]
    stiffness = structure.stiffness[free][:, free].tocsc()
    root = np.sqrt(mass)
    scaled = (stiffness.multiply(1.0 / root[:, None]).multiply(1.0 / root[None, :])).tocsc()
    squares, vectors = eigsh(scaled, count, sigma=0.0, which="LM", v0=np.ones(len(free)))
    order = np.argsort(squares)
    squares, vectors = squares[order], vectors[:, order]
    vectors = vectors * np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(count)])
    static = structure.static_shape().ravel()
    shape = np.zeros((size, count + 1))
    shape[free, :count] = vectors / root[:, None]
    shape[:, count] = static

    solve = splu(stiffness)
    pairs = structure.pairs
    opening = np.zeros((len(pairs.slave), size))
    rows = np.arange(len(pairs.slave))
    opening[rows, 2 * pairs.slave + 1] += 1.0
    opening[rows, 2 * pairs.master + 1] -= 1.0 - pairs.weight
    opening[rows, 2 * pairs.following + 1] -= pairs.weight

    def left_out(load: np.ndarray) -> np.ndarray:
        """Static displacement (free, k) under loads (free, k), without that of the modes."""
        modal = shape[free, :count]
        return solve.solve(load) - modal @ ((modal.T @ load) / squares[:, None])

    compliance = opening[:, free] @ left_out(np.ascontiguousarray(opening[:, free].T))
    membrane = _membrane(structure)
    stiff = structure.material.young * membrane.area / membrane.length
    residual = membrane.elongation[free] @ left_out(membrane.elongation[free][:, None])[:, 0]
    turned = membrane.rotation @ shape
    return Modes(
        omega=np.sqrt(squares),
        inertia=vectors.T @ (root * static[free]),
        shape=shape,
        across=opening @ shape,
        compliance=0.5 * (compliance + compliance.T),
        quadratic=turned.T @ (membrane.weight[:, None] * turned),
        tension=stiff * membrane.elongation @ shape,
        kappa=float(stiff * (1.0 - stiff * residual)),
    )


class Membrane(NamedTuple):
    """What stretches the layer.

    Attributes
    ----------
    elongation : (2 n,) of the layer, per displacement of every freedom  [1]
    rotation : (e, 2 n) of the elements, per displacement of every freedom  [1/m]
    weight : (e,) of their squares in E (see above)  [m]
    length, area : of the layer and of its cross-section  [m], [m^2]
    """

    elongation: np.ndarray
    rotation: np.ndarray
    weight: np.ndarray
    length: float
    area: float


def _membrane(structure: MeshedStructure) -> Membrane:
    """Elongation of the layer, and the rotations of the elements that stretch it."""
    mesh = structure.mesh
    elongation = np.zeros(structure.stiffness.shape[0])
    rotations, weights = [], []
    length = area = 0.0
    thickness = _heights(structure)
    for lower in mesh.strips:
        quads = mesh.quadrilaterals(lower)
        e = structure.elements(lower)
        layer = lower > mesh.interface
        first = mesh.first
        last = mesh.last if layer else mesh.first + (mesh.last - mesh.first) // mesh.ratio
        within = slice(first, last)
        q = quads[within]
        c, s, along = e.cosine[within, None], e.sine[within, None], e.along[within, None]
        share = e.across / thickness[layer]  # of the height
        rotation = np.zeros((len(q), elongation.size))
        row = np.arange(len(q))[:, None]
        # the chord of a bent element turns as its two long sides do
        np.add.at(rotation, (row, 2 * q), -s * ALONG / along)
        np.add.at(rotation, (row, 2 * q + 1), c * ALONG / along)
        rotations.append(rotation)
        weights.append((1.0 if layer else -1.0) * share * e.along[within])
        if layer:
            np.add.at(elongation, 2 * q, share * c * ALONG)
            np.add.at(elongation, 2 * q + 1, share * s * ALONG)
            length, area = float(e.along[within].sum()), area + e.across * structure.width
    return Membrane(elongation, np.concatenate(rotations), np.concatenate(weights), length, area)


def _heights(structure: MeshedStructure) -> dict[bool, float]:
    """Height of the remaining beam (False) and of the layer (True)  [m]."""
    mesh = structure.mesh
    y = mesh.nodes[[line[-1] for line in mesh.lines], 1]
    return {False: float(y[mesh.interface] - y[0]), True: float(y[-1] - y[mesh.interface])}
