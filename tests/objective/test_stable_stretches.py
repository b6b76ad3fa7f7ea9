"""What an instrument reads on the stable stretches of a simulated sweep."""

import numpy as np
import pytest

from calib.objective.stable_stretches import read_at, stable_stretches
from calib.records.response import make_response

FOLD = 2.0  # Hz


def upper(frequency):
    return 1.0 + np.sqrt(FOLD - frequency) - 1j * frequency


def swept(direction=1.0, gap=0.003):
    """Stretch of a sweep up that bends into a fold, and the flat one to which it jumps a little beyond."""
    steps = np.linspace(1.0, 0.0, 30)
    frequency = np.concatenate([FOLD - steps**2, np.linspace(FOLD + gap, 3.0, 12)])
    amplitude = np.concatenate([upper(frequency[:30]), np.full(12, 0.1 + 0.0j)])
    record = make_response(frequency, ["mass", "plate"], np.stack([amplitude, 2.0 * amplitude]), 1.0, "N", 0, direction)
    return record.assign(piece=("point", np.repeat([0.0, 1.0], [30, 12])))


def read(motion, *frequency):
    wanted = make_response(np.array(frequency), ["mass"], np.ones((1, len(frequency))), 1.0, "N")
    return read_at(motion, wanted)


def test_amplitudes_are_read_on_the_stretch_that_the_sweep_is_on():
    found = read(swept(), 1.0, 1.5, 1.99, 2.5, 3.0)
    assert found[0] == pytest.approx([*upper(np.array([1.0, 1.5, 1.99])), 0.1, 0.1], abs=1e-6)
    assert found[1] == pytest.approx(2.0 * found[0])


def test_between_a_fold_and_where_the_sweep_goes_on_it_is_on_the_next_stretch():
    assert read(swept(), 1.0, FOLD + 0.001, 3.0)[0, 1] == pytest.approx(0.1)


def test_where_the_motion_was_not_periodic_nothing_is_read():
    found = read(swept(gap=0.4), 1.0, 2.2, 2.5, 3.0)[0]
    assert np.isnan(found).tolist() == [False, True, False, False]


def test_a_few_points_are_joined_by_lines():
    motion = make_response(np.array([2.0, 1.0]), ["mass"], np.array([[4.0 + 0j, 2.0 + 2j]]), 1.0, "N", 0, -1.0)
    motion = motion.assign(piece=("point", [0.0, 0.0]))
    [stretch] = stable_stretches(motion, 0.0)
    assert stretch.spline is None
    assert read(motion, 1.25)[0] == pytest.approx([2.5 + 1.5j])
