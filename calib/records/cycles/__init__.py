"""A record cut by the period of its excitation."""

from calib.records.cycles.clock import clock_rate
from calib.records.cycles.gaps import gaps_in
from calib.records.cycles.impacts import impact, impacts_per_period
from calib.records.cycles.loop import averaged_at_impacts, cut, harmonics, period_of, rows, sampled
from calib.records.cycles.mean_cycle import MeanCycle, loop_sigma, mean_cycle, phase_curve
from calib.records.cycles.motion import (
    IRREGULAR,
    NO_CONTACT,
    NOT_PERIODIC,
    SWEPT,
    UNDECIDED,
    WITHOUT_KIND,
    MotionKind,
    kind_of_motion,
)
from calib.records.cycles.stroboscopic import poincare, section

__all__ = [
    "IRREGULAR",
    "NOT_PERIODIC",
    "NO_CONTACT",
    "SWEPT",
    "UNDECIDED",
    "WITHOUT_KIND",
    "MeanCycle",
    "MotionKind",
    "averaged_at_impacts",
    "clock_rate",
    "cut",
    "gaps_in",
    "harmonics",
    "impact",
    "impacts_per_period",
    "kind_of_motion",
    "loop_sigma",
    "mean_cycle",
    "period_of",
    "phase_curve",
    "poincare",
    "rows",
    "sampled",
    "section",
]
