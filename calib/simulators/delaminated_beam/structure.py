"""A meshed beam with its matrices."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh, spsolve

from calib.simulators.delaminated_beam import contact
from calib.simulators.delaminated_beam.contact import Pairs
from calib.simulators.delaminated_beam.mesh import Mesh
from calib.simulators.delaminated_beam.plane_stress import Elements, Material, elements, energy, masses, stiffness

BODIES = ("beam", "layer")
FREQUENCY_TOLERANCE = 1e-9  # of the square of the highest frequency  [1]


@dataclass(frozen=True, eq=False)
class MeshedStructure:
    """A meshed beam with its matrices.

    Attributes
    ----------
    mesh, material, width : [m]
    mass : (n,) of the nodes  [kg]
    stiffness : (2 n, 2 n) about the stress-free shape  [N/m]
    held : freedoms that do not move; the driven one is not among them
    pairs : of the contact
    bilinear : whether elements bend as bilinear ones with full integration
    """

    mesh: Mesh
    material: Material
    width: float
    mass: np.ndarray
    stiffness: sparse.csr_array
    held: np.ndarray
    pairs: Pairs
    bilinear: bool

    @property
    def driven(self) -> int:
        """Freedom that the drive prescribes."""
        return 2 * self.mesh.driven + 1

    @property
    def free(self) -> np.ndarray:
        """Freedoms that are neither held nor driven."""
        return np.setdiff1d(np.arange(2 * len(self.mass)), np.append(self.held, self.driven))

    def elements(self, strip: int) -> Elements:
        """Elements over line `strip`."""
        mesh = self.mesh
        return elements(mesh.nodes, mesh.quadrilaterals(strip), self.material, self.width, self.bilinear)

    def static_shape(self) -> np.ndarray:
        """Displacements (n, 2) at rest for one metre at the driven node, linear  [1]."""
        free, driven = self.free, self.driven
        shape = np.zeros(self.stiffness.shape[0])
        shape[driven] = 1.0
        load = -self.stiffness[free][:, [driven]].toarray()[:, 0]
        shape[free] = spsolve(self.stiffness[free][:, free].tocsc(), load)
        return shape.reshape(-1, 2)

    def critical_step(self) -> float:
        """Longest step with which central differences are stable without beta and contact, 2 / omega_max  [s]."""
        root = 1.0 / np.sqrt(np.repeat(self.mass, 2)[self.free])
        scaled = sparse.diags_array(root) @ self.stiffness[self.free][:, self.free] @ sparse.diags_array(root)
        [highest] = eigsh(
            scaled, 1, which="LM", return_eigenvectors=False, v0=np.ones(len(root)), tol=FREQUENCY_TOLERANCE
        )
        return float(2.0 / np.sqrt(highest))


def assemble(mesh: Mesh, material: Material, width: float, bilinear: bool = False) -> MeshedStructure:
    """Assemble the matrices of a mesh; see `MeshedStructure`."""
    mass = masses(mesh, material, width)
    k = stiffness(mesh, material, width, bilinear)
    return MeshedStructure(mesh, material, width, mass, k, mesh.held, contact.pairs(mesh, mass), bilinear)


def stable_step(critical: float, beta: float) -> float:
    """Longest stable step with stiffness damping  [s].

    The forces are taken at u + beta v with the velocity half a step back, so that the step h of a mode of frequency w
    is stable while (w h)^2 + 2 beta w^2 h <= 4.

    Parameters
    ----------
    critical : without damping  [s]
    beta : as a fraction of the critical damping of the highest mode: beta = 1 is `critical` seconds
    """
    return critical * (np.sqrt(1.0 + beta**2) - beta)


def elastic_energy(structure: MeshedStructure, displacement: np.ndarray) -> float:
    """Elastic energy at nodal displacements (n, 2)  [J]."""
    mesh, material = structure.mesh, structure.material
    return sum(
        energy(structure.elements(strip), displacement[mesh.quadrilaterals(strip)], material) for strip in mesh.strips
    )
