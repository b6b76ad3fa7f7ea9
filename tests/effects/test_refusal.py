"""Which effects each simulator takes, and why it does not take the others."""

import pytest
from click.testing import CliRunner

from calib import plugins
from calib.cli import main
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

EFFECTS = plugins.load_all("calib.effects")
SENSOR = {name for name, effect in EFFECTS.items() if effect.site == "sensor"}
RESPONSE = {"residual_compliance", "response_lag"}
STATES = {
    "presliding", "backlash", "extra_mode", "bouc_wen", "iwan", "stribeck", "fractional_damping", "delayed_feedback"
}  # fmt: skip
ON_A_BODY = {
    "linear_drag", "quadratic_drag", "coulomb_friction", "cubic_stiffness", "quadratic_stiffness", "softening",
    "preload", "detuning_drift", "power_law_damping", "damping_drift", "magnetic_attraction",
}  # fmt: skip
DRIVE = {"drive_harmonic_2", "drive_harmonic_3", "drive_modulation", "frequency_drift", "phase_jitter"}
LUMPED = SENSOR | RESPONSE | STATES | ON_A_BODY | DRIVE | {"added_mass", "time_step"}
IMPACT = {"gap_offset", "adhesion", "rate_restitution", "squeeze_film", "event_tolerance"}
YIELDING = {"compliant_contact", "hertz_contact"}
TAKEN = {
    "four_dof": (FourDof(), LUMPED | IMPACT | YIELDING | {"support", "glue_bond"}),
    "four_dof, fixed step": (
        FourDof(mode="fixed_step"),
        (LUMPED | IMPACT | {"support", "glue_bond"}) - {"event_tolerance"},
    ),
    "four_dof, compliant": (
        FourDof(contact="kelvin_voigt"),
        (LUMPED | IMPACT | {"support", "glue_bond"}) - {"adhesion", "rate_restitution"},
    ),
    "four_dof, both ends driven": (FourDof("symmetric"), LUMPED | IMPACT | YIELDING | {"glue_bond"}),
    "oscillator": (Oscillator(), LUMPED),
    "oscillator, stop": (Oscillator(stop=True), LUMPED | IMPACT | YIELDING),
    "delaminated_beam": (
        DelaminatedBeam(),
        SENSOR | RESPONSE | ON_A_BODY | DRIVE | {"gap_offset", "interface_shift", "contact_compliance", "time_step"},
    ),
}


@pytest.mark.parametrize("case", TAKEN)
def test_a_simulator_takes_these_effects_and_says_why_no_others(case):
    simulator, expected = TAKEN[case]
    reasons = {name: effect.refusal(simulator) for name, effect in EFFECTS.items()}
    assert {name for name, reason in reasons.items() if not reason} == expected
    refused = [reason for reason in reasons.values() if reason]
    assert len(refused) == len(EFFECTS) - len(expected) > 0
    assert all(simulator.name in reason for reason in refused)


def test_there_are_enough_to_tell_apart():
    assert len(TAKEN["four_dof"][1]) >= 40
    assert len(TAKEN["oscillator"][1]) >= 35
    assert len(SENSOR) == 13


@pytest.mark.parametrize(
    ("name", "case", "expected"),
    [
        ("support", "four_dof, both ends driven", "it acts at the support, which simulator 'four_dof' does not have"),
        ("squeeze_film", "oscillator", "it needs gap, which simulator 'oscillator' does not have"),
        ("presliding", "delaminated_beam", "simulator 'delaminated_beam' takes no force laws with internal states"),
        ("contact_compliance", "four_dof", "it acts at 'contact', but simulator 'four_dof' takes laws at"),
        ("interface_shift", "four_dof", "it changes g_max, s, which simulator 'four_dof' does not have"),
        ("glue_bond", "oscillator", "it changes layer_stiffness, which simulator 'oscillator' does not have"),
        (
            "added_mass",
            "delaminated_beam",
            "it changes layer_mass or mass, which simulator 'delaminated_beam' does not have",
        ),
        (
            "event_tolerance",
            "four_dof, fixed step",
            "it refines event_tolerance, which simulator 'four_dof' cannot refine",
        ),
    ],
)
def test_the_reason_names_what_the_simulator_lacks(name, case, expected):
    assert expected in EFFECTS[name].refusal(TAKEN[case][0])


def test_the_list_shows_what_an_effect_adds_and_what_it_is_mistaken_for():
    said = " ".join(CliRunner().invoke(main, ["list", "quadratic_drag"]).output.split())
    effect = EFFECTS["quadratic_drag"]
    assert f"equation: {effect.equation}" in said
    assert f"confused with: {', '.join(effect.confused)}" in said
    assert f"source: {' '.join(effect.cite.split())}" in said
    assert effect.cite.startswith("Worden & Tomlinson")
    assert effect.equation == "-c2 v |v|"
    assert set(effect.confused) >= {"linear_drag", "coulomb_friction"}


def test_the_list_shows_the_effects_that_a_simulator_takes():
    said = CliRunner().invoke(main, ["list", "four_dof"]).output
    line = next(line for line in said.splitlines() if line.startswith("effects: "))
    assert set(line.removeprefix("effects: ").split(", ")) == TAKEN["four_dof"][1]
