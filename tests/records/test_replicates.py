"""Which points of a frequency response are the same measurement again."""

import numpy as np
import pytest

from calib.records.replicates import replicates
from calib.records.response import make_response

FREQUENCY = np.linspace(3.0, 4.0, 21)  # Hz
UP, DOWN = 1.0, -1.0


def curve(frequency, level=1.0, resonance=3.5):
    """Complex amplitude of a linear oscillator of 3 % damping."""
    return level / (resonance**2 - frequency**2 + 2j * 0.03 * resonance * frequency)


def response(*sweeps, of_sweep=curve):
    """Response of sweeps (frequencies, level, direction)."""
    frequency, level, direction = (
        np.concatenate([np.broadcast_to(sweep[k], len(sweep[0])) for sweep in sweeps]) for k in range(3)
    )
    number = np.repeat(np.arange(len(sweeps)), [len(sweep[0]) for sweep in sweeps])
    amplitude = np.concatenate([of_sweep(np.asarray(sweep[0]), sweep[1]) for sweep in sweeps])
    return make_response(frequency, ["mass"], amplitude[None], level, "N", number, direction)


def test_a_sweep_down_repeats_the_sweep_up():
    group = replicates(response((FREQUENCY, 1.0, UP), (FREQUENCY[::-1], 1.02, DOWN)))
    np.testing.assert_array_equal(group, [*range(21), *range(20, -1, -1)])


def test_a_third_sweep_joins_the_first_two():
    group = replicates(response((FREQUENCY, 1.0, UP), (FREQUENCY[::-1], 1.0, DOWN), (FREQUENCY, 1.0, UP)))
    np.testing.assert_array_equal(group[42:], group[:21])


def test_another_level_is_another_measurement():
    group = replicates(response((FREQUENCY, 1.0, UP), (FREQUENCY, 1.1, UP)))
    assert np.unique(group).size == 42


def test_each_point_of_a_finer_sweep_repeats_at_most_one():
    fine = np.linspace(3.0, 4.0, 81)
    group = replicates(response((FREQUENCY, 1.0, UP), (fine, 1.0, UP)))
    np.testing.assert_array_equal(group[21::4], group[:21])
    assert np.unique(group).size == 81


@pytest.mark.parametrize(("shift", "matched"), [(0.05, 20), (0.15, 0), (0.5, 0), (0.95, 20)])
def test_frequencies_are_the_same_up_to_a_tenth_of_a_step(shift, matched):
    moved = FREQUENCY + shift * (FREQUENCY[1] - FREQUENCY[0])
    wide = np.append(moved[:-1], moved[-1] + 1.0)  # the last one is beyond the first sweep
    group = replicates(response((FREQUENCY, 1.0, UP), (wide, 1.0, UP), of_sweep=lambda f, level: np.full(f.size, 1.0)))
    own = np.flatnonzero(group[21:] < 21)
    np.testing.assert_array_equal(group[21:][own], np.arange(matched) + (shift > 0.5))  # or the next of the first sweep
    assert own.size == matched


def test_noise_of_a_body_that_hardly_moves_parts_no_replicates():
    record = response((FREQUENCY, 1.0, UP), (FREQUENCY[::-1], 1.0, DOWN))
    still = np.random.default_rng(1).standard_normal((1, 42)) * 1e-3 * np.abs(record["in_phase"].values).max()
    both = np.concatenate([record["in_phase"].values + 1j * record["quadrature"].values, still + 0j])
    sweep, way = record["sweep"].values, record["direction"].values
    two = make_response(record["frequency"].values, ["mass", "frame"], both, 1.0, "N", sweep, way)
    np.testing.assert_array_equal(replicates(two), replicates(record))


def test_points_of_two_branches_are_not_the_same():
    between = (FREQUENCY > 3.6) & (FREQUENCY < 3.8)

    def folded(frequency, level):
        lower = np.where(between, 0.2, 1.0) if frequency[0] > frequency[-1] else np.ones(21)
        return np.where(frequency[0] > frequency[-1], lower[::-1], lower) * level

    group = replicates(response((FREQUENCY, 1.0, UP), (FREQUENCY[::-1], 1.0, DOWN), of_sweep=folded))
    matched = group[21:][::-1] == group[:21]
    np.testing.assert_array_equal(matched, ~between)
