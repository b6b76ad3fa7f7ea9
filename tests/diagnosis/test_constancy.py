"""Whether sizes are the same everywhere."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from calib.diagnosis import constancy
from calib.diagnosis.constancy import constancies, differing
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.score import Projection

ROWS, LENGTH = 4, 300
SIZES = np.array([5.0, -8.0])
OWNER = np.repeat(np.arange(ROWS), LENGTH)
EVIDENCE = SimpleNamespace(rows=lambda: OWNER, of_row=lambda c, number: c * (number == OWNER)[:, None])


def effect(free=(), form=()):
    nulls = dict.fromkeys((*free, *form), 0.0)
    return SimpleNamespace(name=(*free, *form)[0], free=free, form=form, effect=SimpleNamespace(null=nulls))


def fitted(sizes, autocorrelation=0.0, seed=0):
    """A linear model with two effects of sizes (row, 2) and one calibrated parameter, fitted with one size each.

    autocorrelation : of the noise and of what the effects do, from sample to sample
    """
    rng = np.random.default_rng(seed)
    drawn = lfilter([1.0], [1.0, -autocorrelation], rng.standard_normal((ROWS * LENGTH, 4)), axis=0)
    columns, noise = drawn[:, :3] / np.linalg.norm(drawn[:, :3], axis=0), drawn[:, 3]
    data = (columns[:, 1:] * sizes[EVIDENCE.rows()]).sum(axis=1) + noise
    estimate = dict(zip(("stiffness", "one", "other"), np.linalg.lstsq(columns, data, rcond=None)[0], strict=True))
    return SimpleNamespace(
        columns=columns,
        names=tuple(estimate),
        candidates=(effect(free=("one",)), effect(form=("other",))),
        free=lambda c: c,
        value=estimate.get,
        residual=Projection(columns)(data),
    )


def deviates(evidence, fit):
    return np.array([constancy.z for constancy in constancies(evidence, fit)])


def test_noise_makes_one_size_differ_as_often_as_it_should():
    even = np.tile(SIZES, (ROWS, 1))
    z = np.concatenate([deviates(EVIDENCE, fitted(even, seed=seed)) for seed in range(200)])
    for limit, share in ((1.0, 0.317), (2.0, 0.0455)):
        assert (z > limit).mean() == pytest.approx(share, abs=3.0 * np.sqrt(share * (1.0 - share) / z.size))


def test_autocorrelated_noise_does_not_pass_for_sizes_that_differ():
    even = np.tile(SIZES, (ROWS, 1))
    z = np.concatenate([deviates(EVIDENCE, fitted(even, autocorrelation=0.8, seed=seed)) for seed in range(50)])
    assert (z > 3.0).mean() <= 0.03


@pytest.mark.parametrize("index", [0, 1])
def test_a_size_that_is_another_one_in_a_channel_is_seen_in_that_effect_alone(index):
    sizes = np.tile(SIZES, (ROWS, 1))
    # of 40 a channel that makes a quarter of the whole knows half: 17 standard errors
    sizes[2, index] += np.copysign(40.0, SIZES[index])
    varying, other = np.array(constancies(EVIDENCE, fitted(sizes)))[[index, 1 - index]]
    assert 10.0 < varying.z < 20.0
    mean = sizes[:, index].mean()
    assert varying.variation == pytest.approx(np.abs(sizes[:, index].std() / mean), rel=0.3)
    assert other.z < 4.0


def test_another_size_in_a_channel_that_hardly_shows_the_effect_is_significant_and_explains_little(monkeypatch):
    """Model error hides the size in the other channels; that of the quiet one is exact, and explains little."""
    rng = np.random.default_rng(0)
    quiet = OWNER == 2
    one = rng.standard_normal(OWNER.size) * np.where(quiet, 0.1, 1.0)
    columns = np.column_stack([rng.standard_normal(OWNER.size) / 30.0, one, np.zeros(OWNER.size)])
    data = 5.0 * one * np.where(quiet, 3.0, 1.0) + rng.standard_normal(OWNER.size) * np.where(quiet, 0.01, 4.0)
    sizes = np.linalg.lstsq(columns, data, rcond=None)[0]
    fit = SimpleNamespace(
        columns=columns,
        names=("stiffness", "one", "other"),
        candidates=(effect(free=("one",)),),
        free=lambda c: c,
        value=dict(zip(("stiffness", "one", "other"), sizes, strict=True)).get,
        residual=Projection(columns[:, :2])(data),
    )
    [own] = constancies(EVIDENCE, fit)
    assert own.z > 10.0
    assert own.variation < 0.5 * CRITERIA.max_variation
    monkeypatch.setattr(constancy, "_variation_by_information", lambda *_: np.inf)
    [by_variances] = constancies(EVIDENCE, fit)
    assert by_variances.variation > CRITERIA.max_variation
    assert differing([by_variances], 3.0, explained_by_several=False) == (by_variances,)
    assert differing([own], 3.0, explained_by_several=False) == ()
    assert differing([own], 3.0, explained_by_several=True) == (own,)


def test_the_chi_square_of_an_effect_is_the_rise_without_it():
    [one, other] = constancies(EVIDENCE, fitted(np.tile(SIZES, (ROWS, 1))))
    assert one.chi2 == pytest.approx(25.0, rel=0.5)
    assert other.chi2 == pytest.approx(64.0, rel=0.5)


def test_with_one_channel_there_is_nothing_to_differ():
    alone = SimpleNamespace(rows=lambda: np.zeros(ROWS * LENGTH, dtype=int), of_row=lambda c, number: c)
    assert deviates(alone, fitted(np.tile(SIZES, (ROWS, 1)))) == pytest.approx([0.0, 0.0])
