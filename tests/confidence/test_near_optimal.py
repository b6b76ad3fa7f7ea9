"""Claims about what nearly equal trials have in common."""

import math

import numpy as np

from calib.confidence import describe_near_optimal
from calib.modelling.parameter import Space, Window
from calib.store import Trial

SPACE = Space({"alpha": Window(100.0, 1000.0, "log"), "beta": Window(0.0, 2.0)})
UNITS = {"alpha": "1/s", "beta": "1"}


def trials(points, costs):
    pairs = enumerate(zip(points, costs, strict=True))
    return [Trial(number, list(u), SPACE.values(np.array(u)), cost) for number, (u, cost) in pairs]


def test_what_nearly_equal_trials_share_is_told_from_what_they_do_not():
    points = [(0.5 + 0.001 * k, k / 20.0) for k in range(20)] + [(0.9, 0.1)]
    said = describe_near_optimal(SPACE, trials(points, [0.010 + 0.0001 * k for k in range(20)] + [0.5]), UNITS)
    expected = (
        "20 trials are within 25 % of the best distance; "
        "they have alpha 316 .. 330 1/s in common "  # 10^2.5 .. 10^2.519
        "and span more than a quarter of the windows of beta, which are not determined"
    )
    assert said == expected


def test_few_trials_say_nothing():
    assert describe_near_optimal(SPACE, trials([(0.5, 0.5)] * 5, [0.01] * 5), UNITS) == ""
    assert describe_near_optimal(SPACE, [], UNITS) == ""


def test_failed_trials_have_nothing_in_common():
    assert describe_near_optimal(SPACE, trials([(0.5, 0.5)] * 20, [math.inf] * 20), UNITS) == ""
