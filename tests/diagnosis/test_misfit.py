"""Features of records beside those of the model, in standard errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.gathering import gathered
from calib.diagnosis.misfit import feature_deviations
from calib.features.phase_curve import PhaseCurve
from calib.objective import Objective, Reference, Term
from calib.records import make

FREQUENCY = 5.0  # Hz
ROWS = (("mass", "displacement"), ("mass", "velocity"))


def motion(time, jump=0.35):
    """A harmonic motion whose velocity [m/s] turns at once at phase 0.25, and its displacement [m]."""
    phase = time * FREQUENCY
    rate = 2.0 * np.pi * FREQUENCY
    saw = (phase - 0.25) % 1.0 - 0.5
    velocity = 1e-3 * rate * (np.cos(2.0 * np.pi * phase) - jump * saw)
    displacement = 1e-3 * (np.sin(2.0 * np.pi * phase) - jump * np.pi * (saw**2 - 1.0 / 12.0))
    return np.array([displacement, velocity])


def record(time, rows):
    return make(
        time, ["mass"], {"displacement": rows[:1], "velocity": rows[1:]},
        frequency=FREQUENCY, amplitude=1.0, phase=0.0, place="mass", quantity="force", source="measured",
    )  # fmt: skip


@pytest.mark.parametrize("per_period", [50.0, 61.7, 200.0])
def test_features_of_a_model_that_is_right_differ_by_their_errors(per_period):
    z = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        time = (np.arange(int(20 * per_period)) + rng.uniform()) / (per_period * FREQUENCY)
        clean = motion(time)
        noise = 0.01 * np.abs(clean).max(axis=1, keepdims=True) * rng.standard_normal(clean.shape)
        reference = Reference("tone", record(time, clean + noise))
        objective = Objective({"tone": reference}, [Term(PhaseCurve())])
        instants = np.arange(3 * 200) / (200 * FREQUENCY)
        simulated = record(instants, motion(instants))
        aligned = objective.aligned("tone", simulated)
        rows = np.array([aligned[channel].values[0] for _, channel in ROWS])
        seen = SimulatedRows(rows, aligned["trust"].values, features=tuple(objective.features("tone", simulated)))
        evidence = gathered({"tone": reference}, {"tone": ROWS}, {"tone": 1}, {"tone": seen})
        found = feature_deviations(SimpleNamespace(objective=objective), evidence.parts[0], seen, rng)
        z += [deviation.z for deviation in found if deviation.z is not None]
    assert len(z) > 20
    assert np.abs(z).max() < 4.5
    assert np.sqrt(np.mean(np.square(z))) < 1.5
