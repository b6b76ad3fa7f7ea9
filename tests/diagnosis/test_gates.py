"""What has to hold before a residual is given a cause."""

import numpy as np
import pytest

from calib.diagnosis.evidence import Evidence, Part
from calib.diagnosis.gates import above_noise
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.refit import Fit

SIZE = 500


def judged(ratio, size=SIZE):
    """The gate on a residual whose standard deviation is so many times its noise."""
    rows, time = (("mass", "displacement"),), np.arange(size) * 1e-3
    noise, ones = (Noise(1e-4, np.zeros(0), STATED),), np.ones((1, size))
    part = Part("decay", rows, time, ones, None, 1, (), noise, ones > 0.0, ones)
    residual = ratio * np.random.default_rng(1).standard_normal(size)
    none = np.zeros((size, 0))
    return above_noise(Evidence((part,)), Fit(None, (), residual, none, (), (), none, np.zeros(size, dtype=int)))


@pytest.mark.parametrize("ratio", [1.0, 0.95, 3.0])
def test_a_residual_about_or_above_its_noise_passes(ratio):
    assert judged(ratio).passed


def test_a_residual_far_below_its_noise_does_not():
    gate = judged(0.4)
    assert not gate.passed
    assert "decay mass displacement" in gate.summary
    assert "the stated uncertainty is too large" in gate.summary


def test_a_few_samples_say_nothing():
    assert judged(0.4, 20).passed
