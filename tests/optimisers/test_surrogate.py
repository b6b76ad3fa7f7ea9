"""Surrogate wastes no evaluation, keeps away from failures and other kinds of motion, and reaches its targets."""

import numpy as np
import pytest
from benchmarks.optimiser_problems import PROBLEMS, Outcome, evaluations_to_target

from calib.optimisers.expected_improvement import Warp, emulate_cost, log_expectation, most_promising, warps
from calib.optimisers.surrogate import Surrogate
from calib.testing.optimiser_suite import BOWL, bowl, search

CURVED = np.array([0.62, 0.31, 0.45])


def curved(u):
    """Residuals that bend: a valley, least at CURVED."""
    z = u - CURVED
    residuals = np.array([3 * (z[1] - 2 * z[0] ** 2), z[0], z[2] + z[0] * z[1]])
    return Outcome(float(np.sqrt(residuals @ residuals)), residuals, kind="period-1")


def scalar(u):
    return Outcome(float(((u - BOWL[: u.size]) ** 2).sum()))


def lowest(points, outcomes):
    return points[np.argmin([outcome.cost for outcome in outcomes])]


def test_a_linear_model_is_solved_by_the_screen_the_neighbours_of_its_best_point_and_a_few_steps():
    _, outcomes = search(Surrogate(4, 1, 30), lambda u: bowl(u, BOWL), 6 + 4 + 3)
    assert min(outcome.cost for outcome in outcomes) < 1e-2


def test_curved_residuals_are_solved_with_few_evaluations():
    points, outcomes = search(Surrogate(3, 1, 30), curved, 25)
    np.testing.assert_allclose(lowest(points, outcomes), CURVED, atol=1e-3)


def test_a_cost_without_residuals_is_searched_by_expected_improvement():
    points, outcomes = search(Surrogate(3, 1, 30), scalar, 30)
    np.testing.assert_allclose(lowest(points, outcomes), BOWL[:3], atol=0.02)


def test_a_told_screen_stands_in_for_its_own():
    optimiser, screen = Surrogate(4, 1, 60), np.random.default_rng(1).random((12, 4))
    optimiser.tell(screen, [bowl(u, BOWL) for u in screen])
    best = lowest(screen, [bowl(u, BOWL) for u in screen])
    assert np.abs(optimiser.ask() - best).max() < 0.03  # the neighbours with which a search begins


@pytest.mark.parametrize("outcome", [curved, scalar])
def test_a_batch_is_filled_with_different_points(outcome):
    optimiser = Surrogate(3, 1, 60, batch=5)
    for _ in range(4):
        asked = optimiser.ask()
        assert len(np.unique(asked.round(9), axis=0)) == len(asked)
        optimiser.tell(asked, [outcome(u) for u in asked])
    assert len(asked) >= 5


def test_few_evaluations_are_spent_where_simulations_fail():
    def outcome(u):
        return Outcome(np.inf, None, "diverged") if u[0] > 0.7 else curved(u)

    points, outcomes = search(Surrogate(3, 1, 40), outcome, 40)
    np.testing.assert_allclose(lowest(points, outcomes), CURVED, atol=1e-3)
    assert (points[5:, 0] > 0.7).mean() < 0.3


def test_residuals_of_another_kind_of_motion_do_not_mislead():
    def outcome(u):
        if u[1] < 0.4:
            return curved(u)
        noise = np.sin(1e3 * u)
        return Outcome(10 + float(u[1]), noise, kind="period-2")

    points, outcomes = search(Surrogate(3, 1, 50), outcome, 50)
    np.testing.assert_allclose(lowest(points, outcomes), CURVED, atol=1e-3)


def test_residuals_that_are_not_finite_are_not_used():
    points, _ = search(Surrogate(2, 1, 25), lambda u: Outcome(scalar(u).cost, np.array([np.nan, 1.0])), 25)
    assert len(points) == 25


def test_its_summary_says_where_its_searches_ended():
    def outcome(u):
        residuals = np.append(bowl(u, BOWL[:2]).residuals, 1.0)  # no model is exact
        return Outcome(float(np.sqrt(residuals @ residuals)), residuals)

    optimiser = Surrogate(2, 1, 40)
    search(optimiser, outcome, 40)
    summary = optimiser.summary()
    assert summary.starts >= 2
    assert summary.agree_in_point == summary.basins[0].searches >= 2
    np.testing.assert_allclose(summary.basins[0].point, BOWL[:2], atol=0.01)


def test_the_expectation_is_that_of_its_formula():
    t = np.array([-30.0, -6.0, -5.05, -4.95, 0.0, 2.0])
    value = log_expectation(t)
    assert value[4] == pytest.approx(np.log(1 / np.sqrt(2 * np.pi)))
    assert value[5] == pytest.approx(np.log(2.0084907), abs=1e-6)
    assert abs(value[3] - value[2] - 0.1 * 5.37) < 0.02  # the tail joins
    assert (np.diff(value) > 0).all()


@pytest.mark.parametrize("warp", warps(np.array([1.0, 3.0])))
def test_a_transformation_rises_and_knows_its_slope(warp):
    costs, h = np.linspace(1.0, 3.0, 9), 1e-6
    slopes = (warp(costs + h / 2) - warp(costs - h / 2)) / h
    assert (slopes > 0).all()
    assert warp.log_slope(costs) == pytest.approx(np.log(slopes).sum(), abs=1e-4)


def test_the_transformation_that_straightens_the_costs_is_chosen():
    points = np.random.default_rng(1).random((30, 2))
    emulated = emulate_cost(points, np.exp(8 * points.sum(axis=1)))
    assert np.ptp(emulated.process.values) < 50  # logarithms, not costs up to exp(16)
    assert Warp()(np.array([2.0])) == 2.0


def test_points_of_largest_improvement_keep_apart():
    points = np.random.default_rng(1).random((12, 2))
    emulated = emulate_cost(points, np.array([scalar(u).cost for u in points]))
    asked = most_promising(emulated, points[0], 3, np.random.default_rng(2))
    assert min(np.abs(a - b).max() for i, a in enumerate(asked) for b in asked[:i]) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "median"), [("ringdown6", 110), ("hartmann6", 45), ("impact6", 41), ("kinds6", 60)])
def test_it_reaches_the_target_from_three_seeds(name, median):
    """A sample: `tests/benchmarks/compare_optimisers.py` runs twenty seeds, beside peers."""
    spent = [evaluations_to_target(Surrogate(6, seed, 150), PROBLEMS[name](seed), 150) for seed in range(3)]
    assert np.median(spent) <= median


def test_a_negative_screen_is_refused():
    with pytest.raises(ValueError, match="screen: expected no negative number of points, got -3"):
        Surrogate(2, 0, screen=-3)
