"""Sweeps are told by the level that was set and the direction."""

import numpy as np
import pytest

from calib.records.response import make_response
from calib.records.sweep_names import sweep_names


def names(*sweeps):
    """Names of sweeps of three points, each of levels and a direction."""
    level = np.concatenate([np.broadcast_to(size, 3) for size, _ in sweeps])
    number = np.repeat(np.arange(len(sweeps)), 3)
    way = np.repeat([float(direction) for _, direction in sweeps], 3)
    frequency = 10.0 + way * np.tile([0.0, 1.0, 2.0], len(sweeps))
    amplitude = np.full((1, level.size), 1e-3 + 0.0j)
    return list(sweep_names(make_response(frequency, ["tip"], amplitude, level, "N", number, way)).values())


def test_a_sweep_has_the_name_of_its_level_and_direction():
    assert names((0.5, 1), (0.5, -1), (2.0, 1)) == ["0.5 N, up", "0.5 N, down", "2 N, up"]


def test_those_alike_have_their_number_too():
    assert names((0.5, 1), (2.0, 1), (0.5, 1)) == ["0.5 N, up, sweep 0", "2 N, up", "0.5 N, up, sweep 2"]


@pytest.mark.parametrize(("level", "name"), [((1.0, 1.01, 1.0), "1 N, up"), ((1.0, 0.9, 0.8), "0.8 N .. 1 N, up")])
def test_a_level_that_follows_the_frequency_is_told_by_its_range(level, name):
    assert names((level, 1)) == [name]
