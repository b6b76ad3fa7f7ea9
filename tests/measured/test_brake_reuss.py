"""Forced responses of a jointed beam: a linear mode is wrong in its damping; laws are told by the force they need."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from calib.diagnosis.bench import Bench
from calib.diagnosis.discovery.place import force_places, visited_regions
from calib.diagnosis.evidence import pairs_compared
from calib.dynamics.swept_response import swept_response
from calib.execution.pool import InProcess
from calib.records.held_response import as_measured
from calib.records.replicates import levels_of_sweeps
from calib.records.response import complex_amplitude, sweeps
from calib.study_file import load

STUDY = Path(__file__).parents[2] / "studies" / "brake_reuss" / "study.toml"
LINEAR = {"mass": 2.009253, "stiffness": 511439.2, "damping": 4.215311}  # of `calib run`


@pytest.fixture(scope="module")
def file(measured):
    measured("brake_reuss/ForcedFrequencyResponses.mat")
    return load(STUDY)


@pytest.fixture(scope="module")
def forced():
    """Return the script of the study."""
    spec = importlib.util.spec_from_file_location("brake_reuss_forced", STUDY.parent / "forced.py")
    module = sys.modules["brake_reuss_forced"] = importlib.util.module_from_spec(spec)  # dataclasses look it up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def levels(file, forced):
    return {name: list(forced.levels(file.reference(name).record, name)) for name in forced.RECORDS}


def test_the_accelerations_that_were_held_are_displacements(file):
    record = as_measured(file.reference("held").record)
    assert [number for number, _ in sweeps(record)] == [1.0, 2.0, 4.0, 6.0, 8.0]
    held = np.abs(complex_amplitude(record)[0]) * (2.0 * np.pi * record.frequency.values) ** 2
    medians = [np.median(held[points]) for _, points in sweeps(record)]
    np.testing.assert_allclose(medians, [5.0, 20.0, 40.0, 60.0, 80.0], rtol=0.01)
    resonant = np.argmin(np.abs(np.angle(complex_amplitude(record)[0]) + 0.5 * np.pi))
    assert record.frequency.values[resonant] == pytest.approx(80.3, abs=0.3)


def test_the_damping_of_a_linear_mode_rises_more_than_fourfold_over_the_levels(forced, levels):
    damping = [forced.damping_alone(level) for level in levels["held"]]
    assert damping == sorted(damping)
    assert damping == pytest.approx([3.21, 3.93, 6.49, 10.75, 14.21], rel=0.02)


@pytest.mark.slow
def test_a_power_law_with_a_spring_that_softens_and_hardens_predicts_the_levels_between(forced, levels):
    fit = forced.fitted(["power_law_damping", "softening", "cubic_stiffness"], levels["held"])
    assert fit.values["power_exponent"] == pytest.approx(2.63, abs=0.03)
    errors = [fit.error(level) for name in ("between", "driven") for level in levels[name]]
    assert errors == pytest.approx([0.086, 0.129, 0.120, 0.214, 0.123, 0.085, 0.090], abs=0.005)
    linear = forced.fitted([], levels["held"])
    assert linear.error(levels["between"][2]) > 0.25


def test_the_set_forces_disagree_with_the_held_accelerations_before_any_model(forced, levels):
    """What no law of the amplitude can do better: the curves themselves, interpolated between the levels."""
    errors = [forced.interpolated(level, levels["held"]) for level in levels["driven"]]
    assert errors == pytest.approx([0.173, 0.092, 0.069, 0.084], abs=0.005)
    assert max(forced.interpolated(level, levels["held"]) for level in levels["between"]) < 0.08


def test_with_the_residual_of_other_modes_all_held_levels_are_predicted_within_10_percent(forced, levels):
    laws = ("power_law_damping", "softening", "cubic_stiffness", "residual_compliance")
    fit = forced.fitted(laws, levels["held"])
    assert fit.values["residual_compliance"] == pytest.approx(-6.1e-6, rel=0.05)
    between, driven = ([fit.error(level) for level in levels[name]] for name in ("between", "driven"))
    assert max(between) < 0.1
    assert between == pytest.approx([0.057, 0.095, 0.064], abs=0.01)
    assert driven == pytest.approx([0.181, 0.097, 0.070, 0.066], abs=0.01)
    assert fit.error_together(levels["between"] + levels["driven"]) == pytest.approx(0.074, abs=0.002)


def test_the_weakest_set_force_is_predicted_once_its_resonance_is_that_of_its_test(forced, levels):
    """Two tests at 20 m/s^2, of a set force and at constant response, resonate a thousandth apart."""
    own, other = levels["driven"][0], levels["held"][1]
    assert (own.resonance, other.resonance) == pytest.approx((80.270, 80.183), abs=0.002)
    fit = forced.fitted(("power_law_damping", "softening", "cubic_stiffness", "residual_compliance"), levels["held"])
    assert fit.error(own) > 0.17
    assert fit.error(own, own.resonance - other.resonance) == pytest.approx(0.060, abs=0.005)


def test_the_loss_on_the_sides_of_the_resonance_is_one_once_that_residual_is_taken_off(levels):
    weakest = levels["held"][0]  # 5 m/s^2, where the joint is nearly linear
    omega = 2.0 * np.pi * weakest.frequency
    for residual, least in ((0.0, 0.4), (-7e-6, 0.0)):
        loss = (weakest.force / (weakest.displacement - residual * weakest.force)).imag / omega
        below, above = loss[:5].mean(), loss[-5:].mean()
        assert least < below / above - 1.0 < least + 0.15


def test_a_search_for_the_missing_force_is_one_for_odd_functions_over_the_measured_ellipses(file):
    """Motions of the linear mode are half-wave symmetric: of a force only its describing function is seen."""
    study = file.study
    bench = Bench(study.model, study.objective, pairs_compared(study.objective))
    [place] = force_places(study.model.simulator)
    with InProcess(bench) as pool:
        region = visited_regions(pool, bench, study.objective.references, LINEAR, [place])["mass"]
    assert region.half_wave_symmetric
    assert np.abs(region.ends["displacement"]) == pytest.approx(80.0 / (2.0 * np.pi * 80.3) ** 2, rel=0.05)
    assert np.abs(region.ends["velocity"]) == pytest.approx(80.0 / (2.0 * np.pi * 80.3), rel=0.03)
    held = study.objective.references["held"].record
    assert np.unique(levels_of_sweeps(held)).size == 5


@pytest.mark.slow
def test_the_extended_study_predicts_what_was_held_out(file, forced):
    extended = load(STUDY.with_name("study.joint.toml"))
    for own, values, expected in (
        (file, LINEAR, {"held": 0.2167, "between": 0.2108, "driven": 0.2529}),
        (extended, forced.CALIBRATED, {"held": 0.0142, "between": 0.0152, "driven": 0.0284}),
    ):
        for name, distance in expected.items():
            reference = own.reference(name)
            simulated = swept_response(own.study.model, values, reference.excitation, reference.record)
            cost = own.study.objective.on({name: reference})({name: simulated}).cost
            assert cost == pytest.approx(distance, abs=0.002)
