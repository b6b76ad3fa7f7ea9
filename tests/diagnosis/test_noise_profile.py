import numpy as np
import pytest

from calib.diagnosis.noise import Noise, Remainder
from calib.diagnosis.noise_profile import noise_profiles
from calib.diagnosis.score import Projection

ROWS = [("mass", "in_phase"), ("mass", "quadrature")]
DETUNING = np.tile(np.linspace(-4.0, 4.0, 24), 3)
RESPONSE = 50.0 / (DETUNING - 1j)  # a resonance, of three sweeps
MEASURED = np.array([RESPONSE.real, RESPONSE.imag])


def profiles(proportional, seed, fitted=0):
    """Profiles for noise of these shares, of which a fit has taken some signals at the resonance."""
    rng = np.random.default_rng(seed)
    scale = 0.02 * np.abs(RESPONSE) if proportional else np.ones(RESPONSE.size)
    noise = rng.standard_normal(MEASURED.shape) * scale
    at_resonance = rng.standard_normal((MEASURED.size, fitted)) * np.tile(np.abs(RESPONSE) ** 2, 2)[:, None]
    fit = Projection(at_resonance)
    leverage = (fit.basis**2).sum(axis=1).reshape(MEASURED.shape)
    left = Remainder(fit(noise.ravel()).reshape(MEASURED.shape), noise, np.zeros((2, 1, 1)), leverage)
    return noise_profiles(ROWS, MEASURED, np.ones(MEASURED.shape), left)


@pytest.mark.parametrize("fitted", [0, 10])
def test_noise_in_proportion_to_the_amplitude_is_found_though_a_fit_absorbs_much_of_it(fitted):
    expected = np.abs(RESPONSE) / np.sqrt(np.mean(np.abs(RESPONSE) ** 2))
    for seed in range(5):
        one, other = profiles(True, seed, fitted)
        np.testing.assert_array_equal(one, other)  # of both parts
        np.testing.assert_allclose(one, expected, atol=0.2)
        assert np.mean(one**2) == pytest.approx(1.0)


def test_white_noise_has_no_profile():
    flat = [bool((profiles(False, seed, 10)[0] == 1.0).all()) for seed in range(40)]
    assert np.mean(flat) >= 0.95


def test_a_higher_harmonic_has_a_profile_of_its_own():
    """Noise in proportion to the first harmonic, and white noise of another size in the second."""
    rng = np.random.default_rng(2)
    measured = np.concatenate([MEASURED, 0.1 * np.ones(MEASURED.shape)])
    scale = np.concatenate([np.tile(0.02 * np.abs(RESPONSE), (2, 1)), np.full(MEASURED.shape, 1e-3)])
    noise = scale * rng.standard_normal(measured.shape)
    left = Remainder(noise, noise, np.zeros((4, 1, 1)), np.zeros(measured.shape))
    rows = [*ROWS, ("mass", "in_phase_2"), ("mass", "quadrature_2")]
    first, _, second, other = noise_profiles(rows, measured, np.ones(measured.shape), left)
    np.testing.assert_array_equal(first, noise_profiles(ROWS, measured[:2], np.ones((2, 72)), Remainder(
        noise[:2], noise[:2], np.zeros((2, 1, 1)), np.zeros((2, 72))))[0])  # fmt: skip
    assert np.ptp(first) > 0.5
    np.testing.assert_array_equal([second, other], np.ones((2, 72)))


def test_noise_of_a_profile_is_whitened_and_coloured_again():
    noise = Noise(2.0, np.array([0.6]), "", profile=np.linspace(0.5, 1.5, 4000))
    row, weight = noise.drawn(np.random.default_rng(3), 4000), np.ones(4000)
    white = noise.whitened(row, weight)
    for half in np.split(white, 2):
        assert np.mean(half**2) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(noise.coloured(white, weight), row, rtol=1e-9)
