"""Penalty contact between the layer and the remaining beam: nodes of the layer against segments of the beam.

Node i of the layer faces a fixed point of the beam, between the master nodes j and j + 1. Displacements are small
against the segments, and the contact acts in y. With the penetration p, its rate p', stiffness k and damping c

    F = max(0, k p + c p')        where p > 0                                                      [N]

Source: paper, section 4; stiffness as in LS-DYNA's penalty contacts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.modelling.laws import BoundLaw, at_site
from calib.simulators.delaminated_beam.mesh import Mesh, on_symmetry_plane, smooth_step
from calib.simulators.delaminated_beam.plane_stress import Material

Stiffness = Literal["bulk", "mass_dt"]


@dataclass(frozen=True, eq=False)
class Pairs:
    """The nodes of the layer with the points of the beam that they face; arrays are (m,).

    Attributes
    ----------
    slave, master : nodes: of the layer, and left of the point that it faces
    following : node right of that point
    weight : of the right one  [1]
    place : along the delamination, -1 and 1 its ends  [1]
    length : of the layer that belongs to the node  [m]
    mass : of the node and of the beam at the point it faces (2, m), interpolated, as of the whole beam  [kg]
    share : 0.5 on the plane of symmetry, where half the pair is modelled; 0 where both sides are one node; else 1
    """

    slave: np.ndarray
    master: np.ndarray
    following: np.ndarray
    weight: np.ndarray
    place: np.ndarray
    length: np.ndarray
    mass: np.ndarray
    share: np.ndarray

    @property
    def reduced_mass(self) -> np.ndarray:
        """Mass that the two sides have against one another  [kg]."""
        layer, beam = self.mass
        return layer * beam / (layer + beam)


def pairs(mesh: Mesh, masses: np.ndarray) -> Pairs:
    """Pair the nodes along the delamination; `masses` (n,) are the nodes' [kg]."""
    index = np.arange(mesh.slaves.size)
    segment = np.minimum(index // mesh.ratio, mesh.masters.size - 2)
    weight = index / mesh.ratio - segment
    whole = masses.copy()
    share = np.where(mesh.slaves == mesh.masters[np.rint(segment + weight).astype(int)], 0.0, 1.0)
    if mesh.symmetric:
        whole[on_symmetry_plane(mesh.nodes)] *= 2.0
        share[0] = 0.5
    beam = (1.0 - weight) * whole[mesh.masters[segment]] + weight * whole[mesh.masters[segment + 1]]
    spacing = np.diff(mesh.nodes[mesh.slaves, 0]).mean()
    return Pairs(
        slave=mesh.slaves,
        master=mesh.masters[segment],
        following=mesh.masters[segment + 1],
        weight=weight,
        place=mesh.place,
        length=np.full(index.size, spacing),
        mass=np.array([whole[mesh.slaves], beam]),
        share=share,
    )


def clearance(
    pairs: Pairs, height: float, shift: float, laws: Sequence[BoundLaw] = (), table: np.ndarray | None = None
) -> np.ndarray:
    """Gap at rest (m,) of each pair: two cubics with horizontal tangents and a shift, or a table  [m].

    Parameters
    ----------
    height : of the cubics in the middle, g_max  [m]
    shift : added everywhere  [m]
    table : (k, 2) places x from the middle over half the delamination [1] and gaps [m], instead of the cubics; mirrored
        where it has no negative places

    Source: paper, Fig. 8.
    """
    if table is None:
        shape = height * smooth_step(pairs.place)
    else:
        place = pairs.place if table[0, 0] < 0.0 else np.abs(pairs.place)
        shape = np.interp(place, table[:, 0], table[:, 1])
    shape = shape + shift
    for law in at_site(laws, "gap"):
        shape = shape + np.array([law.function(z, law.p) for z in pairs.place])
    return shape


def penalty(
    pairs: Pairs, kind: Stiffness, factor: float, material: Material, width: float, thickness: float, step: float
) -> np.ndarray:
    """Contact stiffness (m,) of each pair  [N/m].

    Parameters
    ----------
    kind : "bulk": factor * K l b / t, with K the bulk modulus and t the layer's thickness; "mass_dt":
        factor * m / (2 dt^2), with m the reduced mass of the pair
    """
    if kind == "bulk":
        stiffness = factor * material.bulk * pairs.length * width / thickness
    else:
        stiffness = 0.5 * factor * pairs.reduced_mass / step**2
    return pairs.share * stiffness


def critical_damping(pairs: Pairs, stiffness: np.ndarray) -> np.ndarray:
    """C_crit (m,) = 2 m w with m the smaller of the two masses and w^2 = k / (reduced mass)  [N s/m].

    Up to twice the true critical damping of the pair, which has the reduced mass in m's place.
    """
    smaller = pairs.mass.min(axis=0)
    return 2.0 * smaller * np.sqrt(pairs.share * stiffness / pairs.reduced_mass)
