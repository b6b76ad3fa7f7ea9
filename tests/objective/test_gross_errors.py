"""Points of frequency responses that were read before the motion had settled, or in error."""

import numpy as np
import pytest
from scipy import stats

from calib.objective.gross_errors import MAX_DOUBTED_RATIO, in_doubt, largest_noise, trust_at

PARTS = 2
NOISE = 0.3  # of either part
UPPER, LOWER = 100.0 + np.arange(8.0), 20.0 - 0.5 * np.arange(8.0)  # amplitudes of two branches


def doubted(*amplitudes, sigma=NOISE, frequency=None):
    """Indices of the points that may be gross errors, in noise."""
    own = np.concatenate(amplitudes)
    known = np.broadcast_to(sigma, own.shape)
    noise = known * (np.random.default_rng(3).standard_normal((own.size, 2)) @ [1.0, 1j])
    along = np.arange(float(own.size)) if frequency is None else frequency
    return np.flatnonzero(in_doubt((own + noise)[None], known[None], along, PARTS)).tolist()


def test_a_jump_from_branch_to_branch_is_none_wherever_it_is():
    assert doubted(UPPER, LOWER) == []
    assert doubted(LOWER[::-1], UPPER[::-1]) == []
    assert doubted(UPPER, LOWER[:1]) == []
    assert doubted(UPPER[:1], LOWER) == []


def test_a_point_that_was_read_in_a_jump_is_in_doubt_and_the_one_after_it():
    assert doubted(UPPER, [60.0], LOWER) == [8, 9]
    assert doubted(LOWER[::-1], [60.0], UPPER[::-1]) == [8, 9]


def test_so_are_points_while_a_motion_decays():
    after = LOWER.copy()
    after[:4] += 60.0 * np.array([1.0, 0.3, 0.09, 0.03])
    assert doubted(UPPER, after) == [8, 9]


def test_a_reading_in_error_is_in_doubt_whatever_its_stated_uncertainty():
    wrong = UPPER.copy()
    wrong[4] = 300.0
    assert doubted(wrong) == [4, 5]
    assert doubted(wrong, sigma=3e-3 * wrong) == [4, 5]


def test_points_read_twice_count_as_one():
    flank = np.repeat(10.0 + 20.0 * np.arange(10.0), 2)
    assert doubted(flank, frequency=np.repeat(np.arange(10.0), 2)) == []
    once = np.delete(flank, 9)
    assert doubted(once, frequency=np.delete(np.repeat(np.arange(10.0), 2), 9)) == []


@pytest.mark.parametrize("per_bandwidth", [1.0, 1.5, 2.0, 3.0, 10.0])
def test_a_resonance_has_none_wherever_its_peak_lies_between_the_points(per_bandwidth):
    """Down to one point in the half-power bandwidth."""
    for offset in np.linspace(0.0, 1.0, 40, endpoint=False):
        detuning = (np.arange(-12.0, 12.0) + offset) / per_bandwidth
        response = 300.0 / (1.0 + 2j * detuning)
        assert not in_doubt(response[None], np.ones((1, 24)), detuning, PARTS).any(), offset


@pytest.mark.parametrize("ratio", [1.0, 5.0, 20.0])
def test_noise_has_hardly_any_though_it_is_larger_than_stated(ratio):
    rng = np.random.default_rng(4)
    drawn = ratio * (rng.standard_normal((300, 40, 2)) @ [1.0, 1j])
    assert np.mean([in_doubt(one[None], np.ones((1, 40)), np.arange(40.0), PARTS).any() for one in drawn]) < 0.01


def test_a_distance_that_noise_may_have_counts_in_full_and_none_counts_for_more_than_that():
    drawn = stats.chi2.rvs(PARTS, size=20_000, random_state=5)
    assert trust_at(drawn, PARTS).mean() > 1.0 - 1e-3
    r, full = np.linspace(0.1, 200.0, 20_000), largest_noise(PARTS, 3.0)
    counted = r * trust_at(r**2, PARTS)
    assert counted[r < full] == pytest.approx(r[r < full])
    slopes = np.diff(counted) / np.diff(r)
    assert slopes.min() > -1e-9, "a larger distance is worth no less"
    assert slopes.max() < 1.0 + 1e-9
    assert counted[-1] == pytest.approx(MAX_DOUBTED_RATIO * full)
    assert slopes[r[1:] > 2.0 * full].max() < 2e-3, "a gross error has no influence"


def test_of_many_parts_noise_is_farther_away():
    square = np.array([100.0])
    assert trust_at(square, 2)[0] < 0.5
    assert trust_at(square, 80)[0] == 1.0
