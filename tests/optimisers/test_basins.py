"""Ends of searches are grouped into basins as they come in, as they would be grouped all at once."""

import time

import numpy as np
import pytest

from calib.optimisers.basins import SAME_POINT_DISTANCE, Basin, SearchEnds, same_cost


def grouped(ends):
    """Group ends (point, cost) by the definition: the lowest first, each to the first basin that it agrees with."""
    basins = []
    for u, cost in sorted(ends, key=lambda end: end[1]):
        for i, basin in enumerate(basins):
            if np.abs(u - basin.point).max() < SAME_POINT_DISTANCE and same_cost(cost, basin.cost):
                basins[i] = Basin(basin.point, basin.cost, basin.searches + 1)
                break
        else:
            basins.append(Basin(tuple(u.tolist()), cost, 1))
    return basins


@pytest.mark.parametrize("seed", range(30))
def test_ends_are_grouped_as_the_definition_says_after_each(seed):
    rng = np.random.default_rng(seed)
    dim, width, digits = rng.integers(1, 4), rng.choice([0.01, 0.03, 0.1]), rng.choice([2, 4, 8])
    ends, known = [], SearchEnds(dim)
    for _ in range(40):
        point = np.round(width * rng.random(dim), digits + 1)  # of equal points and costs there are some
        cost = float(np.round(rng.choice([-1.0, 0.0, 1.0, 1.0]) * (1.0 + 0.04 * rng.random()), digits))
        ends.append((point, cost))
        known.add(point, cost)
        expected = grouped(ends)
        assert known.basins() == expected
        assert known.counts() == (len(expected), expected[0].searches)
        assert known.agree_in_cost() == sum(same_cost(cost, expected[0].cost) for _, cost in ends)


def test_there_are_no_basins_before_the_first_end():
    assert SearchEnds(2).basins() == []
    assert SearchEnds(2).counts() == (0, 0)


def test_looking_after_each_of_600_ends_costs_less_than_grouping_them_anew_once():
    rng = np.random.default_rng(1)
    ends = [(rng.random(2), 1.0 + rng.random()) for _ in range(600)]
    known, begin = SearchEnds(2), time.process_time()
    for point, cost in ends:
        known.add(point, cost)
        known.counts()
    between = time.process_time()
    expected = grouped(ends)
    assert known.basins() == expected
    assert between - begin < time.process_time() - between
