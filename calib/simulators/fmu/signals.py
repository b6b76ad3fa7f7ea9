"""What the inputs of an FMU are over time: a record's excitation, and its derivatives."""

import math
from collections.abc import Callable, Sequence

from scipy.interpolate import make_interp_spline

from calib.records.excitation import Excitation
from calib.records.filter import low_pass
from calib.simulators.fmu.options import InputVariable

INPUT_SPLINE_DEGREE = 3  # of the spline through the samples of a recorded input
DIFFERENTIATED_SPLINE_DEGREE = 5  # of the one whose derivatives are needed

Signal = Callable[[float], list[float]]  # time [s] -> values of the inputs, each in its own unit


def input_signal(excitation: Excitation, variables: Sequence[InputVariable]) -> Signal:
    """Values of the inputs over time; none for a free decay, whose inputs keep their start values.

    A recorded input passes the zero-phase low-pass of its cutoff, where it states one and derivatives are needed, and
    is interpolated by a spline; before and after the samples it has the value of the first and the last one.
    """
    if excitation.recorded:
        return _recorded(excitation, variables)
    if excitation.harmonic:
        return _harmonic(excitation, variables)
    return lambda time: []


def _harmonic(excitation: Excitation, variables: Sequence[InputVariable]) -> Signal:
    tone = excitation.as_harmonic
    omega = 2.0 * math.pi * tone.frequency
    parts = [
        (tone.amplitude * omega**v.order, tone.phase + 0.5 * math.pi * v.order, v.unit.offset, v.unit.factor)
        for v in variables
    ]

    def at(time: float) -> list[float]:
        return [
            (size * math.cos(omega * time + phase) - offset) / factor  # x^(n) = A w^n cos(w t + phase + n pi / 2)
            for size, phase, offset, factor in parts
        ]

    return at


def _recorded(excitation: Excitation, variables: Sequence[InputVariable]) -> Signal:
    time, value = excitation.as_samples
    first, last = float(time[0]), float(time[-1])
    differentiated = any(variable.order for variable in variables)
    if differentiated and excitation.cutoff is not None:
        value = low_pass(value, time, excitation.cutoff)
    degree = DIFFERENTIATED_SPLINE_DEGREE if differentiated else INPUT_SPLINE_DEGREE
    spline = make_interp_spline(time, value, k=min(degree, time.size - 1))
    parts = [(spline.derivative(v.order) if v.order else spline, v.unit) for v in variables]

    def at(now: float) -> list[float]:
        inside = min(max(now, first), last)
        return [unit.from_si(float(rate(inside))) for rate, unit in parts]

    return at
