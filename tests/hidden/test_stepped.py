"""The laws that are hidden in stepped sines have the forces that their names promise."""

import numpy as np
import pytest
from hidden.stepped import BOUC_WEN_SHAPE, CAUSES, STRIBECK_RISE


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
