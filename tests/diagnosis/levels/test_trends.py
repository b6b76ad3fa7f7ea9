"""Trends over the levels of a frequency response, on closed forms of one mode with an amplitude-dependent force."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from calib.diagnosis.levels.peak import peak
from calib.diagnosis.levels.trend import damping_trend, resonance_trend

FREQUENCY = np.linspace(2.7, 3.7, 60)  # Hz
LEVELS = (0.1, 0.25, 0.6)  # N
STIFFNESS, DAMPING = 400.0, 0.6  # N/m, N s/m of 1 kg
NOISE = 0.005  # of the largest amplitude


def receptance(level, damping=lambda x, omega: 0.0, stiffness=lambda x: 0.0, frequencies=FREQUENCY):
    """Receptance of a mode of 1 kg whose force adds an equivalent damping and stiffness at the amplitude x  [m/N]."""

    def excess(x, omega):
        real = STIFFNESS + stiffness(x) - omega**2
        return x * math.hypot(real, omega * (DAMPING + damping(x, omega))) - level

    return np.array([brentq(excess, 1e-9, 1.0, args=(2.0 * math.pi * f,)) for f in frequencies]) / level


def trends(levels=LEVELS, seed=1, **forces):
    """Trends of damping and resonance that noisy sweeps of a force show."""
    rng, peaks = np.random.default_rng(seed), []
    for level in levels:
        own = receptance(level, **forces)
        sigma = np.full(own.size, NOISE * own.max())
        peaks.append(peak(FREQUENCY, own + sigma * rng.standard_normal(own.size), sigma, np.full(own.size, 1e-4)))
    group = list(range(len(levels)))
    return damping_trend(levels, peaks, group, False), resonance_trend(levels, peaks, group)


def drag(x, omega):
    """Equivalent damping of quadratic drag, c = 3 1/m."""
    return 8.0 * 3.0 * omega * x / (3.0 * math.pi)


def friction(x, omega):
    """Equivalent damping of dry friction of 0.03 N."""
    return 4.0 * 0.03 / (math.pi * omega * x)


def test_drag_makes_the_damping_grow_by_less_than_its_own_power():
    damping, resonance = trends(damping=drag)
    assert damping.significant
    assert 0.1 < damping.slope < 1.0
    assert not resonance.significant


def test_friction_makes_the_damping_fall():
    damping, resonance = trends(damping=friction)
    assert damping.significant
    assert -1.0 < damping.slope < -0.1
    assert not resonance.significant


def test_a_cubic_spring_moves_the_resonance_and_not_the_damping():
    damping, resonance = trends(stiffness=lambda x: 0.75 * 5e3 * x**2)
    assert resonance.significant
    assert resonance.slope > 0.0
    assert not damping.significant


def test_a_linear_mode_has_no_trend():
    significant = [[trend.significant for trend in trends(seed=seed)] for seed in range(40)]
    assert np.sum(significant) <= 1  # 80 of three standard errors: 0.2 are expected


def test_the_standard_error_is_that_of_repeated_measurements():
    for forces in ({}, {"damping": drag}, {"damping": friction}):
        found = [trends(seed=seed, **forces)[0] for seed in range(60)]
        assert np.std([t.slope for t in found]) == pytest.approx(np.mean([t.error for t in found]), rel=0.5)


def test_a_trend_below_three_standard_errors_is_not_significant():
    damping, _ = trends(damping=lambda x, omega: 0.002 * drag(x, omega))
    assert damping.slope < 3.0 * damping.error
    assert not damping.significant


def test_at_held_amplitudes_the_damping_has_the_power_of_the_amplitude_itself():
    amplitude, omega = (0.02, 0.03, 0.05), math.sqrt(STIFFNESS)
    peaks = []
    for x in amplitude:
        w = 2.0 * math.pi * FREQUENCY
        own = 1.0 / np.abs(STIFFNESS - w**2 + 1j * w * drag(x, omega))
        peaks.append(peak(FREQUENCY, own, np.full(own.size, 0.01 * own.max()), np.full(own.size, 1e-4)))
    assert damping_trend(amplitude, peaks, [0, 1, 2], True).slope == pytest.approx(1.0, abs=0.05)


def test_a_sweep_that_jumps_at_its_peak_does_not_resolve_it():
    own = receptance(0.1)
    own[np.argmax(own) + 1 :] *= 0.3
    assert not peak(FREQUENCY, own, 0.01 * own, np.full(own.size, 1e-4)).resolved


def test_repeated_sweeps_that_differ_enlarge_the_error():
    peaks = [peak(FREQUENCY, receptance(level), np.full(60, 1e-4), np.full(60, 1e-4)) for level in LEVELS]
    again = [peak(FREQUENCY, 1.05 * receptance(level), np.full(60, 1e-4), np.full(60, 1e-4)) for level in LEVELS]
    apart = damping_trend(LEVELS * 2, peaks + again, [0, 1, 2] * 2, False)
    assert apart.error > 5.0 * damping_trend(LEVELS * 2, peaks * 2, [0, 1, 2] * 2, False).error
