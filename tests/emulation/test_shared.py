"""A vector emulated with one covariance: exact at its points, its slope, its uncertainty, what its lengths say."""

import numpy as np
import pytest

from calib.emulation.shared import SHARED_LENGTH_BOUNDS, fit_shared
from calib.emulation.trend import Trend


def curve(points):
    """Three smooth quantities of points (n, 3), the last without the third coordinate."""
    x, y, z = points.T
    return np.column_stack([np.sin(3 * x) + y * z, np.cos(2 * y + x) - 0.5 * z, 4 * x])


POINTS = np.random.default_rng(1).random((40, 3))
ELSEWHERE = np.random.default_rng(2).random((200, 3))


@pytest.mark.parametrize("trend", list(Trend))
def test_it_returns_its_own_values_and_knows_them(trend):
    emulator = fit_shared(POINTS, curve(POINTS), trend)
    emulated = emulator.predict(POINTS)
    np.testing.assert_allclose(emulated.mean, curve(POINTS), atol=1e-5)
    np.testing.assert_allclose(emulator.mean(POINTS), emulated.mean, atol=1e-12)
    assert (emulated.std < 1e-3 * emulator.scale).all()


def test_it_predicts_a_smooth_curve_and_is_rarely_off_by_more_than_it_says():
    emulated = fit_shared(POINTS, curve(POINTS)).predict(ELSEWHERE)
    error = np.abs(emulated.mean - curve(ELSEWHERE))
    assert (error.max(axis=0) < 0.3).all()
    assert (error < 2 * emulated.std + 1e-6).mean() > 0.9


@pytest.mark.parametrize("trend", [Trend.CONSTANT, Trend.LINEAR])
def test_its_slope_is_that_of_its_mean(trend):
    emulator, u, h = fit_shared(POINTS, curve(POINTS), trend), ELSEWHERE[0], 1e-6
    sides = [u + sign * h * np.eye(3) for sign in (1, -1)]
    differences = (emulator.mean(sides[0]) - emulator.mean(sides[1])) / (2 * h)
    np.testing.assert_allclose(emulator.slope(u), differences.T, atol=1e-5)


def test_a_linear_quantity_is_found_from_few_points():
    few = POINTS[:6]
    linear = few @ np.array([[1.0, -2.0], [0.5, 0.0], [3.0, 1.0]])
    expected = ELSEWHERE @ np.array([[1.0, -2.0], [0.5, 0.0], [3.0, 1.0]])
    np.testing.assert_allclose(fit_shared(few, linear).mean(ELSEWHERE), expected, atol=0.02)


def test_a_coordinate_that_does_nothing_is_long_but_not_ignored():
    lengths = fit_shared(POINTS, np.sin(9 * POINTS[:, :1]), Trend.CONSTANT).lengths
    assert lengths[0] < 0.5 * lengths[1:].min()
    assert lengths.max() <= SHARED_LENGTH_BOUNDS[1]


def test_more_points_make_it_sure_where_they_lie():
    emulator = fit_shared(POINTS, curve(POINTS))
    more = emulator.extended(ELSEWHERE[:2], curve(ELSEWHERE[:2]))
    np.testing.assert_allclose(more.mean(ELSEWHERE[:2]), curve(ELSEWHERE[:2]), atol=1e-5)
    assert (more.predict(ELSEWHERE).std <= emulator.predict(ELSEWHERE).std * (1 + more.scale / emulator.scale)).all()
    np.testing.assert_array_equal(more.lengths, emulator.lengths)


def test_points_that_repeat_and_values_that_are_constant_are_taken():
    twice = np.vstack([POINTS[:5], POINTS[:5] + 1e-9])
    assert np.isfinite(fit_shared(twice, curve(twice)).mean(ELSEWHERE)).all()
    assert (fit_shared(POINTS[:5], np.zeros((5, 2))).predict(ELSEWHERE).std == 0).all()
