"""How sure the calibrated values are."""

from calib.confidence.local import Confidence, Group, local

__all__ = ["Confidence", "Group", "local"]
