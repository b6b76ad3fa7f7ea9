"""Multistart keeps its shares, says how far its starts agree, and reaches the targets it is judged by."""

import subprocess
import sys

import numpy as np
import pytest
from benchmarks.optimiser_problems import PROBLEMS, Outcome, evaluations_to_target

from calib.optimisers.multistart import Multistart
from calib.testing.optimiser_suite import bowl, search


def two_wells(u):
    """A residual problem of two equally likely basins, of which the one at 0.8 is better."""
    residuals = np.array([10 * (u[0] - 0.2) * (u[0] - 0.8), 0.3 * (u[0] - 1.0), *(u[1:] - 0.5)])
    return Outcome(float(np.sqrt(residuals @ residuals)), residuals)


@pytest.mark.parametrize("budget", [60, 200])
@pytest.mark.parametrize("dim", [1, 6, 12])
def test_at_most_a_third_of_the_budget_is_screened(dim, budget):
    optimiser = Multistart(dim, 1, budget)
    search(optimiser, lambda u: Outcome(float(np.abs(u - 0.4).sum())), budget)
    assert optimiser.spent["screen"] <= budget / 3
    assert sum(optimiser.spent.values()) == budget


def test_starts_that_agree_end_the_study_early():
    centre = np.full(3, 0.4)
    optimiser = Multistart(3, 1, budget=2000)
    points, _ = search(optimiser, lambda u: bowl(u, centre), 2000)
    summary = optimiser.summary()
    assert len(points) < 500
    assert "agree" in optimiser.stop()
    assert len(summary.basins) == 1
    assert summary.agree_in_point == summary.agree_in_cost == summary.basins[0].searches
    np.testing.assert_allclose(summary.basins[0].point, centre, atol=1e-4)


def test_both_of_two_basins_are_found_and_the_better_is_named_first():
    optimiser = Multistart(2, 1, budget=600)
    search(optimiser, two_wells, 600)
    first, second = optimiser.summary().basins[:2]
    assert first.point[0] == pytest.approx(0.8, abs=0.02)
    assert second.point[0] == pytest.approx(0.2, abs=0.02)
    assert first.cost < second.cost


def test_a_cost_without_residuals_is_searched_to_the_end_of_the_budget():
    optimiser = Multistart(2, 1, budget=300)
    points, _ = search(optimiser, lambda u: Outcome(float(((u - 0.4) ** 2).sum())), 300)
    assert len(points) == 300
    assert optimiser.stop() == "budget spent"


def test_a_told_screen_stands_in_for_its_own():
    optimiser = Multistart(2, 1, budget=200)
    screen = np.random.default_rng(1).random((30, 2))
    optimiser.tell(screen, [two_wells(u) for u in screen])
    first = optimiser.ask()
    best = screen[np.argmin([two_wells(u).cost for u in screen])]
    assert np.abs(first - best).max() < 0.02  # the differences of a Jacobian about the best point told


def test_a_batch_is_filled_from_several_searches():
    optimiser = Multistart(2, 1, budget=400, batch=12)
    screen = np.random.default_rng(1).random((64, 2))
    optimiser.tell(screen, [two_wells(u) for u in screen])
    assert len(optimiser.ask()) >= 12


def test_residuals_that_are_not_finite_are_not_used():
    optimiser = Multistart(2, 1, budget=100)
    points, _ = search(optimiser, lambda u: Outcome(float(((u - 0.4) ** 2).sum()), np.array([np.nan, 1.0])), 100)
    assert len(points) == 100


def test_importing_it_does_not_import_cma():
    code = "import sys, calib.optimisers.multistart; print('cma' in sys.modules or 'optuna' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


@pytest.mark.parametrize("name", ["ringdown6", "hartmann6", "impact6", "kinds6", "creep5"])
def test_it_reaches_the_target(name):
    assert evaluations_to_target(Multistart(PROBLEMS[name](3).dim, 3, 4000), PROBLEMS[name](3), 4000) < 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "median"),
    [
        ("ringdown6", 150),
        ("hartmann6", 300),
        ("rastrigin6", 1500),
        ("impact6", 100),
        ("rotated6", 2500),
        ("ringdown9", 220),
        ("failing6", 180),
        ("receptance8", 120),
        ("kinds6", 120),
        ("creep5", 100),
        ("ackley6", 1500),
        ("rosenbrock6", 500),
    ],
)
def test_it_reaches_the_target_from_several_seeds(name, median):
    """A sample: `tests/benchmarks/compare_optimisers.py` runs twenty seeds, beside peers.

    Last digits change the way of a search: the median of five seeds would differ by half from one processor to another.
    """
    spent = []
    for seed in range(9):
        problem = PROBLEMS[name](seed)
        spent.append(evaluations_to_target(Multistart(problem.dim, seed, 4000), problem, 4000))
    assert np.isfinite(spent).sum() >= 8
    assert np.median(spent) <= median
