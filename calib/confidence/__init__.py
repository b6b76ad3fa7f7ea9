"""How sure the calibrated values are."""

from calib.confidence.calibrated import around_best
from calib.confidence.local import Confidence

__all__ = ["Confidence", "around_best"]
