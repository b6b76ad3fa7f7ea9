"""Claims about the intervals of searches whose starts do not agree."""

import numpy as np
import pytest

from calib.confidence.local import local
from calib.confidence.starts import where_starts_agree
from calib.modelling.parameter import Space, Window
from calib.study import Outcome

SPACE = Space({"a": Window(0.0, 1.0), "b": Window(0.0, 10.0)})
BEST = np.array([0.4, 0.6])
TIME = np.linspace(0.0, 10.0, 200)
MATRIX = np.column_stack([np.sin(3.0 * TIME), np.sin(3.0 * TIME) + 2e-3 * np.cos(TIME)])  # a and b all but collinear
MATRIX_OF_TWO = np.column_stack([np.sin(3.0 * TIME), np.cos(5.0 * TIME)])


def confidence(matrix):
    noise = 0.02 * np.random.default_rng(1).standard_normal(TIME.size)
    noise -= matrix @ np.linalg.lstsq(matrix, noise, rcond=None)[0]

    def evaluate(points):
        residuals = [matrix @ (u - BEST) + noise for u in points]
        return [Outcome(float(np.linalg.norm(own)), own, "ok", None) for own in residuals]

    return local(evaluate, SPACE, BEST), float(np.linalg.norm(noise))


def basin(shift, cost, searches):
    return {"point": tuple(BEST + shift), "cost": cost, "searches": searches}


def judged(matrix, *others, agree):
    """Confidence where `agree` searches ended at the best point, and others at (shift, relative cost, searches)."""
    own, least = confidence(matrix)
    basins = (basin([0.0, 0.0], least, agree), *(basin(shift, ratio * least, n) for shift, ratio, n in others))
    return where_starts_agree(own, SPACE, BEST, {"starts": 9, "agree_in_point": agree, "basins": basins})


def test_where_two_starts_ended_at_the_best_point_worse_ones_do_not_matter():
    assert judged(MATRIX_OF_TWO, ([0.3, 0.1], 2.0, 1), ([-0.3, 0.1], 3.0, 1), agree=2).status == "ok"


@pytest.mark.parametrize("agreement", [{}, {"generations": 7}, {"starts": 3, "basins": ()}])
def test_an_optimiser_that_tells_of_no_ends_is_not_contradicted(agreement):
    own, _ = confidence(MATRIX_OF_TWO)
    assert where_starts_agree(own, SPACE, BEST, agreement) is own


def test_where_every_start_ended_elsewhere_there_are_no_intervals_and_why_is_said():
    found = judged(MATRIX_OF_TWO, ([0.3, 0.1], 2.0, 1), ([-0.3, 0.1], 3.0, 2), agree=1)
    assert (found.status, found.interval, found.standard_error) == ("not available", {}, {})
    assert found.reason.startswith("of 4 starts of the search that ended only one did so at this point")
    assert found.linearised is not None


def test_another_end_that_noise_does_not_tell_from_the_best_contradicts_narrow_intervals():
    found = judged(MATRIX_OF_TWO, ([0.0, 0.3], 1.001, 1), agree=5)
    assert found.status == "not available"
    assert "a start of the search ended at another value of b, outside the intervals about this point" in found.reason


def test_ends_along_a_valley_agree_with_the_wide_intervals_of_it():
    assert judged(MATRIX, ([0.2, -0.2], 1.0001, 1), agree=1).status == "ok"
