"""The laws that are hidden in stepped sines have the forces that their names promise."""

import numpy as np
import pytest
from hidden.stepped import drawn, signal_beyond_special, signal_to_noise
from hidden.stepped_laws import BOUC_WEN_SHAPE, CAUSES, FRACTIONAL_FREQUENCY, STRIBECK_RISE


def loop(cause, path, size, form):
    """Force along a path of displacements [m] that is passed slowly at 1 m/s: a state follows it by small steps."""
    law, z, force = CAUSES[cause], np.zeros(CAUSES[cause].states), []
    rate = np.zeros_like(z)
    for before, x in zip(path[:-1], path[1:], strict=True):
        law.force(before, np.sign(x - before), z, size, form, rate)
        z = z + rate * abs(x - before)
        force.append(law.force(x, np.sign(x - before), z, size, form, rate))
    return np.array(force)


@pytest.mark.parametrize("cause", ["presliding", "bouc_wen", "iwan"])
def test_a_joint_is_a_spring_at_first_and_slips_at_its_force(cause):
    size, form = 0.2, 8e-3
    force = loop(cause, np.linspace(0.0, 10.0 * form, 20_001), size, form)
    assert force[9] == pytest.approx(-size * 5e-3, rel=0.02)  # ten steps of a two-thousandth of `form`
    assert force[-1] == pytest.approx(-size, rel=1e-3)


def test_a_joint_of_sliders_slips_bit_by_bit_and_one_of_dahls_from_the_first():
    size, form = 0.2, 8e-3
    half = {cause: loop(cause, np.linspace(0.0, form, 2001), size, form)[-1] / size for cause in ("presliding", "iwan")}
    assert half["presliding"] == pytest.approx(np.exp(-1.0) - 1.0, abs=1e-3)
    assert half["iwan"] == pytest.approx(-0.75, abs=2e-3)  # half of the sliders slip at half their mean force


def test_bouc_and_wens_joint_is_softer_when_it_is_loaded_than_when_it_is_unloaded():
    size, form = 0.2, 8e-3
    path = np.concatenate([np.linspace(0.0, 3.0 * form, 6001), np.linspace(3.0 * form, 2.9 * form, 201)[1:]])
    force = loop("bouc_wen", path, size, form)
    loaded, unloaded = force[5999] - force[5799], force[-1] - force[-201]
    assert abs(loaded) < 0.05 * abs(unloaded)
    assert unloaded == pytest.approx(size * 0.1 * 2.0 * BOUC_WEN_SHAPE, rel=0.1)  # z' = 2 b v / form about |z| = 1


def test_friction_at_rest_is_larger_than_that_of_sliding():
    slow, fast = 1e-3, 5.0
    for speed, share in ((slow, 1.0 + STRIBECK_RISE), (fast, 1.0)):
        z, rate = np.array([share]), np.zeros(1)
        force = CAUSES["stribeck"].force(0.0, speed, z, 0.05, 0.1, rate)
        assert rate[0] == pytest.approx(0.0, abs=1e-3 * speed / 5e-4)  # that deflection lasts
        assert force == pytest.approx(-0.05 * share)


def test_play_has_no_force_within_its_width():
    stiffness, width = 20.0, 5e-3
    force = loop("backlash", np.linspace(-2.0 * width, 2.0 * width, 401), stiffness, width)
    assert np.abs(force[101:299]).max() < 1e-12
    assert force[[0, -1]] == pytest.approx([stiffness * width, -stiffness * width], rel=0.02)


def test_a_magnet_attracts_by_the_inverse_square_of_its_distance():
    force, distance = 1.5, 0.1
    at = [
        CAUSES["magnetic_attraction"].force(x, 0.0, np.zeros(1), force, distance, np.zeros(1))
        for x in (0.0, -0.05, 0.1)
    ]
    assert at == pytest.approx([-force, -4.0 * force, -0.25 * force])


@pytest.mark.parametrize("order", [0.6, 0.7])
def test_a_springpot_is_a_derivative_of_its_order(order):
    size = 70.0
    for omega in 2.0 * np.pi * np.array([2.7, 3.3, 4.0]):
        dynamic_stiffness = -linear_response("fractional_damping", omega, size, order)
        assert dynamic_stiffness == pytest.approx(size * (1j * omega / FRACTIONAL_FREQUENCY) ** order, rel=0.01)


def linear_response(cause, omega, size, form):
    """Complex force over displacement of a linear law at an angular frequency [rad/s]."""
    law, states = CAUSES[cause].force, np.eye(CAUSES[cause].states)
    columns = []
    for x, v, z in ((1.0, 0.0, 0.0 * states[0]), (0.0, 1.0, 0.0 * states[0]), *((0.0, 0.0, unit) for unit in states)):
        rate = np.zeros(len(states))
        columns.append((law(x, v, z, size, form, rate), rate))
    force, rates = np.array([one for one, _ in columns]), np.array([rate for _, rate in columns]).T
    driven = rates[:, 0] + 1j * omega * rates[:, 1]
    return force[0] + 1j * omega * force[1] + force[2:] @ np.linalg.solve(1j * omega * states - rates[:, 2:], driven)


@pytest.mark.slow
@pytest.mark.parametrize("cause", CAUSES)
def test_what_is_hidden_is_visible_and_nothing_is_not(cause):
    assert signal_to_noise(drawn(cause, 0)) > 8.0
    assert signal_to_noise(drawn(None, 0)) < 0.5


def test_a_law_without_a_special_case_is_told_from_any():
    assert signal_beyond_special(drawn("softening", 1)) == np.inf
    assert signal_beyond_special(drawn(None, 1)) == np.inf


@pytest.mark.slow
def test_what_is_far_from_nothing_may_be_close_to_its_special_case():
    friction = drawn("stribeck", 820)
    assert signal_to_noise(friction) > 100.0
    assert signal_beyond_special(friction) == pytest.approx(4.1, abs=0.2)
