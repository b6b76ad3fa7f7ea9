"""Quadratic models, the trend through roughness, and the searches that follow them."""

import numpy as np
import pytest
from benchmarks.optimiser_problems import Outcome
from scipy.stats import special_ortho_group
from scipy.stats.qmc import Sobol

from calib.optimisers.archive import Archive
from calib.optimisers.evolution import Evolution
from calib.optimisers.model_search import descend, flattest_direction
from calib.optimisers.quadratic import Quadratic, monomials, nearest_model, pack, unpack
from calib.optimisers.trend import lowest_of_trend


def random_quadratic(rng, dim):
    half = rng.standard_normal((dim, dim))
    return Quadratic(rng.standard_normal(), rng.standard_normal(dim), half @ half.T)


def test_packing_keeps_the_frobenius_norm():
    hessian = random_quadratic(np.random.default_rng(1), 4).hessian
    assert np.linalg.norm(pack(hessian)) == pytest.approx(np.linalg.norm(hessian))


def test_monomials_times_coefficients_are_the_model():
    model, z = random_quadratic(np.random.default_rng(2), 3), np.random.default_rng(3).standard_normal((5, 3))
    coefficients = np.concatenate([[model.level], model.gradient, pack(model.hessian)])
    np.testing.assert_allclose(monomials(z) @ coefficients, [model(each) for each in z])
    np.testing.assert_allclose(unpack(coefficients, 3).hessian, model.hessian)


def test_enough_points_determine_a_quadratic():
    rng = np.random.default_rng(4)
    model, z = random_quadratic(rng, 3), rng.standard_normal((12, 3))
    fitted = nearest_model(z, np.array([model(each) for each in z]), np.ones(12), np.zeros((3, 3)), 1e-14)
    np.testing.assert_allclose(fitted.hessian, model.hessian, atol=1e-5)


def test_too_few_points_leave_the_hessian_near_the_one_before():
    rng = np.random.default_rng(5)
    before, z = random_quadratic(rng, 3), np.vstack([np.zeros(3), np.eye(3)])
    values = np.array([before(each) for each in z])
    fitted = nearest_model(z, values, np.ones(4), before.hessian, 1e-9)
    np.testing.assert_allclose(fitted.hessian, before.hessian, atol=1e-6)


def test_the_flattest_direction_is_the_one_not_tried():
    z = np.array([[1, 0, 0], [0, 1, 0], [1, 1, 0.01]])
    assert abs(flattest_direction(z)[2]) > 0.99
    assert flattest_direction(np.eye(3)) is None


def test_the_search_ends_at_the_least_point_of_a_turned_bowl():
    turn, centre = special_ortho_group.rvs(4, random_state=np.random.default_rng(6)), np.array([0.3, 0.6, 0.4, 1.0])

    def cost(u):
        return float((np.array([1, 4, 9, 16]) * (turn @ (u - centre)) ** 2).sum())

    archive, start = Archive(4), np.full(4, 0.5)
    search = descend(start, Outcome(cost(start)), archive)
    request = next(search)
    while request is not None:
        archive.add(request, [cost(u) for u in request])
        try:
            request = search.send([Outcome(cost(u)) for u in request])
        except StopIteration as end:
            request, (found, _) = None, end.value
    np.testing.assert_allclose(found, centre, atol=3e-3)
    assert len(archive.costs) < 120


def test_a_trend_sees_the_funnel_through_its_bumps():
    bottom = np.array([0.3, 0.55, 0.7])
    points = Sobol(3, rng=np.random.default_rng(7)).random_base2(7)
    z = 10 * (points - bottom)
    costs = (z * z + 10 * (1 - np.cos(2 * np.pi * z))).sum(axis=1)
    assert np.abs(lowest_of_trend(points, costs) - bottom).max() < 0.05


def test_a_trend_takes_no_notice_of_failed_runs_and_outliers():
    bottom = np.array([0.4, 0.6])
    points = Sobol(2, rng=np.random.default_rng(8)).random_base2(6)
    costs = ((points - bottom) ** 2).sum(axis=1)
    costs[points[:, 0] > 0.9] = np.inf
    costs[np.argmax(np.where(np.isfinite(costs), costs, 0))] = 1e9
    assert np.abs(lowest_of_trend(points, costs) - bottom).max() < 0.05


def test_there_is_no_trend_of_a_handful_of_points():
    assert lowest_of_trend(np.random.default_rng(9).random((7, 2)), np.arange(7.0)) is None


def test_the_evolution_adapts_to_an_ill_conditioned_bowl():
    centre, weights = np.full(5, 0.6), 10.0 ** np.arange(5)
    run = Evolution(np.full(5, 0.3), 0.2, 10, np.random.default_rng(10))
    for _ in range(150):
        points = run.sample()
        run.learn(points, ((points - centre) ** 2 * weights).sum(axis=1))
    assert np.abs(run.centre - centre).max() < 1e-3
    assert run.lengths.max() / run.lengths.min() > 20


def test_a_generation_that_failed_altogether_teaches_nothing():
    run = Evolution(np.full(3, 0.5), 0.2, 8, np.random.default_rng(11))
    run.learn(run.sample(), np.full(8, np.inf))
    np.testing.assert_array_equal(run.centre, np.full(3, 0.5))
    assert run.sigma == 0.2


def test_the_archive_gives_the_nearest_that_did_not_fail():
    archive = Archive(1)
    archive.add(np.linspace(0, 1, 101)[:, None], np.where(np.arange(101) == 51, np.inf, np.arange(101.0)))
    offsets, costs = archive.near(np.array([0.5]), 0.05, 3)
    np.testing.assert_allclose(np.abs(offsets[:, 0]), [0.01, 0.02, 0.02])
    assert 50 not in costs
    assert 51 not in costs
