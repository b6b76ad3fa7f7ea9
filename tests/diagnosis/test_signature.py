"""Steps of differences."""

import numpy as np
import pytest

from calib.diagnosis.signature import Direction, slopes


class Shown:
    """A simulation whose only trace is a number."""

    usable, state = True, None

    def __init__(self, value):
        self.value = value


class Numbers:
    """Evidence of one record with two residuals."""

    names = ("one",)

    def difference(self, one, other):
        return np.full(2, other["one"].value - one["one"].value)


class Here:
    """A point at which the trace is `rate` times x."""

    simulated = {"one": Shown(0.0)}

    def runs(self, names, values=None, effects=(), starts=None):
        return [dict(values or {})]


class Line:
    def __init__(self, rate):
        self.rate = rate

    def map(self, payloads):
        return enumerate(Shown(self.rate * values["x"]) for values in payloads)


@pytest.mark.parametrize(
    ("at", "step"),
    [(0.0, 0.5), (0.8, -0.5), (0.4, 0.5)],
)
def test_a_step_goes_away_from_the_bound_that_it_would_cross(at, step):
    assert Direction("x", at, 1.0, 0.0, 1.0).step(0.5) == step


@pytest.mark.parametrize(("at", "step"), [(0.0, 1.0), (1.0, -1.0), (0.75, -0.75)])
def test_a_step_across_both_bounds_ends_at_the_farther(at, step):
    assert Direction("x", at, 1.0, 0.0, 1.0).step(5.0) == step


def test_a_parameter_without_say_in_a_narrow_window_has_no_slope_but_a_number():
    direction = Direction("x", 0.0, 1000.0, -1.0, 1.0)
    [slope] = slopes(Line(0.0), Numbers(), Here(), [direction], compared=False)
    assert np.isfinite(slope.column).all()


def test_a_slope_without_room_for_a_second_step_is_not_relied_on():
    direction = Direction("x", 0.0, 1000.0, -1.0, 1.0)
    [slope] = slopes(Line(0.01), Numbers(), Here(), [direction])
    assert not slope.reliable
    assert slope.reason == "there is no room for a second step"
