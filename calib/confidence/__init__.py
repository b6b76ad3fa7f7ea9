"""How sure the calibrated values are."""

from calib.confidence.calibrated import around_best
from calib.confidence.local import Confidence
from calib.confidence.near_equal import near_equal

__all__ = ["Confidence", "around_best", "near_equal"]
