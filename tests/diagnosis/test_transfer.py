"""Sizes that each record has alone, and whether they agree."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.fit import Fit
from calib.diagnosis.signature import Point
from calib.diagnosis.transfer import Transfer, _fixed_alone, _refitted, acting_causes, agreements
from calib.modelling.parameter import Parameter, Space, Window

N = 400
ROW = np.zeros(N, dtype=int)


def columns(seed=0):
    """A column of the size, and one of a calibrated parameter that it is nearly like."""
    rng = np.random.default_rng(seed)
    calibrated = rng.standard_normal(N)
    return 0.995 * calibrated + 0.1 * rng.standard_normal(N), calibrated[:, None]


def test_the_error_of_a_record_alone_covers_what_calibrated_parameters_take():
    column, others = columns()
    rng = np.random.default_rng(1)
    deviates, raw, biased = [], [], 0
    for _ in range(300):
        noise = rng.standard_normal(N)
        residual = 0.7 * column - 2.0 * others[:, 0] + noise  # the calibrated value is off, too
        size, error, _, bias = _refitted(
            residual, column, others, ROW, gross=np.zeros_like, is_remainder_significant=False
        )
        biased += bias > 0.0
        deviates.append((size - 0.7) / error)
        raw.append(error * np.linalg.norm(column))
    assert np.std(deviates) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(deviates)) < 0.2
    assert biased < 6  # noise alone is 3 standard deviations off in so few cases
    assert min(raw) > 5.0  # several times what it would be with the calibrated parameter held


def test_gross_errors_that_the_refit_leaves_are_no_bias_of_a_size():
    column, others = columns()
    residual = np.random.default_rng(4).standard_normal(N)
    residual[7] += 20.0

    def of_gross_errors(left):
        return np.array([left[7] ** 2 - 1.0])

    biases = [_refitted(residual, column, others, ROW, of, is_remainder_significant=False)[3]
              for of in (of_gross_errors, np.zeros_like)]  # fmt: skip
    assert biases[0] == 0.0 < biases[1]


@pytest.mark.parametrize("left", [0.0, 1e-3])
def test_a_record_that_does_not_tell_the_size_from_calibrated_values_has_none(left):
    column, others = columns()
    copy = others[:, 0] + left * column
    assert _refitted(column, copy, others, ROW, gross=np.zeros_like, is_remainder_significant=False) is None


@pytest.mark.slow
def test_what_remains_may_bias_a_record_whose_own_sum_of_squares_shows_nothing():
    """What is left in each record is a standard deviation of that sum, a twelfth of it along the effect."""
    size = 40_000
    rng, column, rows = np.random.default_rng(2), 0.5 * np.sin(np.arange(size)), np.zeros(size, dtype=int)
    along = column / np.linalg.norm(column)
    agree = {True: 0, False: 0}
    for _ in range(40):
        known = []
        for _ in range(3):
            left = rng.standard_normal(size)
            left -= along * (left @ along)
            left *= np.sqrt(11.0 / 12.0) / np.linalg.norm(left)
            left += rng.choice([-1.0, 1.0]) * along / np.sqrt(12.0)
            known.append(column + rng.standard_normal(size) + np.sqrt(np.sqrt(2.0 * size)) * left)
        for remains in agree:
            found = [
                _refitted(residual, column, np.zeros((size, 0)), rows, np.zeros_like, remains) for residual in known
            ]
            transfers = [Transfer(str(k), "k", *one[:2], False, size, one[3]) for k, one in enumerate(found)]
            agree[remains] += agreements(transfers, 3.4)[0].agree
    assert agree[False] < 25
    assert agree[True] == 40


def test_records_agree_by_the_threshold_of_the_diagnosis():
    near = [Transfer("a", "k", 1.0, 0.1, False), Transfer("b", "k", 1.2, 0.1, True)]
    [found] = agreements([*near, Transfer("a", "c", 1.0, 0.1, False)], 3.0)  # of c there is but one
    assert (found.parameter, found.degrees, found.agree) == ("k", 1, True)
    assert found.chi2 == pytest.approx(2.0)
    assert found.z == pytest.approx(np.sqrt(2.0))
    vague = [Transfer("a", "k", 1.0, 0.1, False, 1.5), Transfer("b", "k", 2.0, 0.1, True, 1.5)]
    assert vague[0].half_width > 3.0 * near[0].half_width
    assert agreements(vague, 3.0)[0].agree  # errors of so few degrees of freedom tell little
    [found] = agreements([near[0], Transfer("b", "k", 2.0, 0.1, True)], 3.0)
    assert not found.agree
    assert found.variation == pytest.approx(np.sqrt(0.5 - 0.1**2) / 1.5)  # sample variance, less that of their errors
    sure = Transfer("b", "k", 2.0, 0.01, True)
    [found] = agreements([near[0], sure], 3.0)  # the weighted mean is the sure one's, the variation is not
    assert found.variation == pytest.approx(np.sqrt(0.5) / 2.0, rel=0.02)


def test_what_is_fixed_for_a_record_and_searched_for_others_is_free_in_its_refit():
    space = Space({"x": Window(0.0, 4.0)}, {"x@b": 1.5, "mass@b": 2.0, "x@c": 3.0})
    model = SimpleNamespace(parameters={"x": Parameter("x", "m", 0.0, "start", low=-9.0)})
    final = SimpleNamespace(names=("x",), point=SimpleNamespace(values={"x": 1.0, **space.fixed}))
    fitter = SimpleNamespace(space=space, model=model)
    [own] = _fixed_alone(fitter, final, "b")
    assert (own.name, own.at, own.scale, own.low) == ("x@b", 1.5, 4.0, -9.0)
    assert _fixed_alone(fitter, final, "a") == []


def test_a_cause_acts_in_a_record_where_its_size_changes_it():
    def cause(name, null, *free):
        return SimpleNamespace(name=name, free=free, null=np.array(null))

    values = {"stiffness": 4.0, "k3": 2.0, "cos": 1.0, "sin": 3.0, "limit": 0.5}
    cubic, harmonic = cause("cubic", [0.0], "k3"), cause("harmonic", [1.0, 0.0], "cos", "sin")
    causes = (cubic, harmonic, cause("clip", [np.inf], "limit"))
    none = np.zeros((0, 0))
    final = Fit(Point(values, (), {}), causes, none, none, tuple(values), (), none, none)
    columns = np.zeros((4, 5))
    assert acting_causes(final, columns) == ()
    columns[:, 4] = 1.1  # of what is absent at infinity: by as much as its own size
    assert acting_causes(final, columns) == ("clip",)
    columns[:, 2] = 9.0  # by what is at its null
    columns[:, 1] = 0.2
    assert acting_causes(final, columns) == ("clip",)
    columns[:, 1] = 0.3
    columns[0, 3] = 1.0
    assert acting_causes(final, columns) == ("cubic", "harmonic", "clip")
