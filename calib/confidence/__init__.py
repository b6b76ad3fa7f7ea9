"""How sure the calibrated values are."""

from calib.confidence.echo import echoes
from calib.confidence.local import Confidence, Group, local

__all__ = ["Confidence", "Group", "echoes", "local"]
