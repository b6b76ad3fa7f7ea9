"""Claims about the evidence of competing models, on linear models whose evidence is known."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib.confidence.covariance import sandwich, unit_covariance
from calib.confidence.local import Linearised, local
from calib.confidence.model_comparison import comparable, in_words, width_in_words
from calib.confidence.posterior import LogLikelihood, sample_posterior
from calib.confidence.profiles import LocalAnalysis, fit_about
from calib.errors import CalibError
from calib.modelling.parameter import Space, Window

TIME = np.linspace(0.0, 200.0, 2000)
SIGMA = 0.1
COLUMNS = np.column_stack([np.sin(TIME), np.cos(2.0 * TIME), np.sin(3.0 * TIME)])
LENGTH = math.sqrt(TIME.size / 2.0)  # of a column, about


class Linear:
    """A model with the first columns, each coefficient from 0 to 1; the truth is 0.5 and a small third."""

    def __init__(self, dim, third=0.0, memory=0.0):
        kicks = SIGMA * np.random.default_rng(3).standard_normal(TIME.size)
        for k in range(1, kicks.size):
            kicks[k] += memory * kicks[k - 1]
        self.signal = COLUMNS @ [0.5, 0.5, 0.5 + third * SIGMA / LENGTH] + kicks
        self.dim = dim
        self.space = Space({name: Window(0.0, 1.0) for name in "abc"[:dim]})

    def residuals(self, u):
        full = np.full(3, 0.5)
        full[: self.dim] += np.asarray(u) - 0.5
        return COLUMNS @ full - self.signal

    def __call__(self, points):
        residuals = [self.residuals(u) for u in points]
        return [SimpleNamespace(cost=float(np.linalg.norm(r)), residuals=r, status="ok", kind=None) for r in residuals]

    @property
    def best(self):
        columns = COLUMNS[:, : self.dim]
        return np.full(self.dim, 0.5) - np.linalg.lstsq(columns, self.residuals(np.full(self.dim, 0.5)), rcond=None)[0]

    def analysis(self):
        [outcome] = self([self.best])
        return LocalAnalysis(outcome, local(self, self.space, self.best, outcome=outcome))

    def log_evidence(self, least):
        """By the integral of a normal density, over the likelihood of the sum of squares `least`."""
        columns = COLUMNS[:, : self.dim]
        square = float(np.sum(self.residuals(self.best) ** 2))
        sign, logarithm = np.linalg.slogdet(2.0 * math.pi * SIGMA**2 * np.linalg.inv(columns.T @ columns))
        return -0.5 * (square - least) / SIGMA**2 + 0.5 * logarithm


def sampled_evidence(model, common):
    fit = fit_about(model.analysis(), common.likelihood, model)
    logarithm = LogLikelihood(common.likelihood, model.best)

    def log_likelihood(points):
        return np.array([logarithm(point) for point in fit.at(points)])

    found = sample_posterior(log_likelihood, lambda points: points, model.dim, seed=1, live_points=100)
    return found.log_evidence + common.log_best, found.log_evidence_error


@pytest.mark.parametrize("third", [0.0, 2.0, 6.0])
def test_the_likelihoods_of_the_best_points_differ_as_the_sums_of_squares_over_the_noise(third):
    with_it, without = Linear(3, third), Linear(2, third)
    shared = comparable([without.analysis(), with_it.analysis()], ["without", "with"])
    squares = [float(np.sum(model.residuals(model.best) ** 2)) for model in (without, with_it)]
    assert shared[1].log_best == 0.0
    assert shared[0].log_best == pytest.approx(-0.5 * (squares[0] - squares[1]) / SIGMA**2, rel=0.1, abs=0.05)


def test_both_models_have_the_noise_of_the_one_that_fits_better():
    with_it, without = Linear(3, 60.0), Linear(2, 60.0)  # the misfit of the poorer one is twice the noise
    shared = comparable([without.analysis(), with_it.analysis()], ["without", "with"])
    known = SIGMA**2 * np.linalg.inv(COLUMNS[:, :2].T @ COLUMNS[:, :2])
    assert np.diag(shared[0].likelihood.covariance) == pytest.approx(np.diag(known), rel=0.15)


def test_correlated_noise_lowers_the_difference_of_slow_signals():
    memory = 0.8
    with_it, without = Linear(3, 20.0, memory), Linear(2, 20.0, memory)
    shared = comparable([without.analysis(), with_it.analysis()], ["without", "with"])
    squares = [float(np.sum(model.residuals(model.best) ** 2)) for model in (without, with_it)]
    step = 3.0 * (TIME[1] - TIME[0])
    density = 1.0 / abs(1.0 - memory * np.exp(1j * step)) ** 2  # of an autoregression, at the frequency of the column
    known = -0.5 * (squares[0] - squares[1]) / (SIGMA**2 * density)
    assert shared[0].log_best == pytest.approx(known, rel=0.35)


@pytest.mark.slow
@pytest.mark.parametrize("third", [0.0, 5.0])
def test_a_bayes_factor_is_that_of_the_normal_integral(third):
    with_it, without = Linear(3, third), Linear(2, third)
    shared = comparable([without.analysis(), with_it.analysis()], ["without", "with"])
    least = float(np.sum(with_it.residuals(with_it.best) ** 2))
    known = with_it.log_evidence(least) - without.log_evidence(least)
    (one, first), (other, second) = (sampled_evidence(*pair) for pair in zip((without, with_it), shared, strict=True))
    assert other - one == pytest.approx(known, abs=0.05 * 0.5 * third**2 + 4.0 * math.hypot(first, second))
    assert (other > one) == (third > 0.0)


def test_models_of_other_residuals_are_refused():
    whole = Linear(2).analysis()
    cut = replace(whole.confidence.linearised, residuals=whole.confidence.linearised.residuals[:1000])
    half = replace(whole, confidence=replace(whole.confidence, linearised=cut))
    with pytest.raises(CalibError, match="short has 1000 residuals, and long has 2000.*same records and terms"):
        comparable([whole, half], ["long", "short"])


def test_models_without_derivatives_are_refused():
    whole = Linear(2).analysis()
    rough = replace(whole, confidence=replace(whole.confidence, linearised=None, reason="they are rough"))
    with pytest.raises(CalibError, match="the residuals of rough have no derivatives .*they are rough.*--compare"):
        comparable([whole, rough], ["whole", "rough"])


@pytest.mark.parametrize(
    ("factor", "words"), [(0.5, "bare mention"), (-2.0, "positive"), (4.0, "strong"), (9.0, "very strong")]
)
def test_bayes_factors_have_the_words_of_kass_and_raftery(factor, words):
    assert words in in_words(factor)


def test_the_window_that_would_make_both_equal_is_told():
    assert "wider by a factor of 7.4 in all" in width_in_words(2.0)
    assert "wider by a factor of 10^13 in all" in width_in_words(30.0)
    assert width_in_words(3000.0) == "no width of the windows would change that"


@pytest.mark.parametrize(("number", "parameters"), [(10, 4), (15, 5), (60, 5)])
def test_of_white_noise_of_unknown_level_sums_of_squares_to_the_power_of_half_their_number_are_likelihoods(
    number, parameters
):
    """The level integrated out leaves S^(-n/2) of n residuals: Box & Tiao 1973, section 2.7."""
    rng, both = np.random.default_rng(number), []
    for _ in range(300):
        columns, noise = rng.standard_normal((number, parameters)), rng.standard_normal(number)
        analyses = []
        for count in (parameters - 1, parameters):
            own = columns[:, :count]
            residuals = noise - own @ np.linalg.lstsq(own, noise, rcond=None)[0]
            covariance, freedom = sandwich(own, residuals, np.zeros(number, dtype=int))
            linearised = Linearised(residuals, own, unit_covariance(own), covariance, freedom)
            confidence = SimpleNamespace(linearised=linearised, reason="")
            analyses.append(LocalAnalysis(None, confidence, None, None))
        fewer, more = comparable(analyses, ["fewer", "more"])
        squares = [float(np.sum(one.confidence.linearised.residuals**2)) for one in analyses]
        both.append((more.log_best - fewer.log_best, 0.5 * number * math.log(squares[0] / squares[1])))
    found, exact = np.mean(both, axis=0)
    assert 0.7 * exact < found < 1.05 * exact
