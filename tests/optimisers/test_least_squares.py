"""The bounded least-squares search reaches the least sum of squares, and asks for Jacobians as batches."""

import numpy as np
import pytest
from benchmarks.optimiser_problems import Outcome, root_mean_square

from calib.optimisers.least_squares import MAX_DIFFERENCE_STEP, descend, linear_step


def finish(search, outcome):
    """Answer a search until it ends: its last point, and the sizes of the batches it asked for."""
    sizes, request = [], next(search)
    while True:
        sizes.append(len(request))
        assert ((request >= 0) & (request <= 1)).all()
        try:
            request = search.send([outcome(u) for u in request])
        except StopIteration as end:
            return end.value[0], sizes


def of_residuals(residuals):
    def outcome(u):
        r = residuals(u)
        return Outcome(root_mean_square(r), r)

    return outcome


CENTRE = np.array([0.3, 0.6, 0.8])
linear = of_residuals(lambda u: np.array([[1, 2, 0], [0, 1, 1], [3, 0, 1], [1, 1, 1.0]]) @ (u - CENTRE))
valley = of_residuals(lambda u: np.array([10 * (u[1] - 0.2 - u[0] ** 2), 0.7 - u[0]]))


def test_a_linear_problem_needs_one_jacobian_and_a_few_steps():
    start = np.full(3, 0.5)
    u, sizes = finish(descend(start, linear(start), radius=0.4), linear)
    np.testing.assert_allclose(u, CENTRE, atol=1e-6)
    assert sizes[0] == 3
    assert sum(sizes) < 15


def test_a_curved_valley_is_followed_to_its_end():
    start = np.array([0.1, 0.9])
    u, _ = finish(descend(start, valley(start)), valley)
    np.testing.assert_allclose(u, [0.7, 0.69], atol=1e-3)


@pytest.mark.parametrize("corner", [np.zeros(3), np.ones(3)])
def test_a_least_point_on_the_bound_is_reached_exactly(corner):
    outcome = of_residuals(lambda u: u - corner - 0.3 * (2 * corner - 1))
    start = np.full(3, 0.5)
    u, _ = finish(descend(start, outcome(start)), outcome)
    np.testing.assert_array_equal(u, corner)


def test_the_first_differences_are_wide_enough_for_a_rough_cost():
    rough = of_residuals(lambda u: (u - CENTRE) + 1e-3 * np.sin(3e3 * u))
    start = np.full(3, 0.5)
    assert np.ptp(next(descend(start, rough(start))), axis=0).max() == pytest.approx(MAX_DIFFERENCE_STEP)
    u, _ = finish(descend(start, rough(start)), rough)
    assert np.abs(u - CENTRE).max() < 0.01


def test_a_failed_column_is_tried_on_the_other_side():
    def behind_a_wall(u):
        return Outcome(np.inf, None, "diverged") if u[0] > 0.501 else linear(u)

    start = np.array([0.5, 0.5, 0.5])
    u, sizes = finish(descend(start, linear(start)), behind_a_wall)
    assert sizes[:2] == [3, 1]
    np.testing.assert_allclose(u, CENTRE, atol=1e-3)


def test_a_step_is_accepted_by_its_cost_not_by_its_residuals():
    def other_kind_beyond(u):
        told = linear(u)
        return Outcome(told.cost + 10, told.residuals, kind="wrong") if u[0] < 0.4 else told

    start = np.full(3, 0.5)
    u, _ = finish(descend(start, other_kind_beyond(start)), other_kind_beyond)
    assert u[0] >= 0.4
    assert other_kind_beyond(u).cost < linear(start).cost


def test_the_linear_step_is_least_within_its_box():
    rng = np.random.default_rng(1)
    jacobian, residuals = rng.standard_normal((8, 3)), rng.standard_normal(8)
    low, high = np.full(3, -0.05), np.full(3, 0.05)
    best = np.sum((residuals + jacobian @ linear_step(jacobian, residuals, low, high)) ** 2)
    others = rng.uniform(low, high, (2000, 3))
    assert best <= ((residuals + others @ jacobian.T) ** 2).sum(axis=1).min()
