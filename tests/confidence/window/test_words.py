"""A window in words: how large it is, and that it may be nothing."""

from dataclasses import replace

import pytest

from calib.confidence.window.document import ParameterTolerance, WindowResult
from calib.confidence.window.words import percent, share_in_words, together


@pytest.fixture
def result():
    return WindowResult(
        name="a", windows={}, units={}, measured_kind={}, tolerances={}, calibrated={}, points=100, simulations=100,
        seed=1, admissible_points=5, share=0.012, share_low=0.008, share_high=0.02, misclassified=0.001,
    )  # fmt: skip


def test_a_share_is_said_with_its_interval(result):
    assert share_in_words(result) == "1.2 % of the box is admissible (95 % interval 0.8 % to 2 %)"


@pytest.mark.parametrize(
    ("share", "written"), [(1.0, "100 %"), (0.996, "100 %"), (0.124, "12 %"), (0.0124, "1.2 %"), (1e-6, "0.0001 %")]
)
def test_a_share_has_two_digits_and_no_power_of_ten(share, written):
    assert percent(share) == written


def test_what_a_parameter_may_vary_is_said_without_a_power_of_ten():
    own = ParameterTolerance(
        name="a", unit="N", value=6.0, alone_low=1.0, alone_high=18.0, alone_low_cause="", alone_high_cause="",
        together_low=1.0, together_high=18.0,
    )  # fmt: skip
    assert together(own) == "1 N .. 18 N (-83 / +200 %)"


def test_an_interval_that_reaches_down_to_nothing_is_an_upper_bound(result):
    words = share_in_words(replace(result, share_low=0.0))
    assert words.startswith("at most 2 % of the box is admissible")
    assert "1.2" not in words
