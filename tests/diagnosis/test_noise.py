"""The noise of measured channels."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from calib.diagnosis.noise import RESIDUAL, STATED, Noise, absorbed_by, from_cycles, from_residual, with_autoregression
from calib.diagnosis.score import Projection
from calib.records.cycles import mean_cycle


def series(ar, size, seed=0, sigma=2.0):
    """An autoregression of standard deviation sigma."""
    return Noise(sigma, np.array(ar), "").drawn(np.random.default_rng(seed), size)


@pytest.mark.parametrize("ar", [[], [0.8], [1.2, -0.5]])
def test_drawn_noise_has_its_level(ar):
    assert series(ar, 200_000).std() == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize("ar", [[], [0.8], [1.2, -0.5]])
@pytest.mark.parametrize("per_cycle", [500.0, 487.35, 20.7])
def test_level_and_memory_are_found_from_cycles_of_whatever_motion(ar, per_cycle):
    time = np.arange(10_000) / per_cycle
    motion = 30.0 * np.sin(2.0 * np.pi * time) + 5.0 * np.cos(6.0 * np.pi * time + 1.0)
    row, weight = motion + series(ar, time.size), np.ones(time.size)
    mean = mean_cycle(time, row[None], 1.0)
    noise = from_cycles(mean.residual[0], weight, row, mean.parameters, None)
    assert noise.sigma == pytest.approx(2.0, rel=0.1)
    np.testing.assert_allclose(noise.ar[: len(ar)], ar, atol=0.06)


@pytest.mark.parametrize("ar", [[], [0.8], [1.2, -0.5]])
def test_whitened_noise_is_white_and_of_unit_variance(ar):
    noise = Noise(2.0, np.array(ar), "")
    white = noise.whitened(series(ar, 100_000), np.ones(100_000))
    assert white.std() == pytest.approx(1.0, rel=0.02)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.02


MEMORIES = [[], [0.8], [1.3582, -0.6873], [0.5, 0.2, -0.4, 0.1]]


def gaps(size):
    """Weights (size,) of a velocity beside impacts: gaps, single samples between them, weights that fall and rise."""
    weight = np.ones(size)
    weight[10:13], weight[20], weight[22:25] = 0.0, 0.0, 0.0
    weight[30:36] = 0.8, 0.3, 0.0, 0.05, 0.6, 0.9
    return weight


@pytest.mark.parametrize("ar", MEMORIES)
def test_noise_beside_gaps_has_the_variance_of_its_weights_once_whitened_and_no_memory_between_them(ar):
    """By the covariance of the noise itself: no sample counts more than it was meant to because its past is unknown."""
    noise, weight = Noise(2.0, np.array(ar), ""), gaps(60)
    covariance = 4.0 * toeplitz(noise.autocorrelation(60))
    matrix = noise.whitened(np.eye(60), weight).T
    whitened = matrix @ covariance @ matrix.T
    np.testing.assert_allclose(np.diag(whitened), weight**2, atol=1e-9)
    for run in (slice(0, 10), slice(13, 20), slice(25, 30), slice(36, 60)):
        np.testing.assert_allclose(whitened[run, run], np.eye(run.stop - run.start), atol=1e-9)


@pytest.mark.parametrize("ar", MEMORIES)
def test_what_is_hardly_trusted_changes_nothing_else(ar):
    noise, weight = Noise(2.0, np.array(ar), ""), gaps(60)
    row, disturbed = series([0.8], 60), series([0.8], 60)
    disturbed[weight < 1.0] += 1e6
    whole = weight == 1.0
    np.testing.assert_array_equal(noise.whitened(row, weight)[whole], noise.whitened(disturbed, weight)[whole])


@pytest.mark.parametrize("ar", MEMORIES)
def test_colouring_undoes_whitening(ar):
    noise, weight = Noise(2.0, np.array(ar), ""), gaps(300)
    rows = np.array([series([0.8], 300, seed) for seed in range(3)])
    np.testing.assert_allclose(noise.coloured(noise.whitened(rows, weight), weight), rows * (weight > 0.0), atol=1e-9)


def test_a_stated_level_comes_first():
    noise = from_residual(series([], 1000), np.ones(1000), np.ones(1000), stated=0.5)
    assert (noise.sigma, noise.source) == (0.5, STATED)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.95])
def test_memory_of_stated_noise_is_that_of_a_residual_which_is_no_larger(phi):
    row = series([phi] if phi else [], 4000)
    noise = from_residual(row, np.ones(4000), np.ones(4000), stated=2.0)
    assert noise.sigma == (pytest.approx(2.0, rel=0.03) if phi else 2.0)
    assert np.mean(noise.whitened(row, np.ones(4000)) ** 2) == pytest.approx(1.0, rel=1e-9 if phi else 0.05)
    assert noise.ar.sum() == pytest.approx(phi, abs=0.1)


@pytest.mark.parametrize("error", [1.0, 4.0])
def test_an_error_of_the_model_gives_stated_noise_no_memory(error):
    wave = error * 2.0 * np.sin(np.linspace(0.0, 60.0, 4000))  # 1.2 and 3 times the stated level in all
    noise = from_residual(series([], 4000) + wave, np.ones(4000), np.ones(4000), stated=2.0)
    assert noise.ar.size == 0


@pytest.mark.parametrize("ar", [[], [0.8], [1.2, -0.5], [0.5, 0.2, -0.4, 0.1]])
@pytest.mark.parametrize("lags", [1, 2, 4, 40])
def test_the_autocorrelation_is_that_of_the_impulse_response(ar, lags):
    impulse = lfilter([1.0], np.concatenate([[1.0], -np.array(ar)]), np.eye(1, 5000)[0])
    whole = np.correlate(impulse, impulse, "full")[4999:]
    noise = Noise(2.0, np.array(ar), "")
    np.testing.assert_allclose(noise.autocorrelation(lags), (whole / whole[0])[:lags], atol=1e-9)


@pytest.mark.parametrize("ar", [[], [0.8], [1.5, -0.7]])
def test_the_mean_square_of_noise_varies_as_stated(ar):
    squares = [np.mean(series(ar, 2000, seed) ** 2) / 4.0 for seed in range(400)]
    known = Noise(2.0, np.array(ar), "").mean_square_std(2000.0)
    assert np.std(squares) == pytest.approx(known, rel=0.15)


def test_of_known_memory_the_fastest_part_of_a_residual_tells_the_level():
    slow = 40.0 * np.sin(np.linspace(0.0, 20.0, 20_000))
    noise = with_autoregression(np.array([0.8]), slow + series([0.8], 20_000), np.ones(20_000), np.ones(20_000), None)
    assert noise.sigma == pytest.approx(2.0, rel=0.1)


def test_samples_without_weight_do_not_count():
    row, weight = series([], 4000), np.ones(4000)
    row[::10], weight[::10] = 1e6, 0.0
    assert from_residual(row, weight, np.ones(4000), None).sigma == pytest.approx(2.0, rel=0.1)


def test_away_from_gaps_whitening_is_the_filter_of_scipy():
    row = np.random.default_rng(1).standard_normal(50)
    filtered = lfilter([1.0, -0.5], [1.0], row) / np.sqrt(0.75)
    np.testing.assert_allclose(Noise(1.0, np.array([0.5]), "").whitened(row, np.ones(50))[1:], filtered[1:])


def test_of_stated_noise_with_memory_what_is_new_is_judged_by_its_cycles():
    """Its level in 70 cycles is off by chance, more than what is new in each sample."""
    ar, weight = np.array([1.3582, -0.6873]), np.ones(4000)
    by_level, whitened = [], []
    for seed in range(60):
        row = series(ar, 4000, seed)
        noise = from_cycles(row, weight, row, 0, 2.0)
        assert noise.source == STATED
        by_level.append(np.mean(Noise(2.0, noise.ar, STATED).whitened(row, weight) ** 2))
        whitened.append(np.mean(noise.whitened(row, weight) ** 2))
    assert np.std(whitened) < 0.005 < 0.02 < np.std(by_level)
    assert np.mean(whitened) == pytest.approx(1.0, abs=0.003)
    wrong = from_cycles(row, weight, row, 0, 1.0)  # stated as half of what it is
    assert (wrong.sigma, wrong.source) == (1.0, STATED)


@pytest.mark.parametrize(("samples", "stated", "own"), [(4000, 1.9, True), (4000, 1.5, False), (300, 1.9, False)])
def test_many_cycles_tell_a_level_better_than_it_is_stated_unless_they_contradict_it(samples, stated, own):
    """A clock that jitters adds to the noise of the channel, of which the record tells."""
    row, weight = series(np.zeros(0), samples), np.ones(samples)
    noise = from_cycles(row, weight, row, 0, stated)
    assert noise.source == STATED
    assert noise.sigma == (pytest.approx(np.sqrt(np.mean(row**2)), rel=1e-6) if own else stated)


@pytest.mark.parametrize("ar", [[], [0.8], [1.3582, -0.6873]])
@pytest.mark.parametrize("stated", [None, 2.0])
def test_what_changes_slowly_from_cycle_to_cycle_is_no_noise(ar, stated):
    """A zero that drifts by several times the noise would be taken for a memory without end, and be whitened away."""
    time = np.arange(4000) / 100.0
    slow = np.column_stack([time - time.mean(), time * np.sin(2.0 * np.pi * time)])
    row = series(ar, 4000) + 0.5 * slow[:, 0]
    noise = from_cycles(row, np.ones(4000), row, 0, stated, (slow[:, 1:], slow))
    assert noise.sigma == pytest.approx(2.0, rel=0.06)
    np.testing.assert_allclose(noise.ar[: len(ar)], ar[: noise.ar.size], atol=0.06)
    assert noise.ar.size < 5
    none = from_cycles(series(ar, 4000), np.ones(4000), row, 0, stated, (slow[:, 1:], slow))
    same = from_cycles(series(ar, 4000), np.ones(4000), row, 0, stated)
    np.testing.assert_array_equal(none.ar, same.ar)  # where nothing changes none is taken out


@pytest.mark.parametrize(("gain", "taken_out"), [(0.7, False), (1.4, True)])
def test_a_slow_change_is_taken_out_where_that_lowers_schwarz_s_criterion(gain, taken_out):
    """By n ln(S / S'), of the sums of squares with the change and without it, of which ln n is the price."""
    n = 2000
    slow = np.linspace(-1.0, 1.0, n)[:, None]
    white, slow = Projection(slow)(series([], n)), slow / np.linalg.norm(slow)
    row = white + slow[:, 0] * np.sqrt((n ** (gain / n) - 1.0) * (white @ white))
    noise = from_cycles(row, np.ones(n), row, 0, None, (slow,))
    assert noise.ar.size == 0
    assert noise.sigma**2 == pytest.approx(white @ white / (n - 1) if taken_out else row @ row / n, rel=1e-6)


@pytest.mark.parametrize("ar", [[], [0.8]])
def test_noise_that_is_judged_by_a_residual_does_not_exceed_it(ar):
    row, weight = series(ar, 4000), np.ones(4000)
    judged = Noise(3.0, np.array(ar), RESIDUAL)
    assert judged.within(row, weight).sigma == pytest.approx(2.0, rel=0.05)
    assert judged.within(2.0 * row, weight).sigma == 3.0
    assert Noise(3.0, np.array(ar), STATED).within(row, weight).sigma == 3.0


@pytest.mark.parametrize("drift", [0.0, 0.02, 0.1])
def test_what_is_noise_does_not_depend_on_the_unit(drift):
    """Neither where it drifts hardly, nor where it drifts much: displacements are small numbers in metres."""
    time, weight = np.arange(2000) / 100.0, np.ones(2000)
    slow = np.column_stack([time - time.mean(), time * np.sin(2.0 * np.pi * time), time * np.cos(2.0 * np.pi * time)])
    row = series([0.6], 2000) + drift * slow[:, 0]
    found = {unit: from_cycles(unit * row, weight, unit * row, 0, None, (slow,)) for unit in (1e-6, 1.0, 1e6)}
    for unit, noise in found.items():
        assert noise.sigma / unit == pytest.approx(found[1.0].sigma, rel=1e-9)
        np.testing.assert_allclose(noise.ar, found[1.0].ar, rtol=1e-9)


@pytest.mark.parametrize("stated", [None, 2.0])
@pytest.mark.parametrize("ar", MEMORIES)
def test_what_a_fit_leaves_of_noise_has_unit_variance_once_whitened_by_what_it_tells(ar, stated):
    """Whatever the fit absorbs: here most of a slow noise's power, as the parameters of all candidates do."""
    x = np.linspace(-1.0, 1.0, 600)
    fit = Projection(np.polynomial.legendre.legvander(x, 24))
    table, squares = absorbed_by(fit.basis), []
    for seed in range(60):
        row = fit(series(ar, 600, seed))
        noise = from_residual(row, np.ones(600), np.ones(600), stated, table)
        squares.append(np.sum(noise.whitened(row, np.ones(600)) ** 2) / (600 - fit.rank))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("share", [0.003, 0.02, 0.1])
@pytest.mark.parametrize("about", [from_cycles, from_residual])
def test_a_few_lost_samples_do_not_spoil_the_memory_of_noise_that_is_long(about, share):
    """Correlations of lag after lag, each from the pairs that are left, would be those of no noise at all."""
    ar, found = [1.5, -0.6], []
    for seed in range(20):
        noise = series(ar, 670, seed)
        weight = (np.random.default_rng(seed).uniform(size=670) > share).astype(float)
        more = (0,) if about is from_cycles else ()
        found.append(about(np.where(weight > 0.0, noise, 0.0), weight, noise, *more, None))
    true = Noise(2.0, np.array(ar), "")
    assert [one.innovation for one in found] == pytest.approx([true.innovation] * 20, rel=0.25)
    assert np.mean([one.innovation * one.sigma for one in found]) == pytest.approx(2.0 * true.innovation, rel=0.03)


@pytest.mark.parametrize("phi", [0.0, 0.9, 0.97])
def test_a_stated_level_is_not_overridden_by_a_residual_that_is_far_smaller(phi):
    for seed in range(20):
        row = series([phi] if phi else [], 400, seed, sigma=0.01)
        noise = from_residual(row, np.ones(400), np.ones(400), stated=1.0)
        assert (noise.sigma, noise.source) == (1.0, STATED)


@pytest.mark.parametrize("counted", [5.0, 60.0, 4000.0])
@pytest.mark.parametrize("ar", [[], [0.9]])
def test_a_mean_square_lies_within_its_bounds(ar, counted):
    noise = Noise(1.0, np.array(ar), "")
    low, high = noise.mean_square_interval(counted)
    rows = [series(ar, int(counted), seed, sigma=1.0) for seed in range(2000)]
    outside = np.mean([not low < np.mean(row**2) < high for row in rows])
    assert 0.0 < low < 1.0 < high
    assert outside < 0.015  # 0.27 % where it is exactly chi-square


@pytest.mark.parametrize("lost", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("weight", [1.0, 0.2])
@pytest.mark.parametrize("ar", [[], [0.8]])
def test_the_level_of_known_memory_is_that_of_the_samples_that_count(ar, weight, lost):
    row, counts = series(ar, 20_000), np.random.default_rng(5).random(20_000) >= lost
    noise = with_autoregression(np.array(ar), row * counts, weight * counts, np.ones(20_000), None)
    assert noise.sigma == pytest.approx(2.0, rel=0.15 if lost > 0.5 else 0.06)


def test_the_level_of_samples_without_neighbours_is_their_mean_square():
    row, counts = series([], 3000), np.arange(3000) % 3 == 0
    noise = with_autoregression(np.zeros(0), row * counts, 1.0 * counts, np.ones(3000), None)
    assert noise.sigma == pytest.approx(2.0, rel=0.06)


@pytest.mark.parametrize("phi", [0.9, 0.999])
def test_drawn_noise_is_stationary_from_its_first_sample_on(phi):
    first = [series([phi], 5, seed)[0] for seed in range(4000)]
    assert np.std(first) == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 3.0, 100.0])
def test_noise_at_another_interval_keeps_its_level_and_its_correlation_in_time(ratio):
    noise = Noise(2.0, np.array([0.95]), "")
    other = noise.at_interval(ratio)
    assert other.sigma == noise.sigma
    lags = np.arange(1, 13)
    np.testing.assert_allclose(other.autocorrelation(13)[1:], 0.95 ** (ratio * lags), atol=0.02)
    white = Noise(2.0, np.zeros(0), "")
    assert white.at_interval(ratio) is white
