"""Curves beside a known one, where the forces along their motions are not to be had."""

import numpy as np
import pytest

from calib.dynamics.neighbour_curve import first_order_curve, neighbour_curve
from calib.modelling.modal_system import Forces


class Parabola:
    """Curve y = bend u^2 over its parameter u, as `SeriesEquations`, with forces of some value."""

    run_over = -1

    def __init__(self, bend, force=0.0, residual=0.0):
        self.bend, self.left, self.force = bend, residual, force

    def forces(self, z):
        return [Forces(np.full((1, 4), self.force), np.zeros((1, 4)), np.zeros((1, 4))) for _ in z]

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
