"""Features: numbers with a unit, taken of a record, by which a simulation is compared."""

from calib.features.amplitude import Amplitude
from calib.features.backbone import BackboneCurve
from calib.features.contact_time import ContactTime
from calib.features.decay import DecayCurve
from calib.features.force_balance import ForceBalance
from calib.features.harmonics import Harmonics
from calib.features.impact_phase import ImpactPhase
from calib.features.phase_curve import PhaseCurve
from calib.features.poincare_spread import PoincareSpread
from calib.features.time_history import TimeHistory

__all__ = [
    "Amplitude",
    "BackboneCurve",
    "ContactTime",
    "DecayCurve",
    "ForceBalance",
    "Harmonics",
    "ImpactPhase",
    "PhaseCurve",
    "PoincareSpread",
    "TimeHistory",
]
