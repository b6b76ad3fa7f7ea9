import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import CalibError
from calib.modelling.parameter import ABOVE_ZERO, Parameter, Space, Window, values_for

SPACE = Space({"e": Window(0.0, 0.6), "c": Window(1e-3, 1e2, "log")}, {"gap": 1e-3})


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.0, 1.0, "[0, 1]"),
        (ABOVE_ZERO, 0.5, "(0, 0.5]"),
        (ABOVE_ZERO, math.inf, "(0, inf)"),
        (-0.999, math.inf, "[-0.999, inf)"),
        (-math.inf, 2.0, "(-inf, 2]"),
        (-math.inf, math.inf, "(-inf, inf)"),
    ],
)
def test_an_interval_excludes_what_no_value_may_be(low, high, text):
    parameter = Parameter("k", "N/m", 1.0, "stiffness", low=low, high=high)
    assert parameter.interval == text
    assert [parameter.admits(end) for end in (low, high)] == [low > -math.inf, high < math.inf]


@settings(deadline=None)
@given(st.floats(0, 1), st.floats(0, 1))
def test_a_point_of_the_cube_comes_back_from_its_values(a, b):
    assert SPACE.point(SPACE.values(np.array([a, b]))) == pytest.approx([a, b], abs=1e-12)


def test_the_corners_of_the_cube_are_the_ends_of_the_windows_exactly():
    assert SPACE.values(np.zeros(2)) == {"gap": 1e-3, "e": 0.0, "c": 1e-3}
    assert SPACE.values(np.ones(2)) == {"gap": 1e-3, "e": 0.6, "c": 1e2}


def test_a_log_window_halves_by_decades():
    assert Window(1e-4, 1.0, "log").value(0.5) == pytest.approx(1e-2)


def test_around_shrinks_on_the_window_s_own_scale_and_stays_inside():
    near = SPACE.around({"e": 0.3, "c": 0.316}, 0.1).windows
    assert near["e"].high - near["e"].low == pytest.approx(0.06)
    assert math.log10(near["c"].high / near["c"].low) == pytest.approx(0.5)
    edge = SPACE.around({"e": 0.6, "c": 1e2}, 0.1).windows["e"]
    assert (edge.low, edge.high) == pytest.approx((0.54, 0.6))


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((1, 0), "wrong way round"),
        ((1, 1), "no width"),
        ((math.nan, 1), "finite"),
        ((0, 1, "log"), "low > 0"),
        ((0, 1, "cubic"), "'linear' or 'log'"),
    ],
)
def test_an_impossible_window_is_refused(ends, said):
    with pytest.raises(CalibError, match=said):
        Window(*ends)


def test_a_parameter_is_searched_or_fixed_not_both():
    with pytest.raises(CalibError, match="both"):
        Space({"e": Window(0, 1)}, {"e": 0.5})


def test_a_record_s_own_value_takes_the_place_of_the_general_one():
    values = {"x0": 0.0, "x0@decay": 1.0, "x0@other": 2.0, "k": 3.0}
    assert values_for(values, "decay") == {"x0": 1.0, "k": 3.0}
    assert values_for(values, "sweep") == {"x0": 0.0, "k": 3.0}
