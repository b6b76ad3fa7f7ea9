"""Outliers of records, beside what merely looks like them."""

import numpy as np
import pytest

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.record_faults import outliers

PERIOD, RATE, CYCLES = 0.1, 730.0, 6  # s, Hz
TIME = np.arange(round(PERIOD * CYCLES * RATE)) / RATE
ROWS = (("mass", "velocity"),)


def part(measured, period):
    ones = np.ones(measured.shape)
    noise = (Noise(0.01, np.zeros(0), STATED),)
    return Part("one", ROWS, TIME, measured, period, 1, (), noise, ones > 0.0, ones)


def motion(impact):
    """A velocity that jumps at this phase and is back after a sample; the simulation has another phase of it."""
    phase = (TIME / PERIOD) % 1.0
    return (np.sin(2.0 * np.pi * phase) + 3.0 * (np.abs(phase - impact) < 0.5 / (RATE * PERIOD)))[None]


@pytest.mark.parametrize("period", [PERIOD, None])
def test_lost_samples_are_outliers_whether_the_motion_repeats_or_not(period):
    rng = np.random.default_rng(0)
    measured = motion(2.0) + 0.01 * rng.standard_normal((1, TIME.size))
    lost = rng.choice(TIME.size, 5, replace=False)
    measured[0, lost] += 2.0
    found = outliers(part(measured, period), SimulatedRows(motion(2.0), np.ones(TIME.size)))
    assert np.flatnonzero(found[0]).tolist() == sorted(lost)


def test_what_comes_again_in_every_cycle_is_no_outlier():
    rng = np.random.default_rng(0)
    measured = motion(0.4) + 0.01 * rng.standard_normal((1, TIME.size))
    simulated = SimulatedRows(motion(0.6), np.ones(TIME.size))
    assert outliers(part(measured, None), simulated).any()  # without a period nothing tells that it comes again
    assert not outliers(part(measured, PERIOD), simulated).any()


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_outliers_that_have_others_in_neighbouring_cycles_by_chance_are_found(share):
    missed = count = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        measured = motion(2.0) + 0.01 * rng.standard_normal((1, TIME.size))
        lost = rng.choice(TIME.size, round(share * TIME.size), replace=False)
        measured[0, lost] += 2.0 * rng.choice([-1.0, 1.0], lost.size)
        seen = SimulatedRows(motion(2.0), np.ones(TIME.size))
        periodic, single = (outliers(part(measured, period), seen)[0] for period in (PERIOD, None))
        missed, count = missed + (single & ~periodic).sum(), count + single.sum()
    assert missed < 0.07 * count
