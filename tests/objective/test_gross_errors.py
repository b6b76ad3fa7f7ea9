"""Points of frequency responses that were read in a jump, or in error."""

import numpy as np
import pytest
from scipy import stats

from calib.objective.gross_errors import may_be_gross, trust_at

PARTS = 2
UPPER, LOWER = 100.0 + np.arange(8.0), 20.0 - 0.5 * np.arange(8.0)  # amplitudes of two branches, in their noise


def doubted(*amplitudes):
    """Indices of the points that may be gross errors, in noise."""
    own = np.concatenate(amplitudes)
    noise = 0.3 * np.random.default_rng(3).standard_normal((2, own.size))
    return np.flatnonzero(may_be_gross(np.array([own, np.zeros(own.size)]) + noise, PARTS)).tolist()


def test_a_jump_from_branch_to_branch_is_none():
    assert doubted(UPPER, LOWER) == []
    assert doubted(LOWER[::-1], UPPER[::-1]) == []


def test_a_point_that_was_read_in_a_jump_may_be_one_and_what_follows_it():
    assert doubted(UPPER, [60.0], LOWER) == [8, 9]


def test_points_while_a_motion_decays_may_be():
    after = LOWER.copy()
    after[:4] += 60.0 * np.array([1.0, 0.3, 0.09, 0.03])
    assert set(range(8, 10)) <= set(doubted(UPPER, after)) <= set(range(8, 12))


def test_a_reading_in_error_is_one_wherever_it_is():
    wrong = UPPER.copy()
    wrong[4] = 300.0
    assert doubted(wrong) == [4, 5]
    for end in (0, UPPER.size - 1):
        wrong = UPPER.copy()
        wrong[end] = 300.0
        assert end in doubted(wrong)


@pytest.mark.parametrize("per_bandwidth", [3, 5, 10])
def test_a_resonance_that_is_resolved_has_none(per_bandwidth):
    detuning = np.arange(-6.0, 6.0, 1.0 / per_bandwidth) + 0.013
    response = 1000.0 / (1.0 + 2j * detuning)
    assert not may_be_gross(np.array([response.real, response.imag]), PARTS).any()


def test_noise_alone_has_none_nor_have_few_points():
    rng = np.random.default_rng(4)
    assert not any(may_be_gross(rng.standard_normal((2, 40)), PARTS).any() for _ in range(200))
    assert not may_be_gross(np.array([[0.0, 900.0, 5.0, 5.0], [0.0] * 4]), PARTS).any()


def test_a_distance_that_noise_may_have_is_trusted_and_a_gross_error_is_not():
    drawn = stats.chi2.rvs(PARTS, size=20_000, random_state=5)
    assert trust_at(drawn, PARTS).mean() > 1.0 - 1e-5
    r = np.linspace(0.1, 60.0, 4000)
    left = r * trust_at(r**2, PARTS)
    assert left[r < 4.0] == pytest.approx(r[r < 4.0])
    assert np.abs(np.diff(left)).max() < 1.2 * (r[1] - r[0])  # no jump
    assert left[r > 20.0].max() < 1e-3


def test_of_many_parts_noise_is_farther_away():
    square = np.array([100.0])
    assert trust_at(square, 2)[0] < 0.2
    assert trust_at(square, 60)[0] == 1.0
