"""The prediction of records that are left out, against densities written down."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib.diagnosis.discovery.free_force import DISPLACEMENT, free_force
from calib.diagnosis.discovery.left_out import LeftOutMisfit, left_out_misfit
from calib.diagnosis.discovery.penalised import FreeModel, PenalisedFit, States, linearised
from calib.diagnosis.fit import Fit
from calib.diagnosis.signature import Point

SIZES = 30, 40, 35  # samples of three records


class Records:
    """Records one after the other."""

    names = ("a", "b", "c")
    parts = names

    def of(self, name):
        number = self.names.index(name)
        return slice(sum(SIZES[:number]), sum(SIZES[: number + 1]))

    def segments(self):
        return np.repeat(np.arange(3), SIZES)


def linear_fit(columns, data):
    """Least-squares fit of columns (N, k) to data (N,)."""
    size = np.linalg.lstsq(columns, data, rcond=None)[0]
    names = tuple(f"p{k}" for k in range(columns.shape[1]))
    point = Point(dict(zip(names, size, strict=True)), (), {})
    none = np.zeros((len(data), 0))
    return Fit(point, (), data - columns @ size, columns, names, (), none, np.zeros(len(data), dtype=int))


def drawn(number, seed=0):
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((sum(SIZES), number))
    return columns, columns @ np.ones(number) + rng.standard_normal(sum(SIZES))


def test_the_deviance_is_that_of_the_predictive_density():
    columns, data = drawn(3)
    misfit = left_out_misfit(Records(), linear_fit(columns, data))
    expected = 0.0
    for name in Records.names:
        out = np.zeros(len(data), dtype=bool)
        out[Records().of(name)] = True
        inverse = np.linalg.inv(columns[~out].T @ columns[~out])
        mean = columns[out] @ inverse @ columns[~out].T @ data[~out]
        spread = np.eye(out.sum()) + columns[out] @ inverse @ columns[out].T
        expected -= 2.0 * multivariate_normal(mean, spread).logpdf(data[out]) + out.sum() * np.log(2.0 * np.pi)
    assert misfit.names == Records.names
    assert (misfit.deviances.size, misfit.count) == (3, sum(SIZES))
    assert misfit.deviance == pytest.approx(expected)


def test_a_superfluous_parameter_predicts_worse_and_a_missing_one_much_worse():
    differences = []
    for seed in range(30):
        columns, data = drawn(2, seed)
        enough, more, fewer = (
            left_out_misfit(Records(), linear_fit(c, data))
            for c in (columns, np.column_stack([columns, drawn(1, 100 + seed)[0]]), columns[:, :1])
        )
        differences.append((more.deviance - enough.deviance, fewer.deviance - enough.deviance))
        assert enough.is_better(fewer)
        assert not more.is_better(enough)
    more, fewer = np.mean(differences, axis=0)
    assert 0.0 < more < 10.0
    assert fewer > 50.0


def test_a_direction_that_the_others_do_not_determine_is_uncertain_not_wrong():
    columns, data = drawn(2)
    alone = np.zeros((len(data), 1))
    alone[Records().of("c")] = 1.0
    data = data + 50.0 * alone[:, 0]
    whole = np.column_stack([columns, alone + 1e-3 * drawn(1, 7)[0]])
    misfit = left_out_misfit(Records(), linear_fit(whole, data))
    certain = left_out_misfit(Records(), linear_fit(columns, data))
    assert misfit.deviance < 0.01 * certain.deviance


def test_a_record_has_no_say_in_the_smoothness_by_which_it_is_predicted():
    """Its deviance is a quadratic function of the size of its data, once the others have told the weights."""
    force, x = free_force("mass", [DISPLACEMENT], {DISPLACEMENT: (-1.0, 1.0)}), np.sin(np.arange(sum(SIZES)))
    model = FreeModel((force,), (SimpleNamespace(scale={"size": 10.0}),), States(x, x))
    columns = force.matrix(x, x)
    deviances, weights = [], []
    for size in range(4):
        data = np.random.default_rng(0).standard_normal(x.size) + 5.0 * x
        data[Records().of("c")] = 20.0 * size * np.sin(9.0 * x[Records().of("c")])
        plain = linear_fit(columns, data)
        values = dict(zip(force.coefficients, plain.point.values.values(), strict=True))
        fit = replace(plain, point=Point(values, (), {}), names=force.coefficients)
        smoothing = linearised(fit, model)
        weights.append(smoothing.weight)
        misfit = left_out_misfit(Records(), fit, PenalisedFit(fit, model, smoothing, smoothing.weight))
        deviances.append(misfit.deviances[Records.names.index("c")])
    assert weights[0] > 10.0 * weights[-1]  # all records together want another smoothness
    assert np.diff(deviances, 3) == pytest.approx(0.0, abs=1e-6 * deviances[-1])
    assert np.diff(deviances, 2)[0] > 0.1 * deviances[-1]


def test_one_steady_tone_leaves_nothing_to_predict():
    tone = SimpleNamespace(
        parts=[SimpleNamespace(period=0.1, name="a", level=None)], names=["a"], segments=Records().segments
    )
    assert left_out_misfit(tone, linear_fit(*drawn(1))) is None


def test_levels_of_a_response_are_left_out_with_their_repeated_sweeps():
    sweep, level = np.repeat([3.0, 4.0, 5.0], SIZES), np.repeat([0, 1, 0], SIZES)
    part = SimpleNamespace(name="a", rows=(("mass", "in_phase"),), sweep=sweep, level=level, period=None)
    response = SimpleNamespace(parts=[part], names=["a"], segments=Records().segments)
    fit = linear_fit(*drawn(2))
    misfit = left_out_misfit(response, fit)
    assert misfit.names == ("sweeps 3, 5 of a", "sweep 4 of a")
    apart = left_out_misfit(Records(), fit)
    assert misfit.deviances[1] == pytest.approx(apart.deviances[1])
    one = SimpleNamespace(parts=[SimpleNamespace(**{**vars(part), "level": 0 * level})], names=["a"],
                          segments=Records().segments)  # fmt: skip
    assert left_out_misfit(one, fit).names == tuple(f"block {k} of 3 of a" for k in (1, 2, 3))


def test_a_tie_is_a_difference_of_noise():
    one, tie, other, wrong = (LeftOutMisfit(("a",), np.array([d]), 100) for d in (100.0, 105.0, 107.0, 400.0))
    assert one.is_better(other)
    assert not one.is_better(tie)
    assert not LeftOutMisfit(("a",), np.array([390.0]), 100).is_better(wrong)
