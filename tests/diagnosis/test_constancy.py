"""Whether sizes are the same everywhere."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.constancy import inconstancy
from calib.diagnosis.score import Projection

ROWS, LENGTH = 4, 300
SIZES = np.array([5.0, -8.0])
EVIDENCE = SimpleNamespace(
    rows=lambda: np.repeat(np.arange(ROWS), LENGTH), segments=lambda: np.tile(np.arange(LENGTH) // 15, ROWS)
)


def fitted(sizes, memory=0.0, seed=0):
    """A linear model with two effects of sizes (row, 2) and one calibrated parameter, fitted with one size each."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((ROWS * LENGTH, 3))
    columns /= np.linalg.norm(columns, axis=0)
    noise = rng.standard_normal(ROWS * LENGTH)
    for index in range(1, noise.size):
        noise[index] = memory * noise[index - 1] + np.sqrt(1.0 - memory**2) * noise[index]
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


@pytest.mark.parametrize("effect", [0, 1])
def test_a_size_that_is_another_one_in_a_channel_is_seen(effect):
    sizes = np.tile(SIZES, (ROWS, 1))
    sizes[2, effect] += 40.0  # of which a channel that makes a quarter of the whole knows half: 20 standard errors
    z = inconstancy(EVIDENCE, fitted(sizes))
    assert 10.0 < z < 20.0


def test_with_one_channel_there_is_nothing_to_differ():
    alone = SimpleNamespace(rows=lambda: np.zeros(ROWS * LENGTH, dtype=int), segments=EVIDENCE.segments)
    assert inconstancy(alone, fitted(np.tile(SIZES, (ROWS, 1)))) == 0.0
