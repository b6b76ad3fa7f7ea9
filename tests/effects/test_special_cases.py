"""Laws of damping, hysteresis, play and feedback against their special cases and transfer functions."""

import numpy as np
import pytest

from calib import plugins

EFFECTS = plugins.load_all("calib.effects")


class Bound:
    """A law with its numbers: force per unit mass, and the rates of its states."""

    def __init__(self, name, **values):
        effect = EFFECTS[name]
        self.law, self.states = effect.law.function, effect.law.states
        self.values = {p.name: p.nominal for p in effect.parameters} | values
        self.p = effect.bound(self.values).p

    def __call__(self, x, v, z=(), t=0.0):
        own, dz = np.zeros(4), np.zeros(4)
        own[: len(z)] = z
        return self.law(t, x, v, self.p, own, dz), dz[: self.states]

    def pulled(self, path):
        """Forces (n,) along a path of displacements (n,) that is gone through slowly, from rest."""
        z, forces = np.zeros(self.states), []
        for x, dx in zip(path[1:], np.diff(path), strict=True):
            middle = z + 0.5 * self(x, dx, z)[1]
            z = z + self(x, dx, middle)[1]
            forces.append(self(x, dx, z)[0])
        return np.array(forces)

    def transfer(self, omega):
        """Force per unit displacement of a linear law at an angular frequency."""
        count, eye = self.states, np.eye(self.states)
        rows = [self(1.0, 0.0), self(0.0, 1.0), *(self(0.0, 0.0, own) for own in eye)]
        force, rates = np.array([row[0] for row in rows]), np.array([row[1] for row in rows]).T
        moved = np.array([1.0, 1j * omega])
        z = np.linalg.solve(1j * omega * np.eye(count) - rates[:, 2:], rates[:, :2] @ moved)
        return force[:2] @ moved + force[2:] @ z


STATED = [(general.name, special) for general in EFFECTS.values() for special in general.special_cases]


def test_special_cases_are_stated():
    assert {("bouc_wen", "presliding"), ("stribeck", "presliding"), ("power_law_damping", "quadratic_drag")} < {*STATED}


@pytest.mark.parametrize(("general", "special"), STATED)
def test_a_general_law_contains_the_special_case_that_it_states(general, special):
    values = {p.name: 2.0 * p.nominal or 3.0 for p in EFFECTS[special].parameters}
    known = EFFECTS[general].special_cases[special]
    own = {name: values[at] if isinstance(at, str) else at for name, at in known.items()}
    assert EFFECTS[general].impossible(Bound(general, **own).values) == ""
    one, other = Bound(general, **own), Bound(special, **values)
    for x, v, z in np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3)):
        for have, want in zip(one(x, v, [z]), other(x, v, [z]), strict=True):
            assert have == pytest.approx(want, rel=1e-12) or other.states == 0


def test_iwan_sliders_with_all_slip_at_once_are_bouc_wen_s():
    joint = Bound("iwan", iwan_force=2.0, iwan_distance=1e-4, iwan_ratio=1e9)
    one = Bound("bouc_wen", hysteresis_force=2.0, hysteresis_distance=1e-4)
    path = 2e-4 * np.sin(np.linspace(0.0, 7.0, 2000))
    np.testing.assert_allclose(joint.pulled(path), one.pulled(path), rtol=0, atol=1e-6)


@pytest.mark.parametrize("chi", [-0.3, -0.7])
def test_a_joint_has_the_stiffness_the_slip_force_and_the_loss_of_the_continuous_one(chi):
    """Segalman (2005): K_T, F_S, and a loss per cycle ~ amplitude^(3 + chi) below the last slip, about."""
    force, distance, beta = 2.0, 1e-3, 0.2
    law = Bound("iwan", iwan_force=force, iwan_distance=distance, iwan_exponent=chi, iwan_ratio=beta)
    stiffness = force * (1.0 + beta) / (distance * (beta + (chi + 1.0) / (chi + 2.0)))
    assert law.pulled(np.array([0.0, 1e-9]))[-1] == pytest.approx(-1e-9 * stiffness, rel=1e-3)
    assert law.pulled(np.linspace(0.0, 10.0 * distance, 4000))[-1] == pytest.approx(-force, rel=1e-3)
    losses = []
    amplitudes = distance * np.array([0.1, 0.4])
    for amplitude in amplitudes:
        path = amplitude * np.sin(np.linspace(0.0, 4.0 * np.pi, 2001))
        losses.append(-(law.pulled(path)[1000:] * np.diff(path)[1000:]).sum())
    assert np.log(losses[1] / losses[0]) / np.log(4.0) == pytest.approx(3.0 + chi, abs=0.35)


def test_friction_is_higher_at_rest_than_in_fast_sliding():
    law = Bound("stribeck", stribeck_force=2.0, stribeck_distance=1e-5, stribeck_rise=0.5, stribeck_speed=0.01)
    for v, z in ((1e-5, 1.5), (1.0, 1.0)):
        force, rates = law(0.0, v, [z])
        assert force == pytest.approx(-2.0 * z)
        assert rates[0] * 1e-5 / v == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("law", "sticks"),
    [
        (Bound("stribeck", stribeck_force=2.0, stribeck_distance=1e-4), True),
        (Bound("presliding", dahl_force=2.0, dahl_distance=1e-4), True),
        (Bound("coulomb_friction", friction=2.0, friction_slip=1e-3), False),
    ],
    ids=["stribeck", "presliding", "coulomb_friction"],
)
def test_a_load_below_the_friction_is_held_at_rest_by_a_law_with_a_state(law, sticks):
    load, step, x, v, z = 1.6, 1e-4, 0.0, 0.0, np.zeros(law.states)
    for _ in range(5_000):  # semi-implicit Euler, half a second
        force, rates = law(x, v, z)
        v += step * (load + force - 100.0 * v)
        x, z = x + step * v, z + step * rates
    assert (abs(v) < 1e-9) == sticks
    assert (x < 3e-4) == sticks


def test_backlash_whose_mount_does_not_slide_is_play_on_two_sides():
    law = Bound("backlash", backlash_stiffness=100.0, backlash_width=1e-3, backlash_force=1.0)
    for x in (-3e-3, -5e-4, 0.0, 5e-4, 3e-3):
        force, rates = law(x, np.sign(x), [0.0])
        assert force == pytest.approx(-100.0 * np.sign(x) * max(0.0, abs(x) - 1e-3))
        assert rates[0] == 0.0


@pytest.mark.parametrize("order", [0.2, 0.5, 0.8])
def test_four_poles_are_a_derivative_of_fractional_order(order):
    law = Bound("fractional_damping", fractional_stiffness=2.0, fractional_order=order, fractional_frequency=20.0)
    middle = 2.0 * np.pi * 20.0
    for ratio, error in ((0.05, 0.04), (0.2, 0.015), (1.0, 0.015), (5.0, 0.015), (20.0, 0.04)):
        assert abs(law.transfer(ratio * middle) / (-2.0 * (1j * ratio) ** order) - 1.0) < error


def test_feedback_comes_as_late_as_its_delay():
    law = Bound("delayed_feedback", feedback_stiffness=3.0, feedback_damping=0.1, feedback_delay=0.02)
    for omega, error in ((10.0, 1e-9), (100.0, 2e-4), (150.0, 5e-3)):
        exact = -(3.0 + 0.1j * omega) * np.exp(-0.02j * omega)
        assert abs(law.transfer(omega) / exact - 1.0) < error


def test_a_magnet_attracts_on_either_side_and_no_more_than_at_its_least_distance():
    below, above = (Bound("magnetic_attraction", magnet_strength=1e-4, magnet_distance=d) for d in (1e-2, -1e-2))
    assert below(0.0, 0.0)[0] == pytest.approx(-1.0)
    assert below(-5e-3, 0.0)[0] == pytest.approx(-4.0)
    assert above(5e-3, 0.0)[0] == pytest.approx(4.0)
    assert [below(x, 0.0)[0] for x in (-9e-3, -1e-2, -2e-2)] == pytest.approx([-100.0] * 3)


def test_a_drive_with_jitter_is_late_by_its_phase():
    effect = EFFECTS["phase_jitter"]
    p = effect.bound({"jitter_sin": 0.02, "jitter_cos": 0.01, "jitter_frequency": 50.0}).p
    t, phase = 3e-3, 1.1
    late = 0.02 * np.sin(100.0 * np.pi * t) + 0.01 * (np.cos(100.0 * np.pi * t) - 1.0)
    assert np.cos(phase) + effect.law.function(t, phase, 1.0, 0.0, p) == pytest.approx(np.cos(phase - late))
