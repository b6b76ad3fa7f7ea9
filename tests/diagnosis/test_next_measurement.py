"""Measurements that were not made: what they would tell, and which motions tell nothing."""

import numpy as np
import pytest

from calib.diagnosis.bench import Bench, Run
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.laboratory import Laboratory
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term, trusted
from calib.plugins import load
from calib.records.excitation import Excitation
from calib.study import CalibrationStudy

FOUR_DOF = Model(load("calib.simulators", "four_dof")())
OSCILLATOR = Model(load("calib.simulators", "oscillator")())
SHAKEN = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
CURVE = Term(load("calib.features", "phase_curve")())


@pytest.fixture(scope="module")
def clapping():
    """A period-1 motion with one impact a period."""
    return FOUR_DOF.run({"restitution": 0.05}, SHAKEN, Request())


@pytest.mark.parametrize(("restitution", "regular"), [(0.05, True), (0.5, False)])
def test_of_a_measurement_that_was_not_made_an_irregular_motion_is_told(clapping, restitution, regular):
    objective = Objective({"clapping": Reference("clapping", clapping, excitation=SHAKEN)}, [CURVE])
    bench = Bench(FOUR_DOF, objective, {"clapping": [("q3", "velocity")]})
    seen = bench(Run("clapping", {"restitution": restitution}, excitation=SHAKEN))
    assert seen.usable
    assert (seen.wrong == "") == regular


def test_a_simulated_velocity_is_not_trusted_next_to_its_impacts(clapping):
    time, trust = clapping.time.values, trusted(clapping)
    apart = np.abs(time - clapping.impact_time.values[:, None]).min(axis=0) / (time[1] - time[0])
    assert clapping.sizes["impact"] == 6
    assert (trust[apart < 2.0] == 0.0).all()
    assert (trust[apart > 3.0] == 1.0).all()


@pytest.mark.slow
def test_beside_a_record_sampled_in_another_way_than_a_simulation_measurements_are_proposed():
    drive = Excitation("mass", "force", frequency=9.0, amplitude=6.0)
    truth = {"mass": 1.0, "damping": 2.0, "stiffness": 4000.0}
    hidden = OSCILLATOR.extended(load("calib.effects", "preload"))
    record = hidden.run({**truth, "preload": 0.5}, drive, Request(periods=5, samples=300))
    rng = np.random.default_rng(0)
    for channel in ("displacement", "velocity"):
        rows = record[channel].values
        record[channel] = record[channel].copy(data=rows + 0.01 * rows.std() * rng.standard_normal(rows.shape))
    kept = record[["displacement", "velocity"]].assign_attrs(record.attrs)
    reference = Reference("tone", kept, "calibrate", excitation=drive, nuisance=("trigger",))
    space = Space({"damping": Window(0.5, 8.0), "stiffness": Window(3000.0, 5000.0)}, {"mass": 1.0})
    study = CalibrationStudy("small", OSCILLATOR, space, Objective({"tone": reference}, [CURVE]), None, 9)
    effects = [load("calib.effects", name) for name in ("preload", "channel_offset", "cubic_stiffness")]
    few = Laboratory(simulations=250)
    found = diagnose(study, {}, {**OSCILLATOR.nominal, **truth}, effects, seed=3, pool=InProcess, laboratory=few)
    assert set(found.classes) == {("preload",), ("channel_offset",)}
    assert {m.kind for m in found.design.measurements} >= {"steady tone", "free decay"}
    assert found.design.simulations <= found.design.max_simulations
