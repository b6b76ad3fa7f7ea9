"""Harmonic balance: its equations, and its responses against closed forms, shooting and the grazing of a stop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.harmonic_response import balanced_response
from calib.dynamics.orbits import shoot
from calib.dynamics.response import frequency_response, harmonics_of_cycle
from calib.dynamics.response_dataset import response_dataset
from calib.dynamics.setting import Setting
from calib.dynamics.swept_response import swept_response
from calib.effects.coulomb_friction import EFFECT as COULOMB_FRICTION
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.effects.drive_harmonic_2 import EFFECT as DRIVE_HARMONIC_2
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.plugins import load
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, make_response
from calib.simulators.four_dof.four_dof import FourDof
from calib.simulators.oscillator.oscillator import Oscillator

MASS, DAMPING, STIFFNESS = 1.0, 1.0, 400.0  # kg, N s/m, N/m
VALUES = {"mass": MASS, "damping": DAMPING, "stiffness": STIFFNESS}
FORCE = Excitation("mass", "force", frequency=3.0, amplitude=1.0, phase=0.4)
SHAKER = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)


def setting(*effects, phase=0.0, excitation=FORCE, options=(), **values):
    return Setting(Model(Oscillator(**dict(options)), effects), excitation, {**VALUES, **values}, phase=phase)


def duffing(**values):
    return setting(CUBIC_STIFFNESS, k3=4e5, **values)


def folds(response):
    return np.array([p.parameter for one in response.branches for p in one.branch.points if p.kind == "fold"])


# forces with internal states, large enough to change the motion by tenths; m/s^2, m, Hz, 1/s^2
WITH_STATES = {
    "presliding": {"dahl_force": 0.3, "dahl_distance": 2e-3},
    "bouc_wen": {"hysteresis_force": 0.3, "hysteresis_distance": 3e-3},
    "iwan": {"iwan_force": 0.3, "iwan_distance": 8e-3},
    "stribeck": {"stribeck_force": 0.2, "stribeck_distance": 1e-3, "stribeck_speed": 0.05},
    "extra_mode": {"mode_mass": 0.05, "mode_frequency": 3.4, "mode_damping": 0.05},
    "fractional_damping": {"fractional_stiffness": 20.0, "fractional_frequency": 3.0},
    "backlash": {"backlash_stiffness": 60.0, "backlash_width": 3e-3, "backlash_force": 5.0},
}


def with_states(name):
    return setting(load("calib.effects", name), **WITH_STATES[name])


# --- the equations


def systems():
    four = Setting(
        Model(FourDof(drive="spring"), [replace(CUBIC_STIFFNESS, bodies=("q3", "interface"))]), SHAKER, {"k3": 3e9}
    )
    return {
        "duffing": duffing(),
        "friction": setting(COULOMB_FRICTION, friction=0.3, friction_slip=0.05),
        "moving base": setting(
            CUBIC_STIFFNESS, excitation=Excitation("base", "base motion", frequency=3.0, amplitude=1e-3), k3=4e5
        ),
        "compliant stop": setting(
            options={"stop": True, "contact": "hunt_crossley"}, gap=2e-3, hunt_crossley=0.6, contact_time=0.05
        ),
        "four_dof": four,
        "distorted drive": setting(
            DRIVE_HARMONIC_2,
            COULOMB_FRICTION,
            excitation=Excitation("base", "base motion", frequency=3.0, amplitude=2e-2),
            friction=0.3,
            friction_slip=0.05,
            h2_cos=0.3,
            h2_sin=-0.2,
        ),
        **{name: with_states(name) for name in WITH_STATES},
    }


@pytest.mark.parametrize(
    "name", ["duffing", "friction", "moving base", "compliant stop", "four_dof", "distorted drive", *WITH_STATES]
)
def test_the_derivative_is_that_of_the_residual(name):
    held = systems()[name]
    system = held.map().modal_system()
    balance, omega = HarmonicBalance(system, 3), 2.0 * math.pi * 1.05 * held.excitation.frequency
    rng = np.random.default_rng(1)
    y = balance.linear_motion(omega, system.amplitude)
    y = y + 0.2 * np.abs(y).max() * rng.normal(size=y.shape)
    direction = rng.normal(size=y.shape) * np.abs(y).max()
    step = 1e-6
    ahead, behind = (balance.residual(y + s * step * direction, omega, system.amplitude) for s in (1.0, -1.0))
    expected = (ahead - behind).ravel() / (2.0 * step)
    by_coefficients, by_omega, by_amplitude = balance.derivatives(y, omega, system.amplitude)
    got = by_coefficients @ direction.ravel()
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    for by, drive in ((by_omega, (omega, 0.0)), (by_amplitude, (0.0, system.amplitude))):
        ahead, behind = (
            balance.residual(y, omega + s * step * drive[0], system.amplitude + s * step * drive[1])
            for s in (1.0, -1.0)
        )
        expected = (ahead - behind) / (2.0 * step * sum(drive))
        np.testing.assert_allclose(by, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_multipliers_are_those_of_the_period_map():
    held = duffing()
    map = held.map({"excitation.frequency": 3.3, "excitation.amplitude": 0.6})
    [one] = balanced_response(held, (2.5, 3.3), [0.6], harmonics=9, steps=2).branches
    cycle = shoot(map, one.branch.states[-1], 1)
    np.testing.assert_allclose(cycle.state, one.branch.states[-1], rtol=1e-8)
    assert one.frequency[-1] == 3.3
    np.testing.assert_allclose(
        np.sort_complex(one.branch.multipliers[-1]), np.sort_complex(cycle.multipliers), atol=3e-6
    )


# a slider that does not slide may rest anywhere: shooting finds no single cycle
@pytest.mark.parametrize("name", [name for name in WITH_STATES if name != "backlash"])
def test_motions_with_internal_states_are_those_of_shooting(name):
    held, frequency = with_states(name), 3.05
    [one] = balanced_response(held, (2.9, frequency), [0.6], harmonics=15, steps=2).branches
    map = held.map({"excitation.frequency": frequency, "excitation.amplitude": 0.6})
    cycle = shoot(map, one.branch.states[-1])
    assert cycle.converged
    assert one.frequency[-1] == frequency
    scaled = one.branch.states / map.scale
    np.testing.assert_allclose(cycle.state / map.scale, scaled[-1], atol=2e-3 * np.abs(scaled[:, :2]).max())
    assert one.branch.stable.all()
    np.testing.assert_allclose(np.abs(one.branch.multipliers[-1])[0], np.abs(cycle.multipliers).max(), atol=0.02)


@pytest.mark.slow
def test_a_slider_whose_sliding_the_steps_do_not_resolve_is_left_to_shooting():
    held = setting(load("calib.effects", "backlash"), **WITH_STATES["backlash"] | {"backlash_force": 0.2})
    measured = make_response(np.array([2.9, 3.0]), ["mass"], np.ones((1, 2)), 0.6, "N")
    found = swept_response(held.model, held.values, FORCE, measured)
    assert found.attrs["status"] == "ok"
    settled = held.map({"excitation.frequency": 3.0, "excitation.amplitude": 0.6}).orbit(np.zeros(3), 300)
    amplitude, _ = harmonics_of_cycle(held, 1, 1, 3.0, 0.6, settled.states[-1])
    own = found.isel(point=int(np.argmin(np.abs(found.frequency.values - 3.0))))
    np.testing.assert_allclose(complex_amplitude(own.expand_dims("point", -1))[0, 0], amplitude[0, 1], rtol=1e-3)


@force(states=1)
def worn(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Stiffness that falls with the distance that was slid, which only adds up."""
    dz[0] = abs(v)
    return p[0] * z[0] * x


def test_a_state_that_never_repeats_has_no_periodic_motion():
    wear = Effect("wear", "force", worn, (Parameter("wear", "1/(m s^2)", 0.0, "fall of stiffness", null=0.0),), "wear")
    system = setting(wear, wear=1.0).map().modal_system()
    balance, omega = HarmonicBalance(system, 3), 6.0 * math.pi
    y = balance.linear_motion(omega, system.amplitude)
    assert np.isnan(balance.residual(y, omega, system.amplitude)).any()


# --- responses


def test_the_response_of_a_linear_oscillator_is_its_transfer_function():
    response = balanced_response(setting(phase=0.3), (2.5, 4.0), [0.5, 2.0], steps=3)
    assert response.levels == (0.5, 2.0)
    for one in response.branches:
        omega = 2.0 * np.pi * one.frequency
        expected = one.level / (STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega)
        np.testing.assert_allclose(one.harmonics[0, 1], expected, atol=1e-12 * abs(expected).max())
        np.testing.assert_allclose(one.peak[0], abs(expected), rtol=1e-3)
        assert one.branch.stable.all()
        np.testing.assert_allclose(np.abs(one.branch.multipliers), np.exp(-0.5 / one.frequency)[:, None] ** [1, 1],
                                   rtol=1e-6)  # fmt: skip
    assert len(response.branches) == 2


@pytest.mark.slow
def test_folds_converge_to_those_of_shooting_with_the_harmonics():
    expected = folds(frequency_response(duffing(), (2.5, 4.5), [0.6], steps=5))
    errors = []
    for harmonics in (1, 3, 5, 7):
        response = balanced_response(duffing(), (2.5, 4.5), [0.6], harmonics=harmonics, steps=5)
        found = folds(response)
        assert found.size == expected.size == 2
        errors.append(np.abs(found - expected).max())
        assert response.truncation.harmonics == harmonics
    assert all(later < 0.1 * earlier for earlier, later in zip(errors[:-1], errors[1:], strict=True)), errors
    assert errors[-1] < 1e-8


@pytest.mark.slow  # compiles the kernel of a compliant stop, which shooting needs
def test_what_is_left_out_falls_with_the_harmonics():
    held = systems()["compliant stop"]
    left_out = [balanced_response(held, (2.5, 5.0), [0.2], harmonics=h, steps=4).truncation.largest for h in (3, 7, 15)]
    assert left_out[0] > 4.0 * left_out[1] > 16.0 * left_out[2]
    assert left_out[2] < 1e-3


def test_a_branch_ends_where_the_motion_touches_a_rigid_stop():
    held = setting(options={"stop": True}, gap=0.01, restitution=0.6)
    response = balanced_response(held, (2.5, 4.5), [0.6], harmonics=1, steps=7)
    grazing = sorted(p.parameter for one in response.branches for p in one.branch.points if p.kind == "grazing")
    # |transfer function| = gap
    force = 0.6 / 0.01
    roots = np.roots([MASS**2, DAMPING**2 - 2.0 * MASS * STIFFNESS, STIFFNESS**2 - force**2]).real
    np.testing.assert_allclose(grazing, np.sort(np.sqrt(roots)) / (2.0 * np.pi), rtol=1e-9)
    assert [met.kind for met in response.irregular] == ["with impacts"]
    assert all((one.branch.nearest > -1e-12).all() for one in response.branches)


def test_several_bodies_agree_with_shooting():
    held = Setting(Model(FourDof(drive="spring"), [CUBIC_STIFFNESS]), SHAKER, {"k3": 2e9})
    response = balanced_response(held, (20.0, 32.0), [1.5e-4], harmonics=5, steps=3)
    [one] = response.branches
    assert response.truncation.largest < 1e-6
    cycle = shoot(held.map({"excitation.frequency": float(one.frequency[7]), "excitation.amplitude": 1.5e-4}),
                  one.branch.states[7], 1)  # fmt: skip
    np.testing.assert_allclose(one.branch.displacement[:, 0, 7], cycle.orbit.displacement[:, 0], rtol=1e-6)
    np.testing.assert_allclose(one.branch.velocity[:, 0, 7], cycle.orbit.velocity[:, 0], rtol=1e-5, atol=1e-8)


def test_an_amplitude_may_depend_on_the_frequency():
    response = balanced_response(setting(), (2.5, 3.5), [0.5], steps=2, amplitude=lambda level, f: level * f / 3.0)
    [one] = response.branches
    omega = 2.0 * np.pi * one.frequency
    expected = 0.5 * one.frequency / 3.0 / np.abs(STIFFNESS - MASS * omega**2 + 1j * DAMPING * omega)
    np.testing.assert_allclose(np.abs(one.harmonics[0, 1]), expected, rtol=1e-9)


def test_the_dataset_says_how_the_motions_were_found():
    dataset = response_dataset(balanced_response(duffing(), (2.5, 3.0), [0.1], harmonics=5, steps=2))
    assert dataset.attrs["method"] == "harmonic balance"
    assert dataset.attrs["balanced_harmonics"] == 5
    assert dataset.attrs["largest_change_by_shooting"] < 1e-6
    assert dataset.sizes["harmonic"] == 6


@pytest.mark.parametrize(
    ("held", "message"),
    [
        (setting(options={"stop": True, "contact": "gonthier"}), "speed at which it began"),
        (setting(options={"stop": True, "contact": "kelvin_voigt"}), "jumps where it begins"),
    ],
)
def test_what_is_not_served_is_refused(held, message):
    with pytest.raises(CalibError, match=message):
        balanced_response(held, (2.5, 3.0), [0.1])
