"""Claims about draws that a confirming simulator reweights, on normal distributions."""

import math

import numpy as np
import pytest

from calib.confidence.importance import Reweighted, confirmed_result

DRAWS = np.random.default_rng(2).standard_normal(4000)


def log_normal(x, mean):
    return -0.5 * (x - mean) ** 2


def result(shift, draws=DRAWS):
    return confirmed_result(log_normal(draws, 0.0), log_normal(draws, shift), {"gain": draws}, {"gain": 1.0})


@pytest.mark.parametrize("shift", [0.0, 0.3, -0.7])
def test_a_shifted_normal_distribution_is_found_by_its_weights(shift):
    found = result(shift)
    [gain] = found.parameters
    assert found.reweighted
    assert found.effective_size / DRAWS.size == pytest.approx(math.exp(-(shift**2)), abs=0.05)
    assert gain.mean == pytest.approx(shift, abs=0.06)
    assert gain.standard_deviation == pytest.approx(1.0, abs=0.06)
    assert gain.shift == pytest.approx(shift, abs=0.06)
    assert found.spread == pytest.approx(abs(shift), abs=0.03)


@pytest.mark.parametrize(("k", "usable"), [(0.1, True), (0.4, True), (0.95, False)])
def test_the_tail_of_the_weights_has_its_pareto_shape(k, usable):
    """Draws of an exponential distribution have, for one of the rate 1 - k, weights of Pareto's of the shape k."""
    draws = np.random.default_rng(5).exponential(size=20000)
    weighted = Reweighted.of(-draws, -(1.0 - k) * draws)
    assert weighted.pareto_k == pytest.approx(k, abs=0.2)  # from 425 weights its standard error is (1 + k) / 21
    assert weighted.usable == usable
    found = confirmed_result(-draws, -(1.0 - k) * draws, {"gain": draws}, {"gain": 1.0})
    assert f"draws are effective, Pareto k {weighted.pareto_k:.2f}" in found.text
    assert ("(0.7 at most is wanted)" in found.text) == (not usable)
    assert (found.pareto_k, found.reweighted) == (pytest.approx(weighted.pareto_k), usable)


def test_a_distribution_elsewhere_is_not_reweighted():
    found = result(6.0)
    assert not found.reweighted
    assert found.parameters == ()
    assert "the confirming one has another; their log-likelihoods differ by 6" in found.text


def test_draws_that_fail_have_no_weight():
    confirmed = np.where(DRAWS > 0.0, -math.inf, log_normal(DRAWS, 0.0))
    found = confirmed_result(log_normal(DRAWS, 0.0), confirmed, {"gain": DRAWS}, {"gain": 1.0})
    assert found.failed == int(np.sum(DRAWS > 0.0))
    assert found.parameters[0].mean == pytest.approx(-math.sqrt(2.0 / math.pi), abs=0.05)


def test_where_all_fail_nothing_is_reweighted():
    found = confirmed_result(np.zeros(5), np.full(5, -math.inf), {"gain": np.ones(5)}, {"gain": 1.0})
    assert (found.failed, found.effective_size, found.reweighted) == (5, 0.0, False)
    assert Reweighted.of(np.zeros(5), np.full(5, -math.inf)).weights.sum() == 0.0
