"""Steps of differences."""

import numpy as np
import pytest

from calib.diagnosis.signature import ZERO_DERIVATIVE, Direction, Step, slopes


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

    def runs(self, names, values=None, effects=(), starts=None, to_first_order=False):
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
    [slope] = slopes(Line(0.0), Numbers(), Here(), [direction], compared="none")
    assert np.isfinite(slope.column).all()


def test_a_slope_without_room_for_a_second_step_is_not_relied_on():
    direction = Direction("x", 0.0, 1000.0, -1.0, 1.0)
    [slope] = slopes(Line(0.01), Numbers(), Here(), [direction])
    assert not slope.reliable
    assert slope.reason == "its range leaves no second step"


class Rough(Line):
    """A straight line, in steps as high as the noise times `height`."""

    def __init__(self, rate, height):
        super().__init__(rate)
        self.height = height

    def map(self, payloads):
        payloads = list(payloads)
        return enumerate(Shown(self.rate * x["x"] + self.height * np.sin(40.0 * self.rate * x["x"])) for x in payloads)


@pytest.mark.parametrize("compared", ["all", "new"])
def test_a_rough_simulation_has_the_slope_of_steps_that_are_large_beside_its_roughness(compared):
    direction = Direction("x", 0.0, 1.0, -np.inf, np.inf)
    [slope] = slopes(Rough(2.0, 0.1), Numbers(), Here(), [direction], compared=compared)
    assert slope.reliable
    assert slope.column == pytest.approx([2.0, 2.0], rel=0.15)
    assert np.linalg.norm(slope.column * slope.step) > 0.5  # standard deviations of the noise


def test_what_bends_has_no_slope_at_larger_steps_either():
    class Bent(Line):
        def map(self, payloads):
            return enumerate(Shown(self.rate * values["x"] * abs(values["x"]) ** 0.5) for values in payloads)

    direction = Direction("x", 0.0, 1.0, -np.inf, np.inf)
    [slope] = slopes(Bent(2.0), Numbers(), Here(), [direction])
    assert not slope.reliable
    assert "finite differences with two step sizes differ by 42%" in slope.reason


def test_what_changes_by_its_square_has_no_slope_and_is_not_without_effect():
    """By the first step nothing changes, and by the one that would be right of a line much more than the noise."""

    class Even(Line):
        def map(self, payloads):
            return enumerate(Shown(self.rate * values["x"] ** 2) for values in payloads)

    direction = Direction("x", 0.0, 1.0, -np.inf, np.inf)
    [slope] = slopes(Even(300.0), Numbers(), Here(), [direction])
    assert (slope.column, slope.reliable, slope.reason) == (None, False, ZERO_DERIVATIVE)
    [none] = slopes(Even(1e-5), Numbers(), Here(), [direction])
    assert (none.reason, none.reliable) == ("it changes no record", True)


def test_a_step_that_was_right_before_is_not_compared_again():
    direction = Direction("x", 0.0, 1.0, -np.inf, np.inf)
    [slope] = slopes(Rough(2.0, 0.1), Numbers(), Here(), [direction], {"x": Step(0.4, 1.1)}, compared="new")
    assert slope.step == 0.4


def test_slopes_agree_beside_what_else_is_fitted():
    """A parameter that is like another but for a fifth of its response needs a step five times as large."""

    class Two(Rough):
        def map(self, payloads):
            whole = [np.array([1.0, 0.2]) * self.rate * values["x"] for values in payloads]
            return enumerate(Shown(rows + [0.0, self.height * np.sin(7e3 * rows[1])]) for rows in whole)

    class Rows(Numbers):
        def difference(self, one, other):
            return other["one"].value - one["one"].value

    class There(Here):
        simulated = {"one": Shown(np.zeros(2))}

    direction, beside = Direction("x", 0.0, 1.0, -np.inf, np.inf), np.array([[1.0], [0.0]])
    [alone] = slopes(Two(2.0, 0.03), Rows(), There(), [direction])
    [along] = slopes(Two(2.0, 0.03), Rows(), There(), [direction], absorbed=beside)
    assert alone.reliable
    assert along.reliable
    assert abs(along.step) > 2.0 * abs(alone.step)
    assert along.column[1] == pytest.approx(0.4, rel=0.1)


class Jumping(Line):
    """A straight line on stairs whose steps are as high as `height` times the noise."""

    def __init__(self, rate, height):
        super().__init__(rate)
        self.height = height

    def map(self, payloads):
        for number, values in enumerate(payloads):
            level = np.ceil(self.rate * values["x"] / self.height)
            yield number, Shown(self.height * level)


def test_a_simulation_that_jumps_has_the_slope_of_steps_that_are_large_beside_its_jumps():
    """A smaller step has no smaller response: the slope by the smallest would be that of one jump over nothing."""
    direction = Direction("x", 0.0, 1.0, -np.inf, np.inf)
    [slope] = slopes(Jumping(1e4, 30.0), Numbers(), Here(), [direction])
    assert slope.step > 1e-3
    assert slope.column == pytest.approx([1e4, 1e4], rel=0.3)


def test_a_known_step_that_is_no_longer_right_is_compared_again():
    direction, known = Direction("x", 0.0, 1.0, -np.inf, np.inf), {"x": Step(1e-4, 1.0)}
    [kept] = slopes(Line(1e4), Numbers(), Here(), [direction], known, compared="new")
    assert (kept.step, kept.error_beside) == (1e-4, 0.0)
    [jump] = slopes(Jumping(1.0, 1e6), Numbers(), Here(), [direction], known, compared="new")
    assert not jump.reliable
    assert jump.error_beside > 0.5
    assert jump.taken.relative_error == jump.error_beside
    [again] = slopes(Jumping(1.0, 1e6), Numbers(), Here(), [direction], {"x": jump.taken}, compared="new")
    assert again.error_beside == jump.error_beside  # what was found of a step is known with it
    [smooth] = slopes(Line(1.0e10), Numbers(), Here(), [direction], {"x": jump.taken}, compared="all")
    assert smooth.error_beside < 0.1  # elsewhere the same step may do
