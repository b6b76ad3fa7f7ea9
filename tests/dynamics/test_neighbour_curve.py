"""Curves beside a known one, where the forces along their motions are not to be had."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.dynamics.neighbour_curve import first_order_curve, neighbour_curve
from calib.modelling.modal_system import Forces


class Parabola:
    """Curve y = bend u^2 over its parameter u, as `SeriesCurve` has its equations, with forces of some value."""

    def __init__(self, bend, force=0.0, residual=0.0):
        self.bend, self.left = bend, residual
        own = Forces(np.full((1, 4), force), np.zeros((1, 4)), np.zeros((1, 4)))
        self.balance = SimpleNamespace(forces_of_all=lambda z: [own for _ in z])

    def unpacked_all(self, z):
        return (z,)

    def residual(self, z):
        return np.array([z[0] - self.bend * z[1] ** 2 + self.left])

    def residuals(self, z):
        return np.array([self.residual(own) for own in z])

    def derivative(self, z):
        if not np.isfinite(self.left):
            raise np.linalg.LinAlgError("of what is not finite there is no derivative")
        return np.array([[1.0, -2.0 * self.bend * z[1]]])


PARAMETER = np.linspace(0.0, 1.0, 30)
KNOWN = np.column_stack([PARAMETER**2, PARAMETER])


def test_a_curve_beside_a_known_one_is_found():
    found, _ = neighbour_curve(Parabola(1.1), KNOWN)
    assert found[:, 0] == pytest.approx(1.1 * found[:, 1] ** 2, abs=1e-9)
    linear = first_order_curve(Parabola(1.01), KNOWN)
    assert linear[:, 0] == pytest.approx(1.01 * linear[:, 1] ** 2, abs=1e-3)


def test_one_whose_internal_states_are_not_resolved_is_none():
    assert neighbour_curve(Parabola(1.1, force=np.nan), KNOWN) is None


def test_one_whose_internal_states_do_not_repeat_is_none_and_no_error():
    assert neighbour_curve(Parabola(1.1, residual=np.nan), KNOWN) is None
    assert first_order_curve(Parabola(1.1, residual=np.nan), KNOWN) is None
