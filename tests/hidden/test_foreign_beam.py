"""The other code's beam: its elements and steps converge, and it differs from the seeker's by a tenth of the motion."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hidden import foreign_beam
from hidden.beam import FOREIGN_SUPPORT, LOWEST, PLANS, TRUTH, system
from hidden.foreign_beam import Section, element
from hidden.hider import hide
from scipy.linalg import eigh

from calib.cli import main
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam

RECORDS = [plan for plan in PLANS if plan.name != "quicker"]
CANDIDATES = ("quadratic_drag", "cubic_stiffness", "interface_shift", "channel_gain")
DRAG = 200.0  # 1/m: changes the layer's motion by a quarter
NOISE = 0.005  # over each channel's rms
pytestmark = pytest.mark.usefixtures("without_pictures")


@pytest.fixture(scope="module")
def clapping():
    """Motion of the other code."""
    plant = foreign_beam.plant(TRUTH, FOREIGN_SUPPORT)
    return foreign_beam.settled(plant, PLANS[0].frequency, PLANS[0].amplitude)


def distance(displacement, velocity, reference):
    """Root mean square difference from a phase curve, each channel over its standard deviation  [1]."""
    channels = zip((displacement, velocity), reference, strict=True)
    return np.sqrt(np.mean([np.mean((one - other) ** 2) / np.var(other) for one, other in channels]))


def errors_on_two_supports(thickness: float, count: int) -> np.ndarray:
    """Errors (2,) of the squares of the lowest frequencies of a beam of 1 m, relative to Timoshenko's equation.

    E I k^4 - rho (A + I k^2 (1 + E / kappa G)) w^2 + rho^2 I / (kappa G) w^4 = 0, k = n pi / L
    """
    young, density = 70e9, 2700.0
    section = Section(thickness, 0.04, young, 0.3, density)
    stiffness, mass = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for i in range(count):
        own = np.s_[2 * i : 2 * i + 4, 2 * i : 2 * i + 4]
        k, m, _ = element(section, 1.0 / count)
        stiffness[own] += k
        mass[own] += m
    free = np.setdiff1d(np.arange(2 * count + 2), [0, 2 * count])
    squares = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], eigvals_only=True, subset_by_index=(0, 1))
    shear, theory = 5.0 / 6.0 * young / 2.6, []
    for k in (np.pi, 2.0 * np.pi):
        linear = section.area + section.inertia * k**2 * (1.0 + young / shear)
        powers = density**2 * section.inertia / shear, -density * linear, young * section.inertia * k**4
        theory.append(np.roots(powers).min())
    return squares / theory - 1.0


def test_its_elements_converge_to_timoshenkos_equation_with_order_two():
    coarse, fine = (errors_on_two_supports(0.2, count) for count in (20, 40))
    assert fine.max() < 1e-3
    assert coarse / fine == pytest.approx(4.0, rel=0.05)


def test_its_elements_do_not_lock_where_they_are_thin():
    assert abs(errors_on_two_supports(1e-3, 20)).max() < 1e-4


@pytest.mark.slow
def test_half_the_step_changes_its_motion_by_less_than_a_thousandth(clapping):
    plant = foreign_beam.plant(TRUTH, FOREIGN_SUPPORT)
    finer = foreign_beam.settled(plant, PLANS[0].frequency, PLANS[0].amplitude, steps=2 * foreign_beam.STEPS)
    reference = finer.displacement[1, ::2], finer.velocity[1, ::2]
    assert distance(clapping.displacement[1], clapping.velocity[1], reference) < 1e-3


def test_the_layer_is_pressed_once_a_period_and_never_pulled(clapping):
    pressed = clapping.pressed > 0.0
    assert (np.diff(pressed.astype(int)) > 0).sum() >= 1
    assert 0.01 < pressed.mean() < 0.2
    assert clapping.pressed.min() >= 0.0


@pytest.mark.slow
def test_at_the_same_values_it_differs_from_the_model_of_the_seeker_by_a_tenth_of_the_motion():
    shares = []
    for plan in PLANS:
        excitation = Excitation("centre", "displacement", frequency=plan.frequency, amplitude=plan.amplitude)
        record = Model(DelaminatedBeam(**LOWEST)).run(TRUTH, excitation, Request(periods=1, samples=400))
        other = system(foreign=True)
        place, speed = other.moved(plan, other.truth, {}).look(record.time.values)
        rows = record.displacement.values[1], record.velocity.values[1]
        shares.append(distance(place[1], speed[1], rows))
    assert min(shares) > 0.05
    assert max(shares) < 0.25


def diagnosed(effect: str | None, folder: Path, cache: Path) -> dict:
    """Document of a diagnosis of the other code's records."""
    hide(
        "delaminated_beam", effect, None, 0, NOISE, folder=folder, cache=cache, size=DRAG,
        foreign=True, plans=RECORDS, options=LOWEST,
    )  # fmt: skip
    study = folder / "study.toml"
    text = study.read_text().replace("seed = 1\n", "seed = 1\njobs = 1\n")
    study.write_text(f"{text}\n[diagnosis]\ncandidates = {json.dumps(CANDIDATES)}\n")
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(main, [command, str(folder), "-q"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    return json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("clean")


@pytest.mark.slow
def test_a_leader_that_explains_most_of_another_codes_records_is_named_or_told_with_what_hinders(cache, tmp_path):
    found = diagnosed("quadratic_drag", tmp_path, cache)
    named = found["verdict"] in ("named", "one_of") and ["quadratic_drag"] in found["class"]
    hindered = found["verdict"] not in ("named", "one_of") and "quadratic_drag" in found["said"]
    assert named or hindered, found["said"]
    leader = max(found["suspects"], key=lambda suspect: suspect["share"])
    assert leader["effect"] == "quadratic_drag"
    assert leader["share"] > 0.5
    assert leader["size"]["c2"] == pytest.approx(DRAG, rel=0.2)


@pytest.mark.slow
def test_nothing_that_explains_less_than_most_is_named_where_only_the_code_is_another(cache, tmp_path):
    found = diagnosed(None, tmp_path, cache)
    assert found["verdict"] in ("unexplained", "not_diagnosable"), found["said"]
    assert found["causes"] == []
    assert found["remains"]["share"] > 1.0 / 3.0
