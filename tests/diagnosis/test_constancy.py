"""Whether sizes are the same everywhere."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from calib.diagnosis.constancy import inconstancy
from calib.diagnosis.score import Projection

ROWS, LENGTH = 4, 300
SIZES = np.array([5.0, -8.0])
EVIDENCE = SimpleNamespace(
    rows=lambda: np.repeat(np.arange(ROWS), LENGTH), segments=lambda: np.tile(np.arange(LENGTH) // 15, ROWS)
)


def fitted(sizes, memory=0.0, seed=0):
    """A linear model with two effects of sizes (row, 2) and one calibrated parameter, fitted with one size each.

    memory : of the noise, and of what the effects do, from sample to sample
    """
    rng = np.random.default_rng(seed)
    drawn = lfilter([1.0], [1.0, -memory], rng.standard_normal((ROWS * LENGTH, 4)), axis=0)
    columns, noise = drawn[:, :3] / np.linalg.norm(drawn[:, :3], axis=0), drawn[:, 3]
    data = (columns[:, 1:] * sizes[EVIDENCE.rows()]).sum(axis=1) + noise
    return SimpleNamespace(
        columns=columns,
        names=("stiffness", "one", "other"),
        found=(SimpleNamespace(free=("one",), form=()), SimpleNamespace(free=(), form=("other",))),
        absorbing=Projection(columns),
        residual=Projection(columns)(data),
    )


def test_noise_makes_one_size_differ_as_often_as_it_should():
    z = np.array([inconstancy(EVIDENCE, fitted(np.tile(SIZES, (ROWS, 1)), seed=seed)) for seed in range(400)])
    for limit, share in ((1.0, 0.317), (2.0, 0.0455)):
        assert (z > limit).mean() == pytest.approx(share, abs=3.0 * np.sqrt(share * (1.0 - share) / z.size))


def test_what_is_left_in_stretches_does_not_pass_for_sizes_that_differ():
    even = np.tile(SIZES, (ROWS, 1))
    z = np.array([inconstancy(EVIDENCE, fitted(even, memory=0.8, seed=seed)) for seed in range(100)])
    assert (z > 3.0).mean() <= 0.03


@pytest.mark.parametrize("effect", [0, 1])
def test_a_size_that_is_another_one_in_a_channel_is_seen(effect):
    sizes = np.tile(SIZES, (ROWS, 1))
    sizes[2, effect] += 40.0  # of which a channel that makes a quarter of the whole knows half: 20 standard errors
    z = inconstancy(EVIDENCE, fitted(sizes))
    assert 10.0 < z < 20.0


def test_with_one_channel_there_is_nothing_to_differ():
    alone = SimpleNamespace(rows=lambda: np.zeros(ROWS * LENGTH, dtype=int), segments=EVIDENCE.segments)
    assert inconstancy(alone, fitted(np.tile(SIZES, (ROWS, 1)))) == 0.0
