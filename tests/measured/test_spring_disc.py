"""A disc on a spring, let go: initial states and the sensor's zero belong to each run."""

from functools import partial
from pathlib import Path

import pytest
import tomlkit

from calib.diagnosis.diagnose import diagnose
from calib.execution.pool import InProcess
from calib.store import Store
from calib.study import evaluate
from calib.study_file import load

FORCES_AND_DRIFTS = [
    "linear_drag", "quadratic_drag", "coulomb_friction", "quadratic_stiffness", "cubic_stiffness", "softening",
    "detuning_drift", "channel_drift",
]  # fmt: skip
STUDY = Path(__file__).parents[2] / "studies" / "spring_disc" / "study.toml"


@pytest.fixture(scope="module")
def file(measured):
    for number in range(1, 5):
        measured(f"spring_disc/run{number}.csv")
    return load(STUDY)


@pytest.fixture(scope="module")
def best(file, tmp_path_factory):
    return searched(file.study, tmp_path_factory.mktemp("disc"))


def searched(study, folder):
    """Best trial of a study's search, in this process."""
    return study.run(Store(folder), InProcess(partial(evaluate, study.without_search()))).best


def test_stiffness_and_damping_are_all_that_is_searched(best):
    assert best.values["stiffness"] == pytest.approx(14.371, abs=0.003)
    assert best.values["damping"] == pytest.approx(0.01123, rel=0.01)
    assert best.simulations == 4


@pytest.mark.parametrize("name", ["run1", "run2", "run3"])
def test_the_zero_of_the_sensor_is_the_same_in_the_runs_at_large_amplitude(file, best, name):
    objective = file.study.objective.on({name: file.reference(name)})
    solved = objective({name: objective.released(name, file.study.model, best.values).record}).nuisances[name]
    assert solved["offset.mass"] == pytest.approx(0.417, abs=0.0003)
    speed = solved["initial_velocity"] / (best.values["stiffness"] / best.values["mass"]) ** 0.5
    assert (solved["initial_displacement"] ** 2 + speed**2) ** 0.5 == pytest.approx(0.07, rel=0.2)


@pytest.mark.slow
def test_drag_and_softening_are_named_and_cubic_and_drift_are_not(file, tmp_path):
    """Without the second run at large amplitude: one at large, one at small amplitude and the one held out show it.

    Of the study's candidates those are tried that depend on the motion of the mass, and what drifts.
    """
    document = tomlkit.parse(STUDY.read_text())
    document["record"] = [record for record in document["record"] if record["name"] != "run2"]
    document["diagnosis"]["candidates"] = FORCES_AND_DRIFTS
    (tmp_path / "study.toml").write_text(tomlkit.dumps(document))
    file = load(tmp_path / "study.toml")
    study = file.study
    values = {**study.space.fixed, **searched(study, tmp_path / "out").values}
    found = diagnose(study, file.others, values, file.suspects(), seed=study.seed, pool=InProcess)
    assert found.verdict == "named"
    assert set(found.causes) == {"quadratic_drag", "softening"}
    predictions = [r.prediction for r in found.selection.rounds if r.chosen is not None]
    assert predictions
    assert all(prediction.reduction > prediction.error for prediction in predictions)
    assert found.selection.explained_share > 0.9
    assert found.selection.final.value("c2") == pytest.approx(0.140, abs=0.02)  # 0.134 to 0.146 by another programme
    assert found.selection.final.value("kx") == pytest.approx(-13.9, abs=2.0)
    assert found.gain.proven
