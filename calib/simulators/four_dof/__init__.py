"""The minimal model: four displacements, a rigid stop between beam and layer, Newton's law of restitution."""

from calib.simulators.four_dof.four_dof import FourDof

__all__ = ["FourDof"]
