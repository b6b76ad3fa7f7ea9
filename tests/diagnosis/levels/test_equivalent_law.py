"""Equivalent damping and stiffness of force laws, by their closed forms."""

import math

import numpy as np
import pytest

from calib.diagnosis.levels.equivalent_law import equivalent_law
from calib.effects.coulomb_friction import EFFECT as COULOMB
from calib.effects.cubic_stiffness import EFFECT as CUBIC
from calib.effects.presliding import EFFECT as PRESLIDING
from calib.effects.quadratic_drag import EFFECT as DRAG

AMPLITUDE, OMEGA = np.array([0.002, 0.01]), 20.0  # m, rad/s


def of(effect, **values):
    """Equivalent law of an effect at these values and nominal ones."""
    nominal = {p.name: p.nominal for p in effect.parameters}
    return equivalent_law(effect.bound({**nominal, **values}), AMPLITUDE, OMEGA)


def test_drag_has_a_damping_in_proportion_to_the_amplitude():
    law = of(DRAG, c2=3.0)
    np.testing.assert_allclose(law.damping, 8.0 * 3.0 * OMEGA * AMPLITUDE / (3.0 * math.pi), rtol=1e-3)
    assert law.damping_power == pytest.approx(1.0)
    assert law.changes == (1, 0)


def test_friction_has_a_damping_in_inverse_proportion_to_it():
    law = of(COULOMB, friction=0.05, friction_slip=1e-4)
    np.testing.assert_allclose(law.damping, 4.0 * 0.05 / (math.pi * OMEGA * AMPLITUDE), rtol=1e-2)
    assert law.damping_power == pytest.approx(-1.0, abs=0.01)
    assert law.changes == (-1, 0)


def test_a_cubic_spring_has_a_stiffness_and_no_damping():
    law = of(CUBIC, k3=2e4)
    np.testing.assert_allclose(law.stiffness, 0.75 * 2e4 * AMPLITUDE**2, rtol=1e-6)
    assert law.damping_power is None
    assert law.changes == (0, 1)


def test_friction_with_an_internal_state_slides_at_large_amplitudes():
    law = of(PRESLIDING, dahl_force=0.1, dahl_distance=1e-4)
    np.testing.assert_allclose(law.damping, 4.0 * 0.1 / (math.pi * OMEGA * AMPLITUDE), rtol=0.1)
    assert law.changes == (-1, -1)  # its stiffness before sliding counts less and less
