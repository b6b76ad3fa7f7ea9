"""Prediction of data left out, on linear models with Gaussian noise and known answers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.prediction import Prediction, folds, predicted
from calib.diagnosis.signature import Point

CAUSE = SimpleNamespace(free=("c",), form=(), null=np.zeros(1))
FAR_FROM_NULL = SimpleNamespace(free=("c",), form=(), null=np.full(1, 100.0))  # it changes all data
SIZE = 400
TIME = np.linspace(0.0, 1.0, SIZE, endpoint=False)


def evidence(count, period=None):
    one = np.ones((1, SIZE))
    noise = (Noise(1.0, np.zeros(0), STATED),)
    return Evidence(tuple(
        Part(f"r{k}", (("mass", "displacement"),), TIME, 0.0 * one, period, 1, (), noise, one > 0.0, one)
        for k in range(count)
    ))  # fmt: skip


def fitted(measured, columns, names):
    """Least squares of the stacked records (N,) by the columns (N, k)."""
    values = np.linalg.lstsq(columns, measured, rcond=None)[0]
    none = np.zeros((measured.size, 0))
    rows = np.arange(measured.size) // SIZE
    point = Point(dict(zip(names, values, strict=True)), (), {})
    return Fit(point, (), measured - columns @ values, columns, names, (), none, rows)


def case(seed, size, count=2, period=None, shape=None):
    """Evidence and fits without and with a cause of this size in units of the noise of a sample."""
    rng = np.random.default_rng(seed)
    base = np.tile(np.column_stack([np.ones(SIZE), TIME]), (count, 1))
    shape = np.tile(np.sin(40.0 * TIME), count) if shape is None else shape
    measured = base @ [3.0, -1.0] + size * shape + rng.standard_normal(base.shape[0])
    known = evidence(count, period)
    return known, fitted(measured, base, ("a", "b")), fitted(measured, np.column_stack([base, shape]), ("a", "b", "c"))


def succeeds(prediction):
    """Whether the misfit falls by more than the standard error of its fall."""
    return prediction is not None and prediction.reduction > prediction.error


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [1, 2])
def test_a_cause_that_is_there_predicts(count, seed):
    assert succeeds(predicted(*case(seed, 1.0, count), CAUSE))


@pytest.mark.parametrize("count", [1, 2])
def test_what_is_not_there_predicts_seldom(count):
    found = [succeeds(predicted(*case(seed, 0.0, count), CAUSE)) for seed in range(60)]
    assert np.mean(found) < 0.2


def test_a_share_is_certain_where_the_misfit_sits_in_few_segments():
    shape = np.tile(np.sin(40.0 * TIME) * np.exp(-0.5 * ((TIME - 0.5) / 0.03) ** 2), 2)
    found = predicted(*case(0, 30.0, shape=shape), CAUSE)
    assert found.error > 0.2 * found.reduction
    assert found.reduction / found.without == pytest.approx(1.0 - 2 * SIZE / found.without, abs=3.0 * found.share_error)
    assert found.share_error < 0.05


def test_the_error_of_a_share_is_that_of_its_draws():
    found = [predicted(*case(seed, 0.7), CAUSE) for seed in range(200)]
    shares = [one.reduction / one.without for one in found]
    assert np.std(shares) == pytest.approx(np.mean([one.share_error for one in found]), rel=0.15)


def test_a_size_that_differs_from_record_to_record_does_not_predict():
    one = np.sin(40.0 * TIME)
    rng = np.random.default_rng(0)
    base = np.tile(np.column_stack([np.ones(SIZE), TIME]), (2, 1))
    measured = base @ [3.0, -1.0] + np.concatenate([one, -0.6 * one]) + rng.standard_normal(2 * SIZE)
    without = fitted(measured, base, ("a", "b"))
    with_it = fitted(measured, np.column_stack([base, np.tile(one, 2)]), ("a", "b", "c"))
    assert not succeeds(predicted(evidence(2), without, with_it, CAUSE))


def test_one_steady_tone_cannot_test_a_prediction():
    assert predicted(*case(0, 0.5, 1, period=0.1), CAUSE) is None


def test_a_cause_that_one_record_alone_shows_is_not_tested_on_it():
    shape = np.concatenate([np.sin(40.0 * TIME), np.zeros(SIZE)])
    assert predicted(*case(0, 0.5, 2, shape=shape), CAUSE) is None


def test_data_in_which_the_cause_changes_nothing_do_not_refute_it():
    shape = np.concatenate([np.zeros(SIZE), np.sin(40.0 * TIME), np.sin(40.0 * TIME)])
    known, without, with_it = case(0, 0.5, 3, shape=shape)
    assert predicted(known, without, with_it, CAUSE).folds == ("r1", "r2")


@pytest.mark.parametrize(
    ("reduction", "uncertainty", "folds", "fails"),
    [
        (-5.0, 0.0, 2, True),
        (5.0, 0.0, 2, False),
        (-5.0, 8.0, 2, False),
        (-9.0, 8.0, 2, True),
        (5.0, -8.0, 2, False),
        (-5.0, 0.0, 1, False),
        (-140.0, 0.0, 1, True),
        (-140.0, 30.0, 1, False),
    ],
)
def test_a_prediction_is_allowed_what_errors_of_parameters_add_and_a_single_fold_its_error(
    reduction, uncertainty, folds, fails
):
    assert Prediction(reduction, 120.0, 100.0, ("one", "two")[:folds], uncertainty).fails == fails


@pytest.mark.parametrize("sigma", [1.0, 3.0])
def test_what_the_errors_of_parameters_add_is_that_of_least_squares(sigma):
    """Of a straight line, and of one that is bent: sigma^2 tr(J (K' K)^-1 J') of each fold, whatever the noise."""
    bent = np.tile((TIME - 0.5) ** 2, 2)
    expected, found = 0.0, []
    for seed in range(60):
        known, without, with_it = case(seed, 0.0, shape=bent)
        scaled = [replace(fit, residual=sigma * fit.residual) for fit in (without, with_it)]
        found.append(predicted(known, *scaled, FAR_FROM_NULL).uncertainty)
    for own in (slice(0, SIZE), slice(SIZE, 2 * SIZE)):
        rest = np.ones(2 * SIZE, dtype=bool)
        rest[own] = False
        for fit, sign in ((with_it, 1.0), (without, -1.0)):
            inverse = np.linalg.inv(fit.columns[rest].T @ fit.columns[rest])
            expected += sign * sigma**2 * np.trace(fit.columns[own] @ inverse @ fit.columns[own].T)
    assert np.mean(found) == pytest.approx(expected, rel=0.2)


def test_a_cause_whose_size_the_other_records_hardly_tell_is_not_refuted_by_them():
    """In the first record it is large; the second, at a third of the size, tells little, and predicts badly."""
    shape = np.concatenate([np.sin(40.0 * TIME), 0.3 * np.sin(40.0 * TIME)])
    fails = []
    for seed in range(40):
        known, without, with_it = case(seed, 0.15, shape=shape)
        with_prediction = predicted(known, without, with_it, FAR_FROM_NULL)
        fails.append((with_prediction.fails, with_prediction.reduction <= 0.0))
    allowed, strict = np.mean(fails, axis=0)
    assert allowed < 0.5 * strict


def test_the_fall_is_that_of_least_squares_refitted_without_the_record():
    known, without, with_it = case(3, 0.5)
    found = predicted(known, without, with_it, CAUSE)
    falls = before = 0.0
    for own in (slice(0, SIZE), slice(SIZE, 2 * SIZE)):
        rest = np.ones(2 * SIZE, dtype=bool)
        rest[own] = False
        squares = []
        for fit in (without, with_it):
            values = np.linalg.lstsq(fit.columns[rest], fit.residual[rest], rcond=None)[0]
            squares.append(np.sum((fit.residual[own] - fit.columns[own] @ values) ** 2))
        falls += squares[0] - squares[1]
        before += squares[0]
    assert found.reduction == pytest.approx(falls, rel=1e-9)
    assert found.without == pytest.approx(before, rel=1e-9)


@pytest.mark.parametrize(("size", "blocks"), [(7, 0), (12, 0), (20, 2), (31, 3), (400, 4)])
def test_blocks_of_time_of_a_short_record_are_never_empty_nor_all_of_it(size, blocks):
    known = evidence(1)
    [part] = known.parts
    one = np.ones((1, size))
    short = replace(part, time=TIME[:size], measured=0.0 * one, used=one > 0.0, weight=one)
    found = folds(Evidence((short,)))
    assert len(found) == blocks
    assert all(0 < mask.sum() < size for _, mask in found)
    assert not blocks or np.all(np.sum([mask for _, mask in found], axis=0) == 1)
