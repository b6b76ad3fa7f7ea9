"""Claims about the modes that a sample is taken apart into."""

import numpy as np
import pytest

from calib.confidence.modes import separate_modes
from calib.confidence.posterior import Posterior
from calib.confidence.sample import posterior_result
from calib.modelling.parameter import Space, Window


def normal(rng, n, centre, deviation):
    return centre + deviation * rng.standard_normal((n, len(centre)))


def shares(points):
    return [own.size / len(points) for own in separate_modes(points)]


@pytest.mark.parametrize("dim", [1, 2, 6])
@pytest.mark.parametrize("n", [200, 1000])
def test_a_sample_of_one_mode_is_not_taken_apart(dim, n):
    for seed in range(20):
        rng = np.random.default_rng([dim, n, seed])
        assert len(separate_modes(rng.random((n, dim)))) == 1  # flat, as of idle parameters
        assert len(separate_modes(normal(rng, n, np.full(dim, 0.5), 0.01))) == 1
        assert len(separate_modes(rng.exponential(0.05, (n, dim)))) == 1
        bent = normal(rng, n, np.zeros(dim), 1.0)
        bent[:, -1] += 3.0 * bent[:, 0] ** 2
        assert len(separate_modes(bent)) == 1


def test_modes_beside_idle_parameters_are_found_with_their_shares():
    rng = np.random.default_rng(1)
    points = rng.random((1000, 6))
    points[:, 2] = np.where(rng.random(1000) < 0.3, 0.25, 0.75) + 0.03 * rng.standard_normal(1000)
    left = points[:, 2] < 0.5
    assert shares(points) == [np.mean(~left), np.mean(left)]


def test_modes_that_no_parameter_alone_separates_are_found_along_a_principal_axis():
    rng = np.random.default_rng(2)
    along, across = rng.standard_normal(1000), rng.choice([-1.0, 1.0], 1000) + 0.1 * rng.standard_normal(1000)
    points = np.column_stack([3.0 * along + across, 3.0 * along - across])
    assert sorted(shares(points)) == pytest.approx([0.5, 0.5], abs=0.05)


def test_three_modes_are_three_and_draws_that_stand_twice_make_none():
    rng = np.random.default_rng(3)
    centres = np.array([[0.2, 0.2], [0.8, 0.2], [0.5, 0.9]])
    points = np.vstack([normal(rng, n, centre, 0.02) for n, centre in zip((500, 300, 200), centres, strict=True)])
    assert shares(points) == [0.5, 0.3, 0.2]
    one = normal(rng, 300, np.full(2, 0.5), 0.02)
    assert shares(np.vstack([one, one[:100], one[:50]])) == [1.0]


def test_modes_that_touch_and_single_draws_afar_are_no_modes_of_their_own():
    rng = np.random.default_rng(4)
    touching = np.vstack([normal(rng, 500, [x, 0.5], 0.1) for x in (0.35, 0.65)])
    assert shares(touching) == [1.0]
    far = np.vstack([normal(rng, 990, [0.3, 0.3], 0.01), normal(rng, 10, [0.9, 0.9], 0.01)])
    assert shares(far) == [1.0]


def test_the_modes_of_a_posterior_have_values_in_si():
    rng = np.random.default_rng(5)
    points = np.vstack([normal(rng, 700, [0.75, 0.5], 0.02), normal(rng, 300, [0.25, 0.5], 0.02)])
    space = Space({"gap": Window(0.0, 2e-3), "damping": Window(1.0, 100.0, "log")})
    units = {"gap": "m", "damping": "1/s"}
    heavy, light = posterior_result(space, units, {}, Posterior(points, np.zeros(1000), 0.0, 0.1, 1e3, 5000)).modes
    assert (heavy.share, light.share) == (0.7, 0.3)
    assert heavy.mean["gap"] == pytest.approx(1.5e-3, rel=0.01)
    assert light.standard_deviation["gap"] == pytest.approx(0.04e-3, rel=0.15)
    one = Posterior(points[:700], np.zeros(700), 0.0, 0.1, 700.0, 5000)
    assert posterior_result(space, units, {}, one).modes == ()
