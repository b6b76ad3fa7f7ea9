"""How sure the calibrated values are."""

from calib.confidence.calibrated import around_best
from calib.confidence.echo import echoes
from calib.confidence.local import Confidence, local
from calib.confidence.undetermined import Group

__all__ = ["Confidence", "Group", "around_best", "echoes", "local"]
