"""Stepped sines of an oscillator with a hidden force, and the study that seeks it.

The instrument holds each frequency until the motion repeats, or for some periods only, measures the complex amplitude
with noise of 2 % of the rms amplitude of a level or with what a `SteppedLaboratory` adds, and goes on from there, so
that a fold is passed as in a laboratory. Integrated by Runge and Kutta's classical method with fixed steps, which
shares nothing with what is calibrated.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden.stepped_laboratory import NOISE, WHITE, SteppedLaboratory
from hidden.stepped_laws import CAUSES, Force
from numba import njit
from scipy.optimize import least_squares, minimize

from calib.records.response import make_response

MASS, STIFFNESS, DAMPING = 1.0, 400.0, 0.9  # kg, N/m, N s/m
FREQUENCIES = np.linspace(2.7, 4.0, 24)  # Hz
CALIBRATED, HELD_OUT = (0.12, 0.25, 0.6), (0.4,)  # N
STEPS_PER_PERIOD, MAX_PERIODS, MEASURED_PERIODS = 600, 800, 4
CURVE_POINTS, FREQUENCY_KNOWN = 4000, 0.1  # of a curve beside which points are judged; of a step between frequencies
MAX_SPECIAL_STEPS = 15  # of the fit of a special case  [count]
CLOSED = 1e-6  # change of displacement and velocity over a period, over the largest that was reached


@njit
def _stepped(
    force: Force, states: int, size: float, form: float, values: np.ndarray, points: np.ndarray, wait: int
) -> np.ndarray:
    """Complex amplitudes (n,) of displacement by a force level cos(2 pi f t) per frequency, in their order  [m].

    points : (n, 3) frequency, level, and factor on the stiffness
    wait : periods at each frequency; 0: until the motion repeats
    """
    mass, damping, frequencies = values[0], values[2], points[:, 0]
    y, found = np.zeros(2 + states), np.zeros(frequencies.size, dtype=np.complex128)
    for k in range(frequencies.size):
        omega = 2.0 * np.pi * frequencies[k]
        h = 2.0 * np.pi / omega / STEPS_PER_PERIOD
        level, stiffness = points[k, 1], points[k, 2] * values[1]
        left, largest = wait or MAX_PERIODS, np.zeros(2)
        while left > 0:
            before, total = y.copy(), 0.0j
            for step in range(STEPS_PER_PERIOD):
                total += y[0] * np.exp(-1j * omega * step * h) * 2.0 / STEPS_PER_PERIOD
                slope, stages = np.zeros((4, y.size)), y.copy()
                for stage in range(4):
                    own = force(stages[0], stages[1], stages[2:], size, form, slope[stage, 2:])
                    part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                    drive = level * np.cos(omega * (step + part) * h)
                    slope[stage, 0] = stages[1]
                    slope[stage, 1] = (drive - stiffness * stages[0] - damping * stages[1]) / mass + own
                    if stage < 3:
                        stages = y + (1.0 if stage == 2 else 0.5) * h * slope[stage]
                y = y + h / 6.0 * (slope[0] + 2.0 * slope[1] + 2.0 * slope[2] + slope[3])
                largest = np.maximum(largest, np.abs(y[:2]))
            closed = not wait and (np.abs(y[:2] - before[:2]) < CLOSED * largest).all()
            left = min(left - 1, MEASURED_PERIODS if closed else left)
        found[k] = total
    return found


class Truth(NamedTuple):
    """What is hidden: name of the cause, its size and form, and the values of mass, stiffness and damping."""

    cause: str | None
    size: float
    form: float
    values: np.ndarray


def drawn(cause: str | None, seed: int) -> Truth:
    """Draw what is hidden."""
    rng = np.random.default_rng([seed, 22])
    values = np.array([MASS, STIFFNESS * rng.uniform(0.95, 1.05), DAMPING * rng.uniform(0.6, 1.4)])
    if cause is None:
        return Truth(None, 0.0, 1.0, values)
    low, high = np.log(CAUSES[cause].sizes), np.log(CAUSES[cause].form)
    return Truth(cause, float(np.exp(rng.uniform(*low))), float(np.exp(rng.uniform(*high))), values)


def _amplitudes(truth: Truth, points: np.ndarray, wait: int = 0) -> np.ndarray:
    """Complex amplitudes (n,) without noise  [m]; points and wait as `_stepped` takes them."""
    cause = CAUSES[truth.cause or "cubic_stiffness"]
    return _stepped(cause.force, cause.states, truth.size, truth.form, truth.values, points, wait)


def _points(level: float) -> np.ndarray:
    """Points (n, 3) of a sweep up at a level, as `_stepped` takes them."""
    return np.column_stack([FREQUENCIES, np.full(FREQUENCIES.size, level), np.ones(FREQUENCIES.size)])


def signal_to_noise(truth: Truth) -> float:
    """Norm of what is hidden beyond what stiffness and damping absorb  [1].

    The linear oscillator of the known mass that fits the calibrated sweeps without noise best leaves that distance, of
    each point from its curve, in the noise of two per cent and a tenth of the step between frequencies, to which these
    are known where a record does not state it. No law of the library has a part in it.
    """
    step = float(np.diff(FREQUENCIES).mean())
    along = np.linspace(FREQUENCIES[0] - step, FREQUENCIES[-1] + step, CURVE_POINTS)
    omega = 2.0 * np.pi * along
    apart = ((FREQUENCIES[:, None] - along) / (FREQUENCY_KNOWN * step)) ** 2
    own, sigma = [], []
    for level in CALIBRATED:
        own.append(_amplitudes(truth, _points(level)) / level)
        sigma.append(NOISE * np.sqrt(np.mean(np.abs(own[-1]) ** 2)))

    def square(relative: np.ndarray) -> float:
        stiffness, damping = truth.values[1:] * np.exp(relative)
        linear = 1.0 / (stiffness - MASS * omega**2 + 1j * omega * damping)
        squares = (apart + np.abs((one[:, None] - linear) / s) ** 2 for one, s in zip(own, sigma, strict=True))
        return sum(float(each.min(axis=1).sum()) for each in squares)

    starts = [np.array([ratio, 0.3]) for ratio in (-0.1, 0.0, 0.1)]
    return float(np.sqrt(min(minimize(square, x, method="Nelder-Mead").fun for x in starts)))


def signal_beyond_special(truth: Truth) -> float:
    """Norm of what is hidden beyond what its special case absorbs with stiffness and damping, as `signal_to_noise`.

    inf where it has none. By the hider's own law, whose size and form are fitted too: what is closer to it than the
    noise cannot be told from it.
    """
    name = CAUSES[truth.cause].special if truth.cause else ""
    if not name:
        return float("inf")
    own = [_amplitudes(truth, _points(level)) for level in CALIBRATED]
    slopes = [np.gradient(one, FREQUENCIES) for one in own]
    known = FREQUENCY_KNOWN * float(np.diff(FREQUENCIES).mean())

    def residual(logarithms: np.ndarray) -> np.ndarray:
        stiffness, damping, size, form = np.exp(logarithms)
        other, parts = Truth(name, size, form, np.array([MASS, stiffness, damping])), []
        for level, one, slope in zip(CALIBRATED, own, slopes, strict=True):
            away = (_amplitudes(other, _points(level)) - one) * np.conj(slope) / np.abs(slope)
            sigma = NOISE * np.sqrt(np.mean(np.abs(one) ** 2))
            parts += [away.real / np.hypot(sigma, known * np.abs(slope)), away.imag / sigma]
        return np.concatenate(parts)

    begin = np.log([*truth.values[1:], truth.size, np.sqrt(np.prod(CAUSES[name].form))])
    return float(np.sqrt(2.0 * least_squares(residual, begin, diff_step=1e-3, max_nfev=MAX_SPECIAL_STEPS).cost))


def record(truth: Truth, levels: Sequence[float], seed: int, laboratory: SteppedLaboratory = WHITE):
    """Response record of sweeps at these levels."""
    rng = np.random.default_rng([seed, len(levels), 23])
    ways = [(level, way) for level in levels for way in laboratory.directions]
    frequency = np.concatenate([FREQUENCIES[:: int(way)] for _, way in ways])
    level, direction = np.repeat(ways, FREQUENCIES.size, axis=0).T
    sweep = np.repeat(np.arange(float(len(ways))), FREQUENCIES.size)
    acting = laboratory.levels(level, rng)
    points = np.column_stack([frequency, acting, laboratory.stiffness(level.size, rng)])
    own = [_amplitudes(truth, points[sweep == one], laboratory.wait) for one in range(len(ways))]
    rms = np.repeat([np.sqrt(np.mean(np.abs(one) ** 2)) for one in own], FREQUENCIES.size)
    amplitude, kept = laboratory.kept(laboratory.measured(np.concatenate(own), rms, rng), sweep, rng)
    told = acting if laboratory.trouble == "told level" else level
    return make_response(
        frequency[kept], ["mass"], amplitude[None], told[kept], "N", sweep[kept], direction[kept],
        place="mass", quantity="force",
    )  # fmt: skip


STUDY = """[study]
name = "stepped"
seed = {seed}
budget = 60

[[record]]
name = "levels"
path = "levels.nc"
use = "calibrate"

[[record]]
name = "between"
path = "between.nc"
use = "holdout"

[model]
simulator = "oscillator"

[model.fixed]
mass = "1 kg"

[windows]
stiffness = {{ low = "330 N/m", high = "470 N/m" }}
damping = {{ low = 0.1, high = 8.0, scale = "log" }}

[[term]]
feature = "frequency_response"

[optimiser]
name = "multistart"
"""


def written(truth: Truth, seed: int, folder: Path, laboratory: SteppedLaboratory = WHITE) -> None:
    """Write the records and the study of what is hidden."""
    for name, levels in (("levels", CALIBRATED), ("between", HELD_OUT)):
        record(truth, levels, seed, laboratory).to_netcdf(folder / f"{name}.nc")
    (folder / "study.toml").write_text(STUDY.format(seed=seed))
