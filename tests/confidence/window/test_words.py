"""A window in words: how large it is, and that it may be nothing."""

from dataclasses import replace

import pytest

from calib.confidence.window.document import WindowResult
from calib.confidence.window.words import share_in_words


@pytest.fixture
def result():
    return WindowResult(
        name="a", windows={}, units={}, measured_kind={}, tolerances={}, calibrated={}, points=100, simulations=100,
        seed=1, admissible_points=5, share=0.012, share_low=0.008, share_high=0.02, misclassified=0.001,
    )  # fmt: skip


def test_a_share_is_said_with_its_interval(result):
    assert share_in_words(result) == "1.2 % of the box is admissible (95 % interval 0.8 % to 2 %)"


def test_an_interval_that_reaches_down_to_nothing_is_an_upper_bound(result):
    words = share_in_words(replace(result, share_low=0.0))
    assert words.startswith("at most 2 % of the box is admissible")
    assert "1.2" not in words
