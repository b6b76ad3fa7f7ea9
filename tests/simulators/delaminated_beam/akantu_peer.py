"""The same mesh in akantu: bilinear elements with full integration, lumped masses, explicit, without contact."""

import tempfile
from pathlib import Path

import akantu
import numpy as np

MATERIAL = """material elastic [
  name = aluminium
  rho = {density}
  E = {young}
  nu = {poisson}
  Plane_Stress = true
]
"""


def model(mesh, material, step, displacement=None, held=()):
    """Make akantu's model of a mesh, at rest and of unit width; also its mesh, which must outlive it.

    Parameters
    ----------
    displacement : (n, 2) at the start  [m]
    held : freedoms 2 i, 2 i + 1 that do not move
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "material.dat"
        file.write_text(MATERIAL.format(density=material.density, young=material.young, poisson=material.poisson))
        akantu.parseInput(str(file))
    quads = np.concatenate([mesh.quadrilaterals(strip) for strip in mesh.strips])
    same = akantu.Mesh(2)
    access = akantu.MeshAccessor(same)
    access.resizeNodes(len(mesh.nodes))
    same.getNodes()[:] = mesh.nodes
    same.addConnectivityType(akantu._quadrangle_4)
    access.resizeConnectivity(len(quads), akantu._quadrangle_4)
    same.getConnectivity(akantu._quadrangle_4)[:] = quads
    access.makeReady()
    made = akantu.SolidMechanicsModel(same)
    made.initFull(_analysis_method=akantu._explicit_lumped_mass)
    made.setTimeStep(step)
    if displacement is not None:
        made.getDisplacement()[:] = displacement
    blocked = made.getBlockedDOFs()
    for freedom in held:
        blocked[freedom // 2, freedom % 2] = True
    return made, same
