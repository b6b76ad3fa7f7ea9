"""From pixels to the numbers on the axes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.digitise.axes import calibrated
from calib.errors import CalibError

PIXELS = np.array([[100.0, 500.0], [700.0, 500.0], [100.0, 50.0], [700.0, 50.0], [400.0, 300.0]])


@given(st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_a_page_that_is_turned_and_sheared_is_read_exactly(turn, shear, width, height):
    linear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [[1.0, shear], [0.0, -1.0]]
    true = np.diag([width, height]) @ linear
    points = PIXELS @ true.T + (3.0, -2.0)
    found = calibrated(PIXELS, points[:, 0], points[:, 1])
    inside = np.array([[250.0, 120.0], [333.3, 444.4]])
    size = np.abs(points).max()
    np.testing.assert_allclose(found(inside), inside @ true.T + (3.0, -2.0), rtol=1e-9, atol=1e-9 * size)
    np.testing.assert_allclose(found.pixels(found(inside)), inside, atol=1e-6)
    assert found.residual.max() < 1e-6


@pytest.mark.parametrize(("turn", "shear"), [(1.0, 0.0), (-2.0, 0.5), (0.0, -1.0)])
def test_the_posture_of_a_page_is_told(turn, shear):
    a, b = np.radians(turn), np.radians(turn - 90.0 - shear)
    along = np.column_stack([[80.0 * np.cos(a), 80.0 * np.sin(a)], [600.0 * np.cos(b), 600.0 * np.sin(b)]])
    points = (PIXELS - PIXELS[0]) @ np.linalg.inv(along).T
    found = calibrated(PIXELS, points[:, 0], points[:, 1])
    np.testing.assert_allclose(found.posture, (turn, shear), atol=1e-9)


def test_logarithmic_axes_are_read():
    x, y = 10.0 ** np.array([0, 3, 0, 3, 1.5]), np.array([0.0, 0.0, 9.0, 9.0, 4.0])
    found = calibrated(PIXELS, x, y, (True, False))
    np.testing.assert_allclose(found([[400.0, 275.0]]), [[10.0**1.5, 4.5]], rtol=1e-9)
    np.testing.assert_allclose(found.pixels([[10.0, 4.5]]), [[300.0, 275.0]], rtol=1e-9)


def test_the_residual_is_that_of_the_axis_points_and_its_modes_cover_it():
    rng = np.random.default_rng(0)
    truth = calibrated(PIXELS, PIXELS[:, 0], PIXELS[:, 1])
    inside = np.array([[200.0, 400.0], [600.0, 100.0]])
    squares = []
    for _ in range(400):
        clicked = PIXELS + 0.3 * rng.standard_normal(PIXELS.shape)
        found = calibrated(clicked, PIXELS[:, 0], PIXELS[:, 1])
        stated = (found.modes(inside) ** 2).sum(axis=0)
        squares.append((found(inside) - truth(inside)) ** 2 / stated)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("pixels", "x", "y", "said"),
    [
        (PIXELS[:2], [0, 1], [0, 1], "2 axis point"),
        ([[0, 0], [1, 1], [2, 2]], [0, 1, 2], [0, 1, 2], "on one line"),
        (PIXELS[:3], [5, 5, 5], [0, 0, 1], "the same x = 5"),
        (PIXELS[:3], [0, 1, 0], [0, 1, 0], "x and y parallel"),
        (PIXELS[:3], [0, 1, None], [0, 0, 1], "2 axis point(s) carry a number of x"),
    ],
)
def test_axis_points_that_do_not_tell_are_refused(pixels, x, y, said):
    with pytest.raises(CalibError) as raised:
        calibrated(pixels, x, y)
    assert said in str(raised.value)


def test_a_logarithmic_axis_carries_no_zero():
    with pytest.raises(CalibError, match="logarithmic axis, which cannot carry 0"):
        calibrated(PIXELS[:3], [0, 1, 0], [0, 0, 1], (True, False))
