"""Whitened residuals of pure noise; `tests/benchmarks/bench_whitening.py` plays many more."""

import numpy as np
import pytest
from benchmarks.bench_whitening import NOISES, whitened


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("cycles", [2.5, 10.0])
def test_pure_noise_of_any_clock_has_unit_variance_and_no_autocorrelation_once_whitened(noise, cycles):
    variances, neighbours = [], []
    for clock in range(12):
        for row in whitened(np.random.default_rng(clock), clock, NOISES[noise], cycles):
            variances.append(np.mean(row**2))
            neighbours.append(row[1:] @ row[:-1] / (row @ row) * np.sqrt(row.size))
    assert np.mean(variances) == pytest.approx(1.0, abs=max(0.05, 4.0 * np.std(variances) / np.sqrt(len(variances))))
    assert abs(np.mean(neighbours)) * np.sqrt(len(neighbours)) < 4.0
