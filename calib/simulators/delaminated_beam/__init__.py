"""A beam with a delaminated layer in finite elements: the explicit kernel, and its reduction to modes."""

from calib.simulators.delaminated_beam.delaminated_beam import DelaminatedBeam

__all__ = ["DelaminatedBeam"]
