"""The noise of measured channels."""

import numpy as np
import pytest
from scipy.signal import lfilter

from calib.cycles import mean_cycle
from calib.diagnosis.noise import STATED, Noise, from_cycles, from_residual, with_memory


def series(memory, size, seed=0, sigma=2.0):
    """An autoregression of standard deviation sigma."""
    return Noise(sigma, np.array(memory), "").drawn(np.random.default_rng(seed), size)


@pytest.mark.parametrize("memory", [[], [0.8], [1.2, -0.5]])
def test_drawn_noise_has_its_level(memory):
    assert series(memory, 200_000).std() == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize("memory", [[], [0.8], [1.2, -0.5]])
@pytest.mark.parametrize("per_cycle", [500.0, 487.35, 20.7])
def test_level_and_memory_are_found_from_cycles_of_whatever_motion(memory, per_cycle):
    time = np.arange(10_000) / per_cycle
    motion = 30.0 * np.sin(2.0 * np.pi * time) + 5.0 * np.cos(6.0 * np.pi * time + 1.0)
    row, weight = motion + series(memory, time.size), np.ones(time.size)
    mean = mean_cycle(time, row[None], 1.0)
    noise = from_cycles(mean.residual[0], weight, row, mean.parameters, None)
    assert noise.sigma == pytest.approx(2.0, rel=0.1)
    np.testing.assert_allclose(noise.memory[: len(memory)], memory, atol=0.06)


@pytest.mark.parametrize("memory", [[], [0.8], [1.2, -0.5]])
def test_whitened_noise_is_white_and_of_unit_variance(memory):
    noise = Noise(2.0, np.array(memory), "")
    white = noise.whitened(series(memory, 100_000), np.ones(100_000))[50:]
    assert white.std() == pytest.approx(1.0, rel=0.02)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.02


def test_colouring_undoes_whitening():
    noise, row = Noise(2.0, np.array([0.8]), ""), series([0.8], 300)
    np.testing.assert_allclose(noise.coloured(noise.whitened(row, np.ones(300))), row, atol=1e-12)


def test_a_stated_level_comes_first():
    noise = from_residual(series([], 1000), np.ones(1000), np.ones(1000), stated=0.5)
    assert (noise.sigma, noise.source) == (0.5, STATED)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.95])
def test_memory_of_stated_noise_is_that_of_a_residual_which_is_no_larger(phi):
    row = series([phi] if phi else [], 4000)
    noise = from_residual(row, np.ones(4000), np.ones(4000), stated=2.0)
    assert noise.sigma == 2.0
    assert noise.memory.sum() == pytest.approx(phi, abs=0.1)


@pytest.mark.parametrize("error", [1.0, 4.0])
def test_an_error_of_the_model_gives_stated_noise_no_memory(error):
    wave = error * 2.0 * np.sin(np.linspace(0.0, 60.0, 4000))  # 1.2 and 3 times the stated level in all
    noise = from_residual(series([], 4000) + wave, np.ones(4000), np.ones(4000), stated=2.0)
    assert noise.memory.size == 0


@pytest.mark.parametrize("memory", [[], [0.8], [1.2, -0.5], [0.5, 0.2, -0.4, 0.1]])
@pytest.mark.parametrize("lags", [1, 2, 4, 40])
def test_the_autocorrelation_is_that_of_the_impulse_response(memory, lags):
    impulse = lfilter([1.0], np.concatenate([[1.0], -np.array(memory)]), np.eye(1, 5000)[0])
    whole = np.correlate(impulse, impulse, "full")[4999:]
    noise = Noise(2.0, np.array(memory), "")
    np.testing.assert_allclose(noise.autocorrelation(lags), (whole / whole[0])[:lags], atol=1e-9)


@pytest.mark.parametrize("memory", [[], [0.8], [1.5, -0.7]])
def test_the_mean_square_of_noise_varies_as_stated(memory):
    squares = [np.mean(series(memory, 2000, seed) ** 2) / 4.0 for seed in range(400)]
    known = Noise(2.0, np.array(memory), "").mean_square_std(2000.0)
    assert np.std(squares) == pytest.approx(known, rel=0.15)


def test_of_known_memory_the_fastest_part_of_a_residual_tells_the_level():
    slow = 40.0 * np.sin(np.linspace(0.0, 20.0, 20_000))
    noise = with_memory(np.array([0.8]), slow + series([0.8], 20_000), np.ones(20_000), np.ones(20_000), None)
    assert noise.sigma == pytest.approx(2.0, rel=0.1)


def test_samples_without_weight_do_not_count():
    row, weight = series([], 4000), np.ones(4000)
    row[::10], weight[::10] = 1e6, 0.0
    assert from_residual(row, weight, np.ones(4000), None).sigma == pytest.approx(2.0, rel=0.1)


def test_filter_and_draw_agree_with_scipy():
    noise = Noise(1.0, np.array([0.5]), "")
    row = np.random.default_rng(1).standard_normal(50)
    np.testing.assert_allclose(noise.whitened(row, np.ones(50)), lfilter([1.0, -0.5], [1.0], row) / np.sqrt(0.75))


def test_of_stated_noise_with_memory_what_is_new_is_judged_by_its_cycles():
    """Its level in 70 cycles is off by chance, more than what is new in each sample."""
    memory, weight = np.array([1.3582, -0.6873]), np.ones(4000)
    by_level, whitened = [], []
    for seed in range(60):
        row = series(memory, 4000, seed)
        noise = from_cycles(row, weight, row, 0, 2.0)
        assert noise.source == STATED
        by_level.append(np.mean(Noise(2.0, noise.memory, STATED).whitened(row, weight)[2:] ** 2))
        whitened.append(np.mean(noise.whitened(row, weight)[2:] ** 2))
    assert np.std(whitened) < 0.005 < 0.02 < np.std(by_level)
    assert np.mean(whitened) == pytest.approx(1.0, abs=0.003)
    wrong = from_cycles(row, weight, row, 0, 1.0)  # stated as half of what it is
    assert (wrong.sigma, wrong.source) == (1.0, STATED)
    white = series(np.zeros(0), 4000)
    assert from_cycles(white, weight, white, 0, 2.05).sigma == 2.05
