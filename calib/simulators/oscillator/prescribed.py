"""Inverse dynamics of one mass: the force that a prescribed motion needs."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.interpolate import make_interp_spline

from calib.errors import CalibError
from calib.modelling.laws import STATES, BoundLaw
from calib.records.excitation import Excitation
from calib.records.filter import low_pass
from calib.simulators.compilation import COMPILED, WITHIN
from calib.simulators.law_calls import addresses
from calib.simulators.law_calls import excitation as excitation_law
from calib.simulators.law_calls import force as force_law

EXCITATION_SPLINE_DEGREE = 5  # of the spline through the samples: the acceleration is then a cubic
MIN_SAMPLES_PER_PERIOD = 200  # of a harmonic motion that laws of the excitation change
STATE_TOLERANCE = 1e-6  # of the internal states of laws, relative to the largest value so far  [1]
MIN_STATE_ERROR = 1e-300  # added to the tolerance of a state, for one that is zero
MIN_PART = 1e-9  # of the interval between two samples: where a rate sets in or jumps, no step is shorter  [1]


class PrescribedMotion(NamedTuple):
    """A prescribed motion: time, displacement, velocity, acceleration, each (n,), in SI."""

    time: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray


def prescribed_motion(
    excitation: Excitation, scale: float, laws: Sequence[BoundLaw], times: np.ndarray
) -> PrescribedMotion:
    """Displacement, velocity and acceleration at all samples of the excitation and at `times` (n,) [s] within them.

    A recorded motion passes the zero-phase low-pass of its cutoff and is then differentiated as a spline. A harmonic
    one is differentiated in closed form, or as a spline where laws of the excitation change it.

    Raises
    ------
    CalibError : a recorded motion without cutoff
    """
    if not excitation.recorded:
        return _harmonic_motion(excitation, scale, laws, times)
    if excitation.cutoff is None:
        raise CalibError(
            "a recorded displacement is differentiated twice, and never silently: state the low-pass that goes before, "
            'as in cutoff = "100 Hz" in [record.excitation]'
        )
    time, value = excitation.as_samples
    start, end = time[0], time[-1]
    value = low_pass(value, time, excitation.cutoff) * scale
    grid = np.linspace(start, end, time.size)  # a clock's rounding would be differentiated too
    value += law_changes(grid, value, excitation, scale, laws)
    return _differentiated(grid, value, np.union1d(grid, np.clip(times, start, end)))


def _harmonic_motion(
    excitation: Excitation, scale: float, laws: Sequence[BoundLaw], times: np.ndarray
) -> PrescribedMotion:
    """Motion of a harmonic excitation at `times` (n,), evenly spaced, and in between where they are sparse."""
    tone = excitation.as_harmonic
    omega = 2.0 * math.pi * tone.frequency
    amplitude = scale * tone.amplitude
    finer = max(1, math.ceil(MIN_SAMPLES_PER_PERIOD * tone.frequency * (times[1] - times[0])))
    before = 2 * EXCITATION_SPLINE_DEGREE  # samples beyond both ends keep the spline's ends away
    count = finer * (times.size - 1) + 1
    step = (times[-1] - times[0]) / (count - 1)
    grid = times[0] + step * np.arange(-before, count + before)
    phase = omega * grid + tone.phase
    x = amplitude * np.cos(phase)
    changes = law_changes(grid, x, excitation, scale, laws)
    if not changes.any():
        motion = PrescribedMotion(grid, x, -omega * amplitude * np.sin(phase), -(omega**2) * x)
    else:
        motion = _differentiated(grid, x + changes, grid)
    return PrescribedMotion(*(part[before:-before] for part in motion))


def _differentiated(time: np.ndarray, x: np.ndarray, at: np.ndarray) -> PrescribedMotion:
    spline = make_interp_spline(time, x, k=EXCITATION_SPLINE_DEGREE)
    return PrescribedMotion(at, spline(at), spline.derivative(1)(at), spline.derivative(2)(at))


def law_changes(
    time: np.ndarray, x: np.ndarray, excitation: Excitation, scale: float, laws: Sequence[BoundLaw]
) -> np.ndarray:
    """Change (n,) of the excitation `x` (n,) by the laws that act on it."""
    functions, p, count = addresses(laws, "excitation")
    omega = 2.0 * math.pi * (excitation.frequency or 0.0)
    amplitude = scale * (excitation.amplitude or 0.0)
    return _changes(time, x, omega, excitation.phase, amplitude, functions, p, count)


@njit(**COMPILED)
def _changes(
    time: np.ndarray,
    x: np.ndarray,
    omega: float,
    phase: float,
    amplitude: float,
    functions: np.ndarray,
    p: np.ndarray,
    count: int,
) -> np.ndarray:
    change = np.zeros(time.size)
    for j in range(time.size):
        for i in range(count):
            change[j] += excitation_law(functions[i], time[j], omega * time[j] + phase, amplitude, x[j], p[i])
    return change


def law_accelerations(motion: PrescribedMotion, laws: Sequence[BoundLaw], budget: int) -> np.ndarray | None:
    """Sum (n,) [m/s^2] of the force laws along the motion; None where their states take more than `budget` steps.

    Internal states start at zero and obey their own equation, driven by the motion.
    """
    functions, p, count = addresses(laws, "force")
    states = np.array([law.states for law in laws if law.site == "force"], dtype=np.int64)
    total = np.zeros(motion.time.size)
    spent = _along(motion.time, motion.x, motion.v, functions, p, count, states, budget, total)
    return total if spent <= budget else None


@njit(**WITHIN)
def _hermite(x0: float, v0: float, x1: float, v1: float, h: float, s: float) -> tuple[float, float]:
    """Displacement and velocity a part `s` of the interval `h` [s] on, from those at its ends."""
    d = x1 - x0
    x = x0 + s * (h * v0 + s * (3.0 * d - h * (2.0 * v0 + v1) + s * (h * (v0 + v1) - 2.0 * d)))
    v = v0 + s * (2.0 * (3.0 * d / h - 2.0 * v0 - v1) + s * 3.0 * (v0 + v1 - 2.0 * d / h))
    return x, v


@njit(**WITHIN)
def _rates(
    function: int,
    p: np.ndarray,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    s: float,
    z: np.ndarray,
    dz: np.ndarray,
) -> None:
    """Write the rates of a law's internal states a part `s` of the way between (t, x, v) at `start` and at `end`."""
    h = end[0] - start[0]
    x, v = _hermite(start[1], start[2], end[1], end[2], h, s)
    dz[:] = 0.0
    force_law(function, start[0] + s * h, x, v, p, z, dz)


@njit(**WITHIN)
def _advance_states(
    function: int,
    p: np.ndarray,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    z: np.ndarray,
    size: np.ndarray,
    part: float,
    allowed: int,
    stages: np.ndarray,
    new: np.ndarray,
) -> tuple[int, float]:
    """Carry the internal states z (m,) of a law from `start` to `end`, (t, x, v) each.

    The pair of orders 3 and 2 of Bogacki and Shampine (1989) chooses its steps, parts of the interval; `size` (m,)
    holds the largest value of each state so far, `stages` (4, m) and `new` (m,) are scratch. A state that sets out from
    zero has no size to which its error could be small: the step over its onset is the shortest, whatever its error.
    Returns the steps spent (more than `allowed`: given up) and the part that the next interval should begin with.
    """
    h = end[0] - start[0]
    k1, k2, k3, k4 = stages[0], stages[1], stages[2], stages[3]
    s, spent = 0.0, 0
    while s < 1.0 and spent <= allowed:
        spent += 1
        step = min(max(part, MIN_PART), 1.0 - s)
        _rates(function, p, start, end, s, z, k1)
        for i in range(z.size):
            new[i] = z[i] + 0.5 * step * h * k1[i]
        _rates(function, p, start, end, s + 0.5 * step, new, k2)
        for i in range(z.size):
            new[i] = z[i] + 0.75 * step * h * k2[i]
        _rates(function, p, start, end, s + 0.75 * step, new, k3)
        for i in range(z.size):
            new[i] = z[i] + step * h * (2.0 * k1[i] + 3.0 * k2[i] + 4.0 * k3[i]) / 9.0
        _rates(function, p, start, end, s + step, new, k4)
        error = 0.0
        for i in range(z.size):
            off = step * h * abs(-5.0 * k1[i] / 72.0 + k2[i] / 12.0 + k3[i] / 9.0 - k4[i] / 8.0)
            off = off / (STATE_TOLERANCE * max(size[i], abs(new[i])) + MIN_STATE_ERROR)
            error = max(error, math.inf if math.isnan(off) else off)
        if error <= 1.0 or step <= MIN_PART:
            for i in range(z.size):
                z[i] = new[i]
                size[i] = max(size[i], abs(new[i]))
            if error == math.inf:  # a state that is no number, or infinite, remains so
                return spent, 1.0
            s = 1.0 if step >= 1.0 - s else s + step
        part = step * min(4.0, max(0.2, 0.9 * (error + 1e-3) ** (-1.0 / 3.0)))
    return spent, part


@njit(**COMPILED)
def _along(
    time: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    functions: np.ndarray,
    p: np.ndarray,
    count: int,
    states: np.ndarray,
    budget: int,
    total: np.ndarray,
) -> int:
    """Add the laws' accelerations to `total` (n,); return the steps that their states took."""
    spent = 0
    stages, new = np.zeros((4, STATES)), np.zeros(STATES)
    for i in range(count):
        z, size, part = np.zeros(STATES), np.zeros(STATES), 1.0
        for j in range(time.size):
            if j > 0 and states[i] > 0:
                start, end = (time[j - 1], x[j - 1], v[j - 1]), (time[j], x[j], v[j])
                steps, part = _advance_states(
                    functions[i], p[i], start, end, z, size, part, budget - spent, stages, new
                )
                spent += steps
                if spent > budget:
                    return spent
            total[j] += force_law(functions[i], time[j], x[j], v[j], p[i], z, new)
    return spent
