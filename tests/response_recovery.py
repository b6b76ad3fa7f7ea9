"""Calibrations on stepped sines made from hidden values, and whether the stated intervals cover these.

An oscillator with a cubic spring is driven at three levels over its resonance. The instrument reads complex amplitudes
with 2 % noise of the rms amplitude of a level; frequencies are set exactly. Or a controller holds three amplitudes, and
the complex force is read with noise of 2 %. The motions are those of the simulator that
is calibrated: what is asked is whether intervals hold; `dynamics/test_swept_response.py` compares with another code.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from calib.confidence import around_best
from calib.dynamics.swept_response import swept_response
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.execution.pool import InProcess
from calib.features.frequency_response import ResponseDistance
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.objective import Objective, Reference, Term
from calib.objective.stable_stretches import read_at
from calib.optimisers.multistart import Multistart
from calib.records.excitation import Excitation
from calib.records.held_response import at_one_level
from calib.records.response import make_response
from calib.simulators.oscillator import Oscillator
from calib.store import Store
from calib.study import CalibrationStudy, evaluate

FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0)
LEVELS = 0.15, 0.3, 0.6  # N
AMPLITUDES = 4e-3, 10e-3, 20e-3  # m; at the last two, motions are unstable at a set force
FREQUENCIES = np.linspace(2.7, 4.3, 17)  # Hz
NOISE = 0.02  # of the rms amplitude of a level, in each part
FINE = 8  # steps of the sweep that makes a record, for each of its own
WINDOWS = {
    "stiffness": Window(340.0, 460.0),
    "damping": Window(0.4, 2.5, "log"),
    "k3": Window(1e5, 1e6, "log"),
}
FIXED = {"mass": 1.0}
BUDGET = 120  # simulations of a search


def model() -> Model:
    return Model(Oscillator(), [CUBIC_STIFFNESS])


def stepped(values: dict[str, float], rng: np.random.Generator, directions: tuple[float, ...] = (1.0,)) -> xr.Dataset:
    """Record of stepped sines up (1.0) and down (-1.0), of points on the branch that the sweep is on."""
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("frequency", "amplitude", "level", "direction")}
    for level in LEVELS:
        for direction in directions:
            steps = FREQUENCIES[:: int(direction)]
            fine = np.interp(np.arange(FINE * (steps.size - 1) + 1) / FINE, np.arange(steps.size), steps)
            wanted = make_response(fine, ["mass"], np.ones((1, fine.size)), level, "N", 0, direction)
            motion = swept_response(model(), values, FORCE, wanted)
            rows["frequency"].append(steps)
            wanted = make_response(steps, ["mass"], np.ones((1, steps.size)), level, "N", 0, direction)
            rows["amplitude"].append(read_at(motion, wanted)[0])
            rows["level"].append(np.full(steps.size, level))
            rows["direction"].append(np.full(steps.size, direction))
    frequency, amplitude, level, direction = (np.concatenate(parts) for parts in rows.values())
    for own in LEVELS:
        at = level == own
        sigma = NOISE * np.sqrt(np.mean(np.abs(amplitude[at]) ** 2))
        amplitude[at] += sigma * (rng.standard_normal((2, at.sum())).T @ [1.0, 1j])
    sweep = np.repeat(np.arange(len(LEVELS) * len(directions)), FREQUENCIES.size)
    return make_response(
        frequency, ["mass"], amplitude[None], level, "N", sweep, direction, place="mass", quantity="force"
    )


def held(values: dict[str, float], rng: np.random.Generator) -> xr.Dataset:
    """Record whose controller held each of `AMPLITUDES`."""
    shape, receptances = (1, FREQUENCIES.size), []
    for amplitude in AMPLITUDES:
        wanted = at_one_level(make_response(FREQUENCIES, ["mass"], np.full(shape, amplitude), 1.0, "N"), "mass")
        receptances.append(read_at(swept_response(model(), values, FORCE, wanted), wanted)[0])
    receptance = np.concatenate(receptances)
    receptance *= 1.0 + NOISE * (rng.standard_normal((2, receptance.size)).T @ [1.0, 1j])
    sweep, size = (np.repeat(own, FREQUENCIES.size) for own in (np.arange(len(AMPLITUDES)), AMPLITUDES))
    record = make_response(
        np.tile(FREQUENCIES, len(AMPLITUDES)), ["mass"], size * np.exp(1j * np.angle(receptance))[None],
        size / np.abs(receptance), "N", sweep, sigma=NOISE * size[None], place="mass", quantity="force",
    )  # fmt: skip
    return at_one_level(record, "mass")


def recovered(seed: int, record_of: Callable[[dict[str, float], np.random.Generator], xr.Dataset], folder: Path):
    """Truth, and confidence at the best point of a blind calibration."""
    rng = np.random.default_rng([seed, 22])
    space = Space(WINDOWS, FIXED)
    truth = space.values(rng.uniform(0.2, 0.8, space.dim))
    reference = Reference("stepped", record_of(truth, rng), excitation=FORCE)
    study = CalibrationStudy(
        name="recovery",
        model=model(),
        space=space,
        objective=Objective({"stepped": reference}, [Term(ResponseDistance())]),
        optimiser=Multistart,
        budget=BUDGET,
        seed=seed,
    )
    pool = InProcess(partial(evaluate, study.without_search()))
    found = study.run(Store(folder, view=None, keep="best"), pool)
    return truth, around_best(study, pool, found.best)
