"""Score tests."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from calib.diagnosis import score
from calib.diagnosis.score import Projection, Signature, deviate, threshold, variance_along

SIZE = 4000
SEGMENTS = np.arange(SIZE) // 100


def waves(*orders):
    """Columns over a time of one."""
    time = np.linspace(0.0, 1.0, SIZE, endpoint=False)
    return np.column_stack([np.sin(2.0 * np.pi * order * time) for order in orders])


def signature(columns, absorbed=None):
    projection = Projection(np.zeros((SIZE, 0)) if absorbed is None else absorbed)
    return Signature.of(columns, projection, np.zeros(columns.shape[1])), projection


def test_size_and_z_are_those_of_least_squares():
    columns, rng = waves(3), np.random.default_rng(0)
    own, _ = signature(columns)
    found = score.score_test(0.5 * columns[:, 0] + rng.standard_normal(SIZE), own, SEGMENTS)
    assert found.size[0] == pytest.approx(0.5, abs=3.0 / np.linalg.norm(columns))
    assert found.z == pytest.approx(0.5 * np.linalg.norm(columns), abs=3.5)


def test_the_sign_of_z_is_that_of_the_size():
    own, _ = signature(waves(3))
    assert score.score_test(-waves(3)[:, 0], own, SEGMENTS).z < 0.0


def test_what_calibration_absorbs_is_no_evidence():
    both = waves(3, 5)
    own, projection = signature(both[:, :1] + both[:, 1:], both[:, 1:])
    assert own.absorbed == pytest.approx(1.0 - np.sqrt(0.5))
    assert score.score_test(projection(7.0 * both[:, 1]), own, SEGMENTS).z == pytest.approx(0.0, abs=1e-6)


def test_what_rounding_leaves_of_the_absorbed_share_is_nothing():
    rng = np.random.default_rng(0)
    for _ in range(20):
        known, columns = rng.standard_normal((SIZE, 3)), rng.standard_normal((SIZE, 1))
        own, _ = signature(Projection(known)(columns), known)
        assert own.absorbed == 0.0


def test_a_signature_that_is_absorbed_but_for_its_doubt_is_none():
    both = waves(3, 5)
    left = Signature.of(both[:, :1] + 0.01 * both[:, 1:], Projection(both[:, :1]), np.array([0.02]))
    assert not left.columns.any()


def test_noise_with_memory_does_not_raise_z():
    rng, own = np.random.default_rng(1), signature(waves(2))[0]
    slow = np.repeat(rng.standard_normal((300, SIZE // 50)), 50, axis=1)
    segments = np.arange(SIZE) // 200
    z = np.array([score.score_test(noise, own, segments).z for noise in slow])
    naive = np.array([noise @ own.columns[:, 0] for noise in slow]) / np.linalg.norm(own.columns)
    assert naive.std() > 4.0
    assert z.std() < 1.3


@pytest.mark.parametrize("freedom", [1, 2, 5])
@pytest.mark.parametrize("square", [0.1, 4.0, 30.0, 300.0])
def test_a_deviate_has_the_probability_of_its_chi_square(square, freedom):
    two_sided = stats.norm.logsf(deviate(square, freedom)) + np.log(2.0)
    assert two_sided == pytest.approx(stats.chi2.logsf(square, freedom), rel=1e-6)


def test_a_deviate_rises_with_the_square_beyond_all_probability():
    found = [deviate(square, 3) for square in (1e3, 1.2e3, 1e4, 1e6)]
    assert (np.diff(found) > 0.0).all()


@pytest.mark.slow
def test_the_threshold_is_passed_once_in_a_hundred():
    own = [signature(waves(order))[0] for order in range(1, 9)]
    limit = threshold(own, SEGMENTS, 0, [0] * len(own))
    rng = np.random.default_rng(2)
    largest = [max(abs(score.score_test(rng.standard_normal(SIZE), s, SEGMENTS).z) for s in own) for _ in range(600)]
    assert 0.0 <= np.mean(np.array(largest) > limit) < 0.025
    assert 3.0 < limit < 3.5


def test_the_threshold_is_that_of_score_tests_of_noise_for_candidates_of_several_parameters_too():
    """Two of them are nearly parallel; a segment in which a candidate is absent draws nothing of it."""
    early = waves(11) * (np.arange(SIZE)[:, None] < SIZE // 2)
    both = np.column_stack([waves(1), waves(1) + 1e-2 * waves(2)])
    own = [score.Signature(columns[::10], 0.0) for columns in (early, both, waves(4, 5, 6), waves(7))]
    segments, rng = np.arange(SIZE // 10) // 40, np.random.default_rng(4)
    largest = [
        max(abs(score.score_test(noise, s, segments).z) for s in own)
        for noise in rng.standard_normal((600, SIZE // 10))
    ]
    limits = [threshold(own, segments, seed, [0] * len(own)) for seed in range(3)]
    assert limits == pytest.approx([np.quantile(largest, 0.99)] * 3, abs=0.35)  # three standard errors
    assert np.ptp(limits) < 0.2


def test_one_sign_only_lowers_the_threshold():
    own = [signature(waves(order))[0] for order in range(1, 9)]
    assert threshold(own, SEGMENTS, 0, [1] * 8) < threshold(own, SEGMENTS, 0, [0] * 8)


@pytest.mark.parametrize("ar", [0.0, 0.9])
@pytest.mark.parametrize("along", [0.0, 300.0])
def test_variance_along_a_vector_is_that_of_what_is_left_beside_it(ar, along):
    """Of a slow vector an autocorrelated remainder leaves much more than of white noise; the vector's own part none."""
    rng, size = np.random.default_rng(3), 4000
    slow = np.cos(np.pi * np.arange(size) / size)
    direction = slow / np.linalg.norm(slow)
    new = 3.0 * np.sqrt(1.0 - ar**2) * rng.standard_normal(size)
    left = lfilter([1.0], [1.0, -ar], new) + along * direction
    expected = 9.0 * (1.0 + ar) / (1.0 - ar)
    assert variance_along(direction, left, np.zeros(size, dtype=int)) == pytest.approx(expected, rel=0.3)


def test_variance_along_a_vector_is_at_least_that_of_the_noise():
    direction, left = np.eye(1, 100, 7)[0], 1e-3 * np.random.default_rng(0).standard_normal(100)
    assert variance_along(direction, left, np.zeros(100, dtype=int)) == 1.0
