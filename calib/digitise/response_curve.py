"""Printed curves over frequency: what they are the response to, and their amplitudes as displacements."""

import re
from typing import NamedTuple

import numpy as np

from calib.digitise.spec import CurveTable, PrintedExcitation
from calib.errors import CalibError
from calib.records.excitation import unit_of
from calib.records.motion_unit import MOTIONS, MotionUnit, motion_quantity, motion_unit
from calib.units import to_si

AMPLITUDE_CURVE, PHASE_CURVE = "amplitude over frequency", "phase over frequency"
DECIBEL = re.compile(r"^dB re (?P<reference>.+)$")  # a level of amplitudes, 20 log10 over the reference
NEPER_PER_DECIBEL = np.log(10.0) / 20.0  # of an amplitude


class PrintedSweep(NamedTuple):
    """What a curve over frequency is the response to.

    Attributes
    ----------
    level, unit : amplitude of the excitation, in its SI unit
    direction : 1.0 up, -1.0 down
    rates : how often the displacement is differentiated in what is shown; None: a phase that follows its amplitude
    """

    level: float
    unit: str
    direction: float
    rates: int | None = None


class PrintedAmplitudes(NamedTuple):
    """Amplitudes (n,) of the displacement [m], and what one unit of the axis is there (n,) [m]."""

    values: np.ndarray
    slope: np.ndarray
    unit: MotionUnit


def printed_sweep(entry: CurveTable, excitation: PrintedExcitation | None) -> PrintedSweep | None:
    """Return what a curve is the response to; None of a curve that is not over frequency.

    Raises
    ------
    CalibError : no excitation or no level, a level in another unit, or keys of a curve over frequency at another one
    """
    if entry.kind not in (AMPLITUDE_CURVE, PHASE_CURVE):
        for key in ("level", "direction", "of"):
            if key in entry.model_fields_set:
                raise CalibError(f"{key} belongs to a curve over frequency, but this one is a {entry.kind}; drop it")
        return None
    if entry.of is not None and entry.kind != PHASE_CURVE:
        raise CalibError("of belongs to a phase over frequency; drop it")
    if excitation is None:
        raise CalibError("a response needs [excitation] with place and quantity, and a level of each curve")
    level, unit = entry.level if entry.level is not None else excitation.amplitude, unit_of(excitation.quantity)
    if level is None:
        raise CalibError(
            f"the level is missing, the amplitude of the excitation: state it here, such as level = '1 {unit}', or one "
            "amplitude of all curves in [excitation]"
        )
    value = to_si(level, unit)
    if not 0.0 < value < np.inf:
        raise CalibError(f"a level is above 0, got {level!r}")
    rates = None if entry.of is None else list(MOTIONS).index(entry.of)
    return PrintedSweep(value, unit, 1.0 if entry.direction == "up" else -1.0, rates)


def printed_amplitudes(frequency: np.ndarray, numbers: np.ndarray, unit: str, sweep: PrintedSweep) -> PrintedAmplitudes:
    """Bring the numbers (n,) of an amplitude axis at frequencies (n,) [Hz] to displacements.

    Raises
    ------
    CalibError : a unit that is none of a displacement, velocity or acceleration, of one over the level, nor a level of
        one in decibels; a frequency that is not above 0
    """
    if not (frequency > 0.0).all():
        raise CalibError(f"frequencies are above 0, got {frequency.min():g} Hz; check the axis of the frequency")
    decibel = DECIBEL.match(unit)
    if decibel:
        of = motion_quantity(decibel["reference"], (sweep.unit,))
        shown = np.exp(NEPER_PER_DECIBEL * numbers)
        slope = NEPER_PER_DECIBEL * shown
    else:
        of = motion_unit(unit, per=(sweep.unit,))
        shown, slope = numbers, np.ones(numbers.size)
    scale = np.abs(of.displacement(np.ones(numbers.size), 2.0 * np.pi * frequency)) * (sweep.level if of.level else 1.0)
    return PrintedAmplitudes(shown * scale, slope * scale, of)


def amplitude_sigma(frequency: np.ndarray, stated: str | float, unit: MotionUnit, sweep: PrintedSweep) -> np.ndarray:
    """Bring a stated standard uncertainty of amplitudes, a quantity or a number in SI, to displacements (n,) [m]."""
    of = motion_quantity(stated, (sweep.unit,)) if isinstance(stated, str) else unit._replace(factor=stated)
    omega = 2.0 * np.pi * frequency
    return np.abs(of.displacement(np.ones(omega.size), omega)) * (sweep.level if of.level else 1.0)
