"""A record of a free decay: frequency and damping of its dominant mode over its amplitude."""

from calib.records.decay.crossings import crossing_curves
from calib.records.decay.curves import amplitude_curves, analytic_curves, over_amplitude
from calib.records.decay.free_motion import smoothed_decay
from calib.records.decay.of_record import (
    FREE_DECAY,
    BodyDecay,
    body_decays,
    decay_channel,
    is_free_decay,
    smoothed_record,
)
from calib.records.decay.release import release
from calib.records.decay.smoother import DecayFrame, SmoothedDecay

__all__ = [
    "FREE_DECAY",
    "BodyDecay",
    "DecayFrame",
    "SmoothedDecay",
    "amplitude_curves",
    "analytic_curves",
    "body_decays",
    "crossing_curves",
    "decay_channel",
    "is_free_decay",
    "over_amplitude",
    "release",
    "smoothed_decay",
    "smoothed_record",
]
