"""Stepped sines of an oscillator with a hidden force, and the study that seeks it.

The instrument holds each frequency until the motion repeats, measures the complex amplitude with noise of 2 % of the
rms amplitude of a level or with what a `SteppedLaboratory` adds, and goes on from there, so that a fold is passed as in
a laboratory. Integrated by Runge and Kutta's classical method with fixed steps, which shares nothing with what is
calibrated.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden.stepped_laboratory import WHITE, SteppedLaboratory
from numba import njit

from calib.records.response import make_response

MASS, STIFFNESS, DAMPING = 1.0, 400.0, 0.9  # kg, N/m, N s/m
FREQUENCIES = np.linspace(2.7, 4.0, 24)  # Hz
CALIBRATED, HELD_OUT = (0.12, 0.25, 0.6), (0.4,)  # N
STEPS_PER_PERIOD, MAX_PERIODS, MEASURED_PERIODS = 600, 800, 4
CLOSED = 1e-6  # change of displacement and velocity over a period, over the largest that was reached
BOUC_WEN_SHAPE = 0.6  # share of the loop that depends on the direction; exponent 2
STRIBECK_RISE, BRISTLE = 0.6, 5e-4  # friction at rest over that of sliding, less 1; m

# x, v, internal states, size, form, rates of the states (written) -> force
Force = Callable[[float, float, np.ndarray, float, float, np.ndarray], float]


@njit
def _cubic(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * x**3


@njit
def _odd_square(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return size * x * abs(x)


@njit
def _drag(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * v * abs(v)


@njit
def _coulomb(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * np.tanh(v / form)


@njit
def _dahl(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    dz[0] = (v - z[0] * abs(v)) / form
    return -size * z[0]


@njit
def _square(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * x * x


@njit
def _power(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    return -size * np.sign(v) * abs(v) ** form


@njit
def _bouc_wen(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    turning = BOUC_WEN_SHAPE * (1.0 if v * z[0] > 0.0 else -1.0) + 1.0 - BOUC_WEN_SHAPE
    dz[0] = v / form * (1.0 - z[0] * z[0] * turning)
    return -size * z[0]


@njit
def _stribeck(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    at_rest = 1.0 + STRIBECK_RISE * np.exp(-((v / form) ** 2))
    dz[0] = (v - z[0] * abs(v) / at_rest) / BRISTLE
    return -size * z[0]


@njit
def _iwan(x: float, v: float, z: np.ndarray, size: float, form: float, dz: np.ndarray) -> float:
    """Sliders of one stiffness that slip at displacements spread evenly up to 2 form; `size` is their whole force."""
    total = 0.0
    for k in range(z.size):
        limit = 2.0 * form * (k + 0.5) / z.size
        total += z[k]
        dz[k] = 0.0 if abs(z[k]) >= limit and v * z[k] > 0.0 else v
    return -size * total / (z.size * form)


class Cause(NamedTuple):
    """A hidden force per unit mass.

    Attributes
    ----------
    force : of displacement, velocity, internal states, size and form
    sizes : least and greatest, drawn on a logarithmic scale, in the unit of the law: 1/(m^2 s^2) of the cubic spring,
        1/(m s^2) of those of second order, 1/m of drag, m/s^2 of friction and of the power law at 1 m/s
    form : second parameter, drawn likewise: m/s of Coulomb's and Stribeck's friction, m of Dahl's, Bouc and Wen's and
        Iwan's, exponent of the power law, otherwise idle
    accepted : effects that are the right answer
    states : number of internal states
    """

    force: Force
    sizes: tuple[float, float]
    form: tuple[float, float]
    accepted: tuple[str, ...]
    states: int = 1


CAUSES: Mapping[str, Cause] = {
    "cubic_stiffness": Cause(_cubic, (6e4, 4e5), (1.0, 1.0), ("cubic_stiffness",)),
    "softening": Cause(_odd_square, (1.5e3, 5e3), (1.0, 1.0), ("softening",)),
    "quadratic_drag": Cause(_drag, (1.5, 6.0), (1.0, 1.0), ("quadratic_drag",)),
    "coulomb_friction": Cause(_coulomb, (0.02, 0.06), (2e-3, 4e-3), ("coulomb_friction",)),
    "presliding": Cause(_dahl, (0.05, 0.15), (2e-3, 8e-3), ("presliding",)),
    "quadratic_stiffness": Cause(_square, (2e3, 4e3), (1.0, 1.0), ("quadratic_stiffness",)),
    "power_law_damping": Cause(_power, (1.0, 4.0), (2.5, 3.3), ("power_law_damping",)),
    "bouc_wen": Cause(_bouc_wen, (0.1, 0.3), (4e-3, 1e-2), ("bouc_wen",)),
    "stribeck": Cause(_stribeck, (0.03, 0.08), (0.05, 0.2), ("stribeck",)),
    "iwan": Cause(_iwan, (0.15, 0.35), (7e-3, 1.2e-2), ("iwan",), states=20),
}


@njit
def _stepped(force: Force, states: int, size: float, form: float, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Complex amplitudes (n,) of displacement by a force level cos(2 pi f t) per frequency, in their order  [m].

    points : (n, 3) frequency, level, and factor on the stiffness
    """
    mass, damping, frequencies = values[0], values[2], points[:, 0]
    y, found = np.zeros(2 + states), np.zeros(frequencies.size, dtype=np.complex128)
    for k in range(frequencies.size):
        omega = 2.0 * np.pi * frequencies[k]
        h = 2.0 * np.pi / omega / STEPS_PER_PERIOD
        level, stiffness = points[k, 1], points[k, 2] * values[1]
        left, largest = MAX_PERIODS, np.zeros(2)
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
            closed = (np.abs(y[:2] - before[:2]) < CLOSED * largest).all()
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


def record(truth: Truth, levels: Sequence[float], seed: int, laboratory: SteppedLaboratory = WHITE):
    """Response record of sweeps at these levels."""
    rng = np.random.default_rng([seed, len(levels), 23])
    cause = CAUSES[truth.cause or "cubic_stiffness"]
    ways = [(level, way) for level in levels for way in laboratory.directions]
    frequency = np.concatenate([FREQUENCIES[:: int(way)] for _, way in ways])
    level, direction = np.repeat(ways, FREQUENCIES.size, axis=0).T
    sweep = np.repeat(np.arange(float(len(ways))), FREQUENCIES.size)
    acting = laboratory.levels(level, rng)
    points = np.column_stack([frequency, acting, laboratory.stiffness(level.size, rng)])
    given = truth.size, truth.form, truth.values
    own = [_stepped(cause.force, cause.states, *given, points[sweep == one]) for one in range(len(ways))]
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
