"""Claims about the sampled posterior distribution, on likelihoods whose posterior is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from calib.confidence import posterior
from calib.confidence.constrained import FittedPoint
from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.modes import separate_modes
from calib.confidence.posterior import LogLikelihood, expected_evaluations, sample_posterior
from calib.confidence.prior import Prior, positions
from calib.confidence.sample import posterior_result
from calib.errors import CalibError
from calib.modelling.parameter import Space, Window
from calib.report.pages.confidence import sampling_remarks

LIVE_POINTS = 150


def same(points):
    return points


@pytest.mark.slow
def test_a_normal_likelihood_has_its_evidence_mean_and_spread():
    covariance = 0.04**2 * np.array([[1.0, 0.6], [0.6, 2.0]])
    normal = stats.multivariate_normal([0.4, 0.6], covariance)
    found = sample_posterior(normal.logpdf, same, 2, seed=1, live_points=LIVE_POINTS)
    deviation = np.sqrt(np.diag(covariance))
    assert found.log_evidence == pytest.approx(0.0, abs=0.1)
    assert found.log_evidence == pytest.approx(0.0, abs=4.0 * found.log_evidence_error)
    assert np.all(np.abs(found.points.mean(axis=0) - [0.4, 0.6]) < 0.1 * deviation)
    assert found.points.std(axis=0) == pytest.approx(deviation, rel=0.1)
    assert np.corrcoef(found.points.T)[0, 1] == pytest.approx(0.6 / math.sqrt(2.0), abs=0.08)
    assert found.effective_size >= 1000.0
    assert found.log_likelihood == pytest.approx(normal.logpdf(found.points))


@pytest.mark.slow
def test_two_modes_have_their_weights():
    left, right = (stats.multivariate_normal(centre, 0.03**2 * np.eye(2)) for centre in ([0.25, 0.3], [0.75, 0.6]))

    def mixture(points):
        return np.logaddexp(math.log(0.3) + left.logpdf(points), math.log(0.7) + right.logpdf(points))

    found = sample_posterior(mixture, same, 2, seed=1, live_points=LIVE_POINTS)
    assert np.mean(found.points[:, 0] < 0.5) == pytest.approx(0.3, rel=0.1)
    assert [own.size / len(found.points) for own in separate_modes(found.points)] == pytest.approx([0.7, 0.3], rel=0.1)
    assert found.log_evidence == pytest.approx(0.0, abs=0.1)


@pytest.mark.slow
def test_the_exploration_of_a_ridge_ends_beside_a_narrow_mode_of_which_few_points_are_known():
    """The ridge depends on one parameter of three; shells inside shells of it never lessened the share of the other."""
    ridge = stats.norm(0.5, 0.02)
    mode = stats.multivariate_normal([0.8, 0.3, 0.6], np.diag([0.008, 0.06, 0.06]) ** 2)

    def mixture(points):
        return np.logaddexp(math.log(0.85) + ridge.logpdf(points[:, 0]), math.log(0.15) + mode.logpdf(points))

    found = sample_posterior(mixture, same, 3, seed=3, live_points=100)
    assert found.complete
    assert np.mean(found.points[:, 0] > 0.65) == pytest.approx(0.15, abs=0.05)
    assert found.log_evidence == pytest.approx(0.0, abs=0.1)


@pytest.mark.slow
def test_a_banana_has_its_evidence_mean_and_spread():
    """A normal distribution with a bend, whose Jacobian is 1; 0.1 % of it are outside the window."""

    def bent(points):
        a, b = points.T
        return stats.norm.logpdf(a, 0.5, 0.1) + stats.norm.logpdf(b - 0.3 - 6.0 * (a - 0.5) ** 2, 0.0, 0.03)

    found = sample_posterior(bent, same, 2, seed=1, live_points=LIVE_POINTS)
    mean, deviation = np.array([0.5, 0.36]), np.array([0.1, math.hypot(0.03, 6.0 * 0.1**2 * math.sqrt(2.0))])
    assert found.log_evidence == pytest.approx(0.0, abs=0.1)
    assert np.all(np.abs(found.points.mean(axis=0) - mean) < 0.1 * deviation)
    assert found.points.std(axis=0) == pytest.approx(deviation, rel=0.1)
    assert found.complete


@pytest.mark.slow
def test_a_sampling_that_reaches_its_limit_ends_and_says_so(monkeypatch):
    monkeypatch.setattr(posterior, "MAX_EVALUATIONS_RATIO", 0.15)
    limit = 0.15 * expected_evaluations(2, live_points=LIVE_POINTS)
    found = sample_posterior(
        stats.multivariate_normal([0.4, 0.6], 0.01**2 * np.eye(2)).logpdf, same, 2, seed=1, live_points=LIVE_POINTS
    )
    assert not found.complete
    assert limit <= found.evaluations <= limit + posterior.BATCH
    space = Space({"a": Window(0.0, 1.0), "b": Window(0.0, 1.0)})
    result = posterior_result(space, {"a": "1", "b": "1"}, {}, found)
    assert result.status == "limit"
    [remark] = sampling_remarks(replace(result, modes=()))
    assert remark.startswith(
        f"the sampling ended at its limit, after {found.evaluations} evaluations, with an effective"
    )


@pytest.mark.slow
def test_a_single_parameter_and_its_prior_combine_as_normals_do():
    space = Space({"a": Window(-10.0, 10.0)})
    prior = {"a": Prior("normal", 1.0, 0.5)}

    def likelihood(points):
        return stats.norm.logpdf(20.0 * points[:, 0] - 10.0, 2.0, 0.5)

    found = sample_posterior(
        likelihood, lambda points: positions(space, prior, points), 1, seed=1, live_points=LIVE_POINTS
    )
    values = 20.0 * found.points[:, 0] - 10.0
    assert values.mean() == pytest.approx(1.5, abs=0.1 * 0.5 / math.sqrt(2.0))
    assert values.std() == pytest.approx(0.5 / math.sqrt(2.0), rel=0.1)
    assert found.log_evidence == pytest.approx(stats.norm.logpdf(2.0, 1.0, math.sqrt(0.5)), abs=0.1)


def test_priors_are_cut_at_the_window():
    probability = np.linspace(0.001, 0.999, 999)
    narrow = Window(0.0, 2.0)
    normal = 2.0 * Prior("normal", 1.0, 1.0).position(probability, narrow)
    assert normal == pytest.approx(stats.truncnorm.ppf(probability, -1.0, 1.0, 1.0, 1.0))
    wide = Window(1e-3, 1e3, "log")
    lognormal = [wide.value(x) for x in Prior("lognormal", 2.0, 0.5).position(probability, wide)]
    assert lognormal == pytest.approx(stats.lognorm.ppf(probability, 0.5, scale=2.0), rel=1e-6)
    half = Window(0.0, 3.0)
    assert 3.0 * Prior("lognormal", 2.0, 0.5).position(np.array([1.0]), half) == pytest.approx([3.0])


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (Prior("normal", 1.0, 0.0), "expected a finite standard deviation above 0, got 0"),
        (Prior("normal", 1.0, -0.5), "expected a finite standard deviation above 0, got -0.5"),
        (Prior("normal", math.nan, 0.5), "expected a finite mean or median, got nan"),
        (Prior("normal", math.inf, 0.5), "expected a finite mean or median, got inf"),
        (Prior("lognormal", -1.0, 0.5), "expected a median above 0, got -1"),
        (Prior("normal", 20.0, 0.5), r"a probability of .* in the window \[0, 2\] \(SI\)"),
    ],
)
def test_a_prior_that_cannot_be_is_refused(prior, message):
    with pytest.raises(CalibError, match=message):
        prior.check(Window(0.0, 2.0))


def test_a_lognormal_prior_of_a_window_without_a_value_above_0_is_refused():
    with pytest.raises(CalibError, match=r"the window \[-2, 0\] \(SI\) has none; take a normal one"):
        Prior("lognormal", 1.0, 0.5).check(Window(-2.0, 0.0))


def test_of_noise_whose_level_is_known_the_posterior_is_normal():
    likelihood = AdjustedLikelihood(1e-3, np.array([[1.0]]), np.array([[1e-4]]), np.array([np.inf]))
    logarithm = LogLikelihood(likelihood, np.array([0.5]))
    assert logarithm(FittedPoint((0.52,), 1e-3 + 4e-4, 1.0)) == pytest.approx(-2.0, rel=1e-3)


@pytest.mark.parametrize("freedom", [3.0, 12.0])
def test_of_a_linear_model_of_few_residuals_the_posterior_is_students_t(freedom):
    """As are its local interval and its profile."""
    likelihood = AdjustedLikelihood(1e-3, np.array([[1.0]]), np.array([[1e-4]]), np.array([freedom]))
    logarithm = LogLikelihood(likelihood, np.array([0.5]))
    shift = np.linspace(-0.5, 0.5, 4001)
    density = np.exp([logarithm(FittedPoint((0.5 + d,), 1e-3 + d**2, 1.0)) for d in shift])
    known = stats.t.pdf(shift / 0.01, freedom)
    assert density / density.sum() == pytest.approx(known / known.sum(), abs=2e-3 * known.max() / known.sum())


def test_what_cannot_be_compared_is_less_likely_and_has_a_slope():
    spread = np.diag([0.01, 0.02]) ** 2
    likelihood = AdjustedLikelihood(1e-3, spread / 1e-4, spread, np.full(2, 1e6))
    logarithm = LogLikelihood(likelihood, np.array([0.5, 0.5]))

    def point(x, square, cost):
        return FittedPoint((x, 0.5), square, cost)

    good = [logarithm(point(0.5 + 0.01 * k, 1e-3 + 1e-4 * k**2, 1.0)) for k in range(4)]
    assert good == pytest.approx([0.0, -0.5, -2.0, -4.5], rel=1e-3)
    worst = logarithm(point(0.9, 25.0, 9.0))
    wrong = [logarithm(point(0.6, math.inf, cost)) for cost in (10.0, 15.0, 21.0)]
    failed = [logarithm(point(x, math.inf, math.inf)) for x in (0.6, 0.9, 1.0)]
    ordered = [*good, worst, *wrong, *failed]
    assert ordered == sorted(ordered, reverse=True)
    assert len(set(ordered)) == len(ordered)
    assert all(math.isfinite(one) for one in ordered)
