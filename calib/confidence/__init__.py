"""How sure the calibrated values are."""

from calib.confidence.calibrated import around_best
from calib.confidence.echo import echoes
from calib.confidence.local import Confidence, Group, local

__all__ = ["Confidence", "Group", "around_best", "echoes", "local"]
