"""How sure the calibrated values are."""

from calib.confidence.calibrated import around_best, confirmed, fitted, foreseen_noise_draws, profiled, sampled
from calib.confidence.local import Confidence
from calib.confidence.near_optimal import describe_near_optimal

__all__ = [
    "Confidence",
    "around_best",
    "confirmed",
    "describe_near_optimal",
    "fitted",
    "foreseen_noise_draws",
    "profiled",
    "sampled",
]
