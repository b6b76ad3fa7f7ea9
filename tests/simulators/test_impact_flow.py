"""Closed-form flow of a mode: against the matrix exponential, in every regime of damping."""

import numpy as np
import pytest
from scipy.linalg import expm

from calib.simulators.impact.flow import MAX_SERIES_ARGUMENT, impulse_response, load_motion
from calib.simulators.impact.polynomial import BETWEEN, FIT, INTEGRAL, NODES, POINTS, PROBE_INDEX

EPSILON = np.finfo(float).eps

MODES = [(4.0, 0.1), (4.0, 2.0), (4.0, 2.0 + 1e-9), (4.0, 50.0), (0.0, 0.0), (0.0, 3.0), (-2.0, 0.3), (1e-12, 1e-3)]


@pytest.mark.parametrize(("stiffness", "rate"), MODES)
@pytest.mark.parametrize("tau", [1e-9, 1e-3, 0.5, 3.0])
def test_a_mode_flows_as_the_matrix_exponential(stiffness, rate, tau):
    exact = expm(tau * np.array([[0.0, 1.0], [-stiffness, -2.0 * rate]]))
    s, c = impulse_response(stiffness, rate, tau)
    assert [s, c] == pytest.approx(exact[:, 1], rel=2e-12, abs=1e-14)


@pytest.mark.parametrize(("stiffness", "rate"), MODES)
@pytest.mark.parametrize("share", [1e-6, 0.1, 1.0])
def test_a_polynomial_load_moves_a_mode_as_the_matrix_exponential_of_its_jet(stiffness, rate, share):
    tau = share * MAX_SERIES_ARGUMENT / max(np.sqrt(abs(stiffness)), 2.0 * rate, 1.0)
    load = np.array([0.7, -1.1, 0.4, 2.0, -1.5])
    step = tau / 0.8
    # y, y' and the load with its four derivatives make one linear system
    system = np.zeros((7, 7))
    system[0, 1], system[1, 0], system[1, 1], system[1, 2] = 1.0, -stiffness, -2.0 * rate, 1.0
    system[2:6, 3:7] = np.eye(4)
    jet = load * [1.0, 1.0, 2.0, 6.0, 24.0] / step ** np.arange(5)
    exact = expm(system * tau) @ [0.0, 0.0, *jet]
    assert load_motion(stiffness, rate, tau, load, step) == pytest.approx(exact[:2], rel=1e-11)


def test_the_nodes_integrate_polynomials_of_degree_seven_exactly():
    # each weight is within half a unit in its last place of the exact one, each product and sum adds as much
    for degree in range(5):
        rounding = 10 * EPSILON * (np.abs(INTEGRAL) @ NODES**degree)
        assert (np.abs(INTEGRAL @ NODES**degree - POINTS ** (degree + 1) / (degree + 1)) <= rounding).all()
        assert BETWEEN @ NODES**degree == pytest.approx(POINTS[PROBE_INDEX] ** degree)
        assert FIT @ NODES**degree == pytest.approx(np.eye(5)[degree], abs=1e-13)
    for degree in range(8):
        assert INTEGRAL[4] @ NODES**degree == pytest.approx(1.0 / (degree + 1))
