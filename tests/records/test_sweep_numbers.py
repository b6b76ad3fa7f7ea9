"""Sweeps of rows that state none: as a recorder writes them."""

import numpy as np
import pytest

from calib.errors import CalibError
from calib.records.response_table import read_response
from calib.records.sweep_numbers import numbered

UP = np.linspace(2.0, 2.9, 10)  # Hz


def told(frequency, level, direction=None):
    """Numbers of the sweeps as a list; None where it is open."""
    found = numbered(np.asarray(frequency, float), np.asarray(level, float), direction)
    return None if found is None else found.astype(int).tolist()


def wandering(level, size, seed=0, rounded=5):
    """Readings of a level that a controller holds to 0.1 %."""
    return np.round(level * (1.0 + 1e-3 * np.random.default_rng(seed).standard_normal(size)), rounded)


@pytest.mark.parametrize("readings", [2, 5])
@pytest.mark.parametrize("rounded", [3, 5])  # of which the coarser hardly shows that it wanders
def test_readings_of_one_frequency_are_one_sweep(readings, rounded):
    frequency = np.repeat(UP, readings)
    assert told(frequency, wandering(0.6, frequency.size, rounded=rounded)) == [0] * frequency.size


def test_one_frequency_that_was_read_again_does_not_end_a_sweep():
    frequency = np.insert(UP, 4, UP[4])
    assert told(frequency, wandering(0.6, frequency.size)) == [0] * frequency.size


@pytest.mark.parametrize("readings", [1, 3])
@pytest.mark.parametrize("snake", [False, True])
def test_levels_that_are_set_at_each_frequency_are_a_sweep_each(readings, snake):
    levels = np.array([0.1, 0.2, 0.3])
    rows = [levels[:: -1 if snake and k % 2 else 1] for k in range(UP.size)]
    level = np.repeat(np.concatenate(rows), readings)
    number = np.repeat(np.searchsorted(levels, np.concatenate(rows)), readings)
    frequency = np.repeat(UP, 3 * readings)
    assert told(frequency, level) == number.tolist()
    assert told(frequency, wandering(level, level.size)) == number.tolist()


def test_a_level_that_is_missing_at_one_frequency_shifts_no_other():
    frequency, level = np.repeat(UP, 3), wandering(np.tile([0.1, 0.2, 0.3], UP.size), 30)
    kept = np.arange(30) != 13
    assert told(frequency[kept], level[kept]) == np.tile([0, 1, 2], UP.size)[kept].tolist()


def test_levels_at_each_frequency_up_and_down_are_a_sweep_each_way():
    frequency, direction = np.repeat([*UP, *UP[::-1]], 2), np.repeat([1.0, -1.0], 20)
    found = told(frequency, np.tile([0.1, 0.2], 20), direction)
    assert found == [0, 1] * 10 + [2, 3] * 10


@pytest.mark.parametrize("readings", [1, 2])
def test_levels_one_after_the_other_are_a_sweep_each(readings):
    one_way = np.repeat(UP, readings)
    frequency = np.concatenate([one_way, one_way, one_way[::-1]])
    level = wandering(np.repeat([0.1, 0.2, 0.4], one_way.size), frequency.size)
    assert told(frequency, level) == np.repeat([0, 1, 2], one_way.size).tolist()


def test_a_level_set_at_the_last_frequency_of_another_begins_a_sweep():
    assert told([*UP, *UP[::-1]], [*[0.1] * 10, *[0.2] * 10]) == [0] * 10 + [1] * 10


@pytest.mark.parametrize("readings", [1, 2])
def test_a_sweep_back_that_begins_with_the_last_frequency_again_has_its_readings(readings):
    way = np.repeat(UP, readings)
    frequency = np.concatenate([way, way[::-1]])
    assert told(frequency, wandering(0.6, frequency.size)) == [0] * way.size + [1] * way.size


def test_levels_at_one_frequency_are_a_sweep_each_in_their_order():
    assert told([2.0] * 5, [0.1, 0.2, 0.4, 0.2, 0.1]) == [0, 1, 2, 3, 4]


def test_rows_that_may_be_read_in_several_ways_are_refused(tmp_path):
    assert told(np.random.default_rng(1).permutation(UP), wandering(0.6, 10)) is None
    force = 1.0 / (1.0 + 30.0 * (UP - 2.4) ** 2)  # of constant response, at two responses
    level = np.column_stack([force, 1.5 * force]).ravel()
    assert told(np.repeat(UP, 2), level) is None
    file = tmp_path / "levels.csv"
    rows = [f"{f}, {own}, 1, -10" for f, own in zip(np.repeat(UP, 2), level, strict=True)]
    head = "# place: mass\n# quantity: force\nfrequency [Hz], level [N], mass amplitude [mm], mass phase [deg]\n"
    file.write_text(head + "\n".join(rows))
    with pytest.raises(CalibError, match=r"levels\.csv: .* leave it open .* column 'sweep'"):
        read_response(file)
    sweep = [f"{row}, {k % 2}" for k, row in enumerate(rows)]
    file.write_text(head.replace("[deg]", "[deg], sweep") + "\n".join(sweep))
    assert read_response(file).sweep.values.tolist() == [0.0, 1.0] * 10
