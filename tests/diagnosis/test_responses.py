"""Diagnosis of frequency responses: forces hidden in stepped sines by another integrator."""

import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from hidden.stepped import MASS, drawn, record, written
from hidden.stepped_laboratory import WHITE, SteppedLaboratory
from hidden.stepped_laws import CAUSES

from calib.cli import main as calib
from calib.diagnosis.artifacts import read_motions
from calib.records.response import complex_amplitude, with_amplitude
from calib.workflows.rehearse import rehearse_study

DAMPINGS, STIFFNESSES = ("quadratic_drag", "coulomb_friction"), ("cubic_stiffness", "softening")
BOTH_WAYS = (1.0, -1.0)


def diagnosed(cause, seed, folder, laboratory=WHITE, candidates=(*DAMPINGS, *STIFFNESSES), change=None):
    """What a diagnosis says of a hidden cause and of a change of the records, and what was hidden."""
    truth = drawn(cause, seed)
    written(truth, seed, folder, laboratory)
    for name in ("levels", "between") if change else ():
        with xr.open_dataset(folder / f"{name}.nc") as stored:
            response = stored.load()
        with_amplitude(response, change(response)).to_netcdf(folder / f"{name}.nc")
    study = folder / "study.toml"
    study.write_text(study.read_text() + f"\n[diagnosis]\ncandidates = {json.dumps(candidates)}\n")
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(folder), "--quiet", "--jobs", "1"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    return truth, json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.mark.slow
def test_a_linear_oscillator_of_another_integrator_is_its_transfer_function():
    truth = drawn(None, 3)
    measured = record(truth, (0.25,), 3)
    omega = 2.0 * np.pi * measured.frequency.values
    _, stiffness, damping = truth.values
    expected = 0.25 / (stiffness - MASS * omega**2 + 1j * damping * omega)
    found = measured.in_phase[0].values + 1j * measured.quadrature[0].values
    assert np.sqrt(np.mean(np.abs(found - expected) ** 2)) == pytest.approx(
        0.02 * np.sqrt(2.0 * np.mean(np.abs(expected) ** 2)), rel=0.4
    )


@pytest.mark.slow
def test_drag_is_named_with_its_size_and_the_gain_on_a_level_held_out(tmp_path):
    truth, said = diagnosed("quadratic_drag", 1, tmp_path)
    assert said["verdict"] == "named"
    assert said["causes"] == ["quadratic_drag"]
    [drag] = [one for one in said["suspects"] if one["effect"] == "quadratic_drag"]
    low, high = drag["interval"]["c2"]
    assert abs(drag["size"]["c2"] - truth.size) < 0.75 * (high - low)  # 3 standard errors
    shares = {one["effect"]: one["share"] for one in said["suspects"]}  # by the noise of the extended model
    assert shares["quadratic_drag"] == pytest.approx(said["misfit"]["share"], abs=0.01)
    assert max(shares.values()) < 1.01
    gain = said["gain"]
    assert gain["records"] == ["between"]
    assert gain["after"] < 0.7 * gain["before"]
    motion = read_motions(tmp_path / "out")["levels"]
    assert motion.sizes["time"] == motion.frequency.size == 72
    left = (motion.measured - motion.extended) / motion.sigma
    assert float((left**2).mean()) == pytest.approx(1.0, abs=0.35)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Distance of each measured point from the simulated curve of its sweep" in page
    [levels] = said["levels"]
    trend = levels["damping"]
    assert trend["significant"]
    assert not levels["resonance"]["significant"]
    assert abs(trend["models"]["extended"] - trend["power"]) < 3.0 * trend["error"] < trend["power"]
    assert abs(trend["models"]["calibrated"]) < 0.01
    powers = {law["effect"]: law["damping_power"] for law in levels["laws"]}
    assert powers["quadratic_drag"] == pytest.approx(1.0, abs=0.01)
    assert powers["coulomb_friction"] == pytest.approx(-1.0, abs=0.05)
    assert "the equivalent damping of mass grows with the amplitude" in page
    assert "not so coulomb_friction" in page


def other_modes(response):
    """Complex amplitudes with a body of 0.8 kg as a whole and a mode at 40 Hz: -2.93e-3 m/N at resonance  [m]."""
    omega = 2.0 * np.pi * response.frequency.values
    beyond = -1.0 / (0.8 * omega**2) + 1.0 / (0.1 * ((80.0 * np.pi) ** 2 - omega**2))
    return complex_amplitude(response) + beyond * response.level.values


def late(response):
    """Complex amplitudes read 5 ms late  [m]."""
    return np.exp(-0.01j * np.pi * response.frequency.values) * complex_amplitude(response)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "cause", "size"), [(other_modes, "residual_compliance", -2.93e-3), (late, "response_lag", 5e-3)]
)
def test_what_a_measurement_adds_to_one_mode_is_named(tmp_path, change, cause, size):
    candidates = (*DAMPINGS, *STIFFNESSES, "residual_compliance", "response_lag")
    _, said = diagnosed(None, 4, tmp_path, candidates=candidates, change=change)
    assert said["verdict"] == "named"
    assert said["causes"] == [cause]
    [own] = [one for one in said["suspects"] if one["effect"] == cause]
    assert own["size"][cause] == pytest.approx(size, rel=0.15)
    assert said["gain"]["after"] < 0.5 * said["gain"]["before"]


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden(tmp_path):
    _, said = diagnosed(None, 100, tmp_path)
    assert said["verdict"] == "none"
    [levels] = said["levels"]
    assert not levels["damping"]["significant"]
    assert not levels["resonance"]["significant"]


@pytest.mark.slow
@pytest.mark.parametrize("cause", ["coulomb_friction", "softening"])
def test_a_hidden_force_is_in_the_reported_class(tmp_path, cause):
    _, said = diagnosed(cause, 1, tmp_path)
    assert said["verdict"] in ("named", "one_of")
    assert any(name in CAUSES[cause].accepted for names in said["class"] for name in names)
    [levels] = said["levels"]
    trend = levels["damping" if cause == "coulomb_friction" else "resonance"]
    assert trend["significant"]
    assert trend.get("power", trend.get("change")) < 0.0


@pytest.mark.slow
def test_friction_with_a_stiffness_is_not_taken_for_a_law_that_contains_it(tmp_path):
    truth, said = diagnosed("presliding", 71, tmp_path, candidates=("presliding", "bouc_wen"))
    assert said["causes"] == ["presliding"]
    [own] = [one for one in said["suspects"] if one["effect"] == "presliding"]
    assert own["size"]["dahl_force"] == pytest.approx(truth.size, rel=0.1)


@pytest.mark.slow
def test_a_power_of_the_velocity_is_not_taken_for_its_square_and_a_further_cause(tmp_path):
    """Beside quadratic drag something remains, which dry friction would explain; the exponent alone does both."""
    candidates = ("quadratic_drag", "power_law_damping", "coulomb_friction")
    truth, said = diagnosed("power_law_damping", 300, tmp_path, candidates=candidates)
    assert said["causes"] == ["power_law_damping"]
    assert said["parameters"]["power_exponent"]["after"] == pytest.approx(truth.form, abs=0.4)
    [own] = [one for one in said["suspects"] if one["effect"] == "power_law_damping"]
    assert own["held"]["power_exponent"] == pytest.approx(said["parameters"]["power_exponent"]["after"], rel=1e-3)
    assert 0.98 < own["share"] < 1.02
    assert said["misfit"]["left"] < 2.0 * said["misfit"]["blur"]


@pytest.mark.slow
def test_a_spring_whose_sign_makes_no_difference_is_tried(tmp_path):
    """Its derivative is zero in a linear oscillator: it was taken to change nothing."""
    _, said = diagnosed("quadratic_stiffness", 800, tmp_path, candidates=("cubic_stiffness", "quadratic_stiffness"))
    assert ["quadratic_stiffness"] in said["class"]


@pytest.mark.slow
def test_nothing_is_found_where_the_level_wanders_untold(tmp_path):
    _, said = diagnosed(None, 53, tmp_path, SteppedLaboratory.drawn("level", 53))
    assert said["verdict"] == "none"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "others"),
    [("coulomb_friction", STIFFNESSES), ("softening", DAMPINGS)],
)
def test_a_force_unlike_every_candidate_is_no_noise_where_each_sweep_is_repeated(tmp_path, cause, others):
    _, said = diagnosed(cause, 1, tmp_path, WHITE._replace(directions=BOTH_WAYS), others)
    assert said["verdict"] == "unexplained"
    [noise] = [gate["said"] for gate in said["gates"] if gate["name"] == "noise"]
    assert "sweep to sweep" in noise


@pytest.mark.slow
def test_damping_that_differs_from_level_to_level_is_no_noise(tmp_path):
    _, said = diagnosed("quadratic_drag", 1, tmp_path, candidates=STIFFNESSES)
    assert said["verdict"] == "unexplained"


@pytest.mark.slow
def test_nothing_is_found_in_sweeps_both_ways_where_nothing_is_hidden(tmp_path):
    _, said = diagnosed(None, 53, tmp_path, WHITE._replace(directions=BOTH_WAYS))
    assert said["verdict"] == "none"


@pytest.mark.slow
def test_a_rehearsal_of_sweeps_says_what_they_would_name(tmp_path):
    diagnosed(None, 1, tmp_path, candidates=("quadratic_drag",))
    played = rehearse_study(tmp_path, strengths=(0.3, 30.0), seeds=1, jobs=2)
    none, other, weak, strong = sorted(played, key=lambda one: (one.case.strength, one.case.seed))
    assert (none.verdict, other.verdict) == ("none", "none")
    assert not weak.causes
    assert strong.causes == ("quadratic_drag",)
    assert len((tmp_path / "out" / "rehearsal.jsonl").read_text().splitlines()) == 1 + 4  # what they belong to


@pytest.mark.slow
def test_the_level_that_would_distinguish_two_springs_is_told_and_does(tmp_path):
    truth, few = drawn("cubic_stiffness", 3), (0.09, 0.1)
    bench = (
        '[diagnosis]\ncandidates = ["cubic_stiffness", "softening"]\n[diagnosis.bench]\namplitude = ["50 mN", "0.4 N"]'
    )
    said = of_levels(truth, few, tmp_path / "few", bench)
    assert {name for names in said["class"] for name in names} == {"cubic_stiffness", "softening"}
    [best] = said["measurements"]
    assert (best["kind"], best["distinguished"], best["confirmed"]) == ("stepped sine", 1, True)
    assert 0.1 < best["amplitude"] <= 0.4
    z = {round(point["amplitude"], 3): point["z"] for point in said["design"]["points"]}
    assert z[0.05] < 3.0 < best["z"]
    assert "stepped sine of" in (tmp_path / "few" / "out" / "report.html").read_text()
    assert of_levels(truth, (*few, best["amplitude"]), tmp_path / "more", bench)["causes"] == ["cubic_stiffness"]


def of_levels(truth, levels, folder, asked):
    """Diagnosis of sweeps at these levels, with what a study asks of it."""
    folder.mkdir()
    written(truth, 3, folder)
    record(truth, levels, 3).to_netcdf(folder / "levels.nc")
    study = folder / "study.toml"
    study.write_text(f"{study.read_text()}\n{asked}\n")
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(folder), "--quiet", "--jobs", "1"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    return json.loads((folder / "out" / "diagnosis.json").read_text())
