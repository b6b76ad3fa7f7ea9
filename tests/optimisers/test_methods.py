"""What is particular to the optimisers that stand on a library."""

from importlib.util import find_spec

import numpy as np
import pytest
from benchmarks.optimiser_problems import PROBLEMS, Outcome, evaluations_to_target

from calib.optimisers.cma import CmaEs
from calib.optimisers.optuna import OptunaSampler
from calib.optimisers.scipy import Scipy
from calib.testing.optimiser_suite import BOWL, bowl, failure, search


def scalar(u):
    return Outcome(float(((u - 0.4) ** 2).sum()))


def test_an_unknown_sampler_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="unknown sampler 'tpee'; known are tpe, gp"):
        OptunaSampler(2, 1, sampler="tpee")


@pytest.mark.skipif(find_spec("torch") is not None, reason="torch is installed")
def test_a_sampler_whose_package_is_missing_says_what_to_install():
    with pytest.raises(ImportError, match="pip install torch"):
        OptunaSampler(2, 1, sampler="gp")


def test_tpe_learns_from_failed_runs_where_they_lie():
    sampler = OptunaSampler(3, 1, 120)
    _, outcomes = search(sampler, lambda u: failure(u) if u[0] > 0.5 else scalar(u), 120)
    assert np.mean([outcome.cost == np.inf for outcome in outcomes]) < 0.35


def test_a_batch_of_trials_is_asked_at_once():
    assert OptunaSampler(2, 1, batch=5).ask().shape == (5, 2)


def test_cma_starts_at_the_best_point_told():
    optimiser, screen = CmaEs(2, 1, sigma=1e-3), np.random.default_rng(1).random((20, 2))
    optimiser.tell(screen, [scalar(u) for u in screen])
    best = screen[np.argmin([scalar(u).cost for u in screen])]
    assert np.abs(optimiser.ask() - best).max() < 0.01


def test_cma_goes_on_after_a_run_has_converged():
    points, _ = search(CmaEs(2, 1, budget=1500), scalar, 1500)
    assert len(points) == 1500


@pytest.mark.parametrize("name", ["hartmann6", "impact6"])
def test_cma_reaches_the_target(name):
    assert evaluations_to_target(CmaEs(6, 2, 4000), PROBLEMS[name](2), 4000) <= 4000


def test_an_unknown_method_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="known are differential_evolution"):
        Scipy(2, 1, method="annealing")


def test_least_squares_without_residuals_says_so_where_it_is_asked():
    optimiser = Scipy(2, 1, method="least_squares")
    optimiser.tell(optimiser.ask(), [scalar(np.full(2, 0.5))])
    with pytest.raises(ValueError, match="needs residuals"):
        optimiser.ask()
    optimiser.close()


def test_least_squares_asks_for_a_jacobian_as_one_batch_from_the_best_point_told():
    optimiser, centre = Scipy(4, 1, method="least_squares"), BOWL
    screen = np.random.default_rng(1).random((20, 4))
    optimiser.tell(screen, [bowl(u, centre) for u in screen])
    first = optimiser.ask()
    best = screen[np.argmin([bowl(u, centre).cost for u in screen])]
    np.testing.assert_allclose(first, [best])
    optimiser.tell(first, [bowl(u, centre) for u in first])
    assert len(optimiser.ask()) == 4
    optimiser.close()


def test_a_method_that_has_converged_says_so():
    optimiser = Scipy(2, 1, 1000, method="least_squares")
    points, outcomes = search(optimiser, lambda u: bowl(u, BOWL[:2]), 1000)
    assert "termination condition is satisfied" in optimiser.stop()
    assert len(points) < 100
    np.testing.assert_allclose(points[np.argmin([outcome.cost for outcome in outcomes])], BOWL[:2], atol=1e-6)
    optimiser.close()
