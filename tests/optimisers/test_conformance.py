"""The optimisers fulfil their contract, and one that does not is found out."""

from importlib.util import find_spec

import numpy as np
import pytest

from calib.optimisers.cma import CmaEs
from calib.optimisers.multistart import Multistart
from calib.optimisers.optuna import OptunaSampler
from calib.optimisers.scipy import Scipy
from calib.optimisers.surrogate import Surrogate
from calib.testing.optimiser_suite import BOWL, OptimiserSuite


class TestMultistart(OptimiserSuite):
    close_enough = 1e-3

    def make(self, dim, seed, budget, batch):
        return Multistart(dim, seed, budget, batch)


class TestCmaEs(OptimiserSuite):
    close_enough = 1e-2

    def make(self, dim, seed, budget, batch):
        return CmaEs(dim, seed, budget, batch)


class TestDifferentialEvolution(OptimiserSuite):
    def make(self, dim, seed, budget, batch):
        return Scipy(dim, seed, budget, batch)


class TestDualAnnealing(OptimiserSuite):
    def make(self, dim, seed, budget, batch):
        return Scipy(dim, seed, budget, batch, method="dual_annealing")


class TestLeastSquares(OptimiserSuite):
    close_enough = 1e-3

    def make(self, dim, seed, budget, batch):
        return Scipy(dim, seed, budget, batch, method="least_squares")


class TestTpe(OptimiserSuite):
    budget = 120
    close_enough = 0.01

    def make(self, dim, seed, budget, batch):
        return OptunaSampler(dim, seed, budget, batch)

    def test_points_at_random_do_not_come_so_near(self):
        drawn = OptunaSampler(2, 1, self.budget, sampler="random")
        assert np.abs(self.lowest(drawn, BOWL[:2]) - BOWL[:2]).max() > self.close_enough


class TestNsgaii(OptimiserSuite):
    budget = 250

    def make(self, dim, seed, budget, batch):
        return OptunaSampler(dim, seed, budget, batch, sampler="nsgaii")


class TestQmc(OptimiserSuite):
    budget = 250

    def make(self, dim, seed, budget, batch):
        return OptunaSampler(dim, seed, budget, batch, sampler="qmc")


@pytest.mark.skipif(find_spec("torch") is None, reason="Optuna's gp needs torch")
class TestGaussianProcess(OptimiserSuite):
    budget = 40
    close_enough = 0.1

    def make(self, dim, seed, budget, batch):
        return OptunaSampler(dim, seed, budget, batch, sampler="gp")


class TestOptunaCmaes(OptimiserSuite):
    close_enough = 0.1

    def make(self, dim, seed, budget, batch):
        return OptunaSampler(dim, seed, budget, batch, sampler="cmaes")


class TestSurrogate(OptimiserSuite):
    budget = 40
    close_enough = 1e-2

    def make(self, dim, seed, budget, batch):
        return Surrogate(dim, seed, budget, batch)


class Stuck:
    """An optimiser that looks at one corner only: the control that the suite has to find out."""

    def __init__(self, dim, budget):
        self.dim, self.left = dim, budget

    def ask(self):
        return np.zeros((1, self.dim))

    def tell(self, x, outcomes):
        self.left -= len(x)

    def stop(self):
        return None if self.left > 0 else "budget spent"

    def close(self):
        pass


class Unseeded(Stuck):
    """An optimiser whose points nobody can replay."""

    def ask(self):
        return np.random.default_rng().random((1, self.dim))


def suite_of(kind):
    suite = OptimiserSuite()
    suite.make = lambda dim, seed, budget, batch: kind(dim, budget)
    return suite, lambda dim=2, seed=1, budget=300, batch=1: kind(dim, budget)


def test_the_suite_finds_out_an_optimiser_that_does_not_search():
    suite, making = suite_of(Stuck)
    assert np.abs(suite.lowest(making(2), BOWL[:2]) - BOWL[:2]).max() > suite.close_enough
    with pytest.raises(AssertionError):
        suite.test_it_finds_the_least_point_of_a_bowl(making)


def test_the_suite_finds_out_an_optimiser_that_cannot_be_replayed():
    suite, making = suite_of(Unseeded)
    with pytest.raises(AssertionError):
        suite.test_the_same_outcomes_lead_to_the_same_points_bit_for_bit(making, 1)
