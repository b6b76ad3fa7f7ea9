"""Subset simulation on parts of the unit cube whose volume is known."""

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import qmc
from stated_interval import half_widths

from calib.confidence.window.observed import Observed
from calib.confidence.window.region import emulated
from calib.confidence.window.sampling import fine_sample
from calib.confidence.window.share import volume_share
from calib.confidence.window.subset import subset_simulation

AXES = np.array([0.3, 0.3, 0.25, 0.2, 0.1, 0.043])  # of an oblique ellipsoid of 1e-4 of the cube
SEEDS = range(8)


@pytest.fixture(scope="module")
def turned():
    """A rotation of six axes."""
    return np.linalg.qr(np.random.default_rng(0).standard_normal((6, 6)))[0]


def distance(points, turned):
    return (((points - 0.5) @ turned / AXES) ** 2).sum(axis=1)


def volume():
    return float(np.exp(3.0 * np.log(np.pi) - gammaln(4.0)) * AXES.prod())


def simulated(turned, number, seed, integrand=lambda points: np.zeros(len(points))):
    return subset_simulation(lambda points: -distance(points, turned), integrand, 6, -1.0, 1.0, number, seed)


@pytest.mark.slow
def test_a_thin_oblique_part_has_its_volume_and_an_honest_error(turned):
    errors = []
    for seed in SEEDS:
        part = simulated(turned, 1 << 11, seed)
        assert part.weights.sum() == pytest.approx(1.0)
        assert (distance(part.points[: 1 << 11], turned) <= 1.0).all()
        errors.append(np.log(part.weights[: 1 << 11].sum() / volume()) / np.sqrt(part.relative_variance))
    assert volume() == pytest.approx(1e-4, rel=0.01)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 2.0  # as independent points have it is the least error


@pytest.mark.slow
def test_the_points_are_spread_evenly_over_the_part(turned):
    points = simulated(turned, 1 << 12, 1).points[: 1 << 12]
    along = (points - 0.5) @ turned / AXES  # of a ball: each coordinate has the variance 1 / (dim + 2)
    np.testing.assert_allclose(along.var(axis=0), 1.0 / 8.0, rtol=0.12)
    np.testing.assert_allclose(along.mean(axis=0), 0.0, atol=0.04)


@pytest.mark.slow
def test_all_points_with_their_weights_stand_for_the_whole_cube(turned):
    """A six-dimensional normal distribution, most of which is far from its centre: below the last level."""
    part = simulated(turned, 1 << 13, 3)
    integrals = part.weights * np.exp(-distance(part.points, turned))
    assert integrals.sum() == pytest.approx(np.pi**3 * AXES.prod(), rel=0.2)
    assert integrals[1 << 13 :].sum() > integrals[: 1 << 13].sum()


def test_where_no_window_is_the_levels_come_to_an_end(turned):
    """A boundary that no point reaches: the part that is left is soon too small to matter."""
    part = subset_simulation(
        lambda points: -distance(points, turned), lambda points: np.full(len(points), 1e-3), 6, 1.0, 0.5, 256, seed=1
    )
    assert 1e-6 < part.weights.min() * 256 < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_window_of_a_twenty_thousandth_of_the_box_has_its_share(turned, seed):
    """Half an ellipsoid: a misfit that is a quadratic form, and a contact that is lost beyond a plane."""
    points = np.vstack([np.full(6, 0.5), qmc.Sobol(6, seed=seed).random(128)])
    contact = (points - 0.5) @ turned[:, 0] + 1e-9
    margins = np.column_stack([1.0 - distance(points, turned), contact])
    observed = Observed(points, np.ones(len(points), dtype=bool), margins, ("misfit", "contact"), (False, False))
    region = emulated(observed)
    sample = fine_sample(region, points[:1], seed)
    share = volume_share(region, sample, observed, seed)
    assert half_widths(share, 0.5 * volume()) < 2.0
    assert share.high < 2.0 * share.low
    assert share.misclassified < 0.1 * share.value
    assert region.probability(sample.points) == pytest.approx(sample.probability, abs=1e-9)
    assert (sample.low < 0.5).all()
    assert (sample.high > 0.5).all()


def test_a_plateau_ends_it():
    def nothing(points):
        return np.zeros(len(points))

    part = subset_simulation(nothing, nothing, 2, 1.0, 0.5, number=256, seed=1)
    np.testing.assert_array_equal(part.weights, 1.0 / 256)
