"""How near trials come to measured features."""

from types import SimpleNamespace

import pytest

from calib.study.reachability import reach


def reached(measured, *simulated, tolerance=0.0):
    feature = {"label": "rms", "record": "r", "body": "tip", "unit": "m", "measured": measured, "tolerance": tolerance}
    [own] = reach([SimpleNamespace(features=[feature | {"simulated": value}]) for value in simulated])
    return own


def test_the_nearest_simulated_value_is_told_and_how_far_off_the_range_is():
    own = reached(2e-3, 5e-4, None, 1.5e-3, tolerance=1e-4)
    assert (own.nearest, own.reached) == (1.5e-3, False)
    assert own.off == pytest.approx(5e-4)
    assert own.percent == pytest.approx(25.0)


def test_what_lies_between_simulated_values_is_reached():
    own = reached(2e-3, 1e-3, 3.5e-3)
    assert (own.off, own.reached) == (0.0, True)


def test_rounding_beside_what_was_measured_is_zero():
    own = reached(3e-5, 1e-19, 2e-19)
    assert own.nearest == 0.0
    assert "nearest 0 m" in str(own.summary())
