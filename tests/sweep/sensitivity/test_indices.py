"""Indices of functions whose sensitivity is known in closed form."""

import itertools
import sys

import numpy as np
import pytest
from SALib.analyze import morris as peer
from stated_interval import half_widths

from calib.errors import CalibError
from calib.sweep.sensitivity import MORRIS, SOBOL, SensitivityDesign
from calib.sweep.sensitivity.analyse import sensitivity
from calib.sweep.sensitivity.document import FEATURE, GIVEN_DATA, KIND, SALTELLI, STATUS
from calib.sweep.sensitivity.morris import MIN_EFFECTS
from calib.sweep.sensitivity.outputs import Output
from calib.sweep.sensitivity.variance import MIN_OTHER_SAMPLES, easi

NAMES = ("x", "y", "z")
ISHIGAMI_FIRST = (0.3139, 0.4424, 0.0)  # with a = 7, b = 0.1 (Saltelli et al. 2008, Global Sensitivity Analysis)
ISHIGAMI_TOTAL = (0.5576, 0.4424, 0.2437)


def ishigami(u):
    x = np.pi * (2.0 * u - 1.0)
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def linear(u):
    return 2.0 * u[:, 0] - u[:, 1]


def found(design, values, of=FEATURE):
    return sensitivity(design, NAMES, Output("f", of, values))


def test_a_linear_function_has_its_coefficients_as_elementary_effects():
    design = SensitivityDesign(MORRIS, 3, 8, seed=1)
    x, y, z = found(design, 1e-3 * linear(design.points)).influences
    for influence, coefficient in ((x, 2e-3), (y, -1e-3), (z, 0.0)):
        assert influence.mu.value == pytest.approx(coefficient, abs=1e-15)
        assert influence.mu_star.value == pytest.approx(abs(coefficient), abs=1e-15)
        assert influence.sigma.value == pytest.approx(0.0, abs=1e-15)
        assert influence.mu_star.high == pytest.approx(influence.mu_star.low, abs=1e-15)
        assert influence.count == 8


def test_elementary_effects_are_those_of_the_peer():
    design = SensitivityDesign(MORRIS, 3, 30, seed=2)
    values = ishigami(design.points)
    problem = {"num_vars": 3, "names": list(NAMES), "bounds": [[0.0, 1.0]] * 3}
    said = peer.analyze(problem, design.points, values, num_levels=4, seed=1)
    for axis, one in enumerate(found(design, values).influences):
        assert one.mu_star.value == pytest.approx(said["mu_star"][axis])
        assert one.mu.value == pytest.approx(said["mu"][axis])
        assert one.sigma.value == pytest.approx(said["sigma"][axis])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_intervals_of_mu_star_hold_the_mean_over_the_whole_grid(seed):
    levels = np.array(list(itertools.product(np.linspace(0.0, 1.0, 4), repeat=3)))
    truth = []
    for axis in range(3):
        low = levels[levels[:, axis] < 0.5]
        high = low + 2.0 / 3.0 * np.eye(3)[axis]
        truth.append(np.abs(ishigami(high) - ishigami(low)).mean() / (2.0 / 3.0))
    design = SensitivityDesign(MORRIS, 3, 60, seed)
    for one, expected in zip(found(design, ishigami(design.points)).influences, truth, strict=True):
        assert one.mu_star.low - 1e-9 <= expected <= one.mu_star.high + 1e-9


def test_intervals_of_sobol_indices_hold_those_of_ishigamis_function():
    design = SensitivityDesign(SOBOL, 3, 1024, seed=1)
    result = found(design, ishigami(design.points))
    assert result.estimator == SALTELLI
    for one, first, total in zip(result.influences, ISHIGAMI_FIRST, ISHIGAMI_TOTAL, strict=True):
        assert half_widths(one.first, first) <= 1.0
        assert half_widths(one.total, total) <= 1.0
        assert one.total.high - one.total.low < 0.2
    assert [one.parameter for one in result.ranked()] == ["x", "y", "z"]


def test_indices_do_not_depend_on_the_unit():
    design = SensitivityDesign(SOBOL, 3, 64, seed=1)
    one, other = (found(design, scale * linear(design.points) + 5.0 * scale).influences for scale in (1.0, 1e-9))
    for mine, its in zip(one, other, strict=True):
        assert its.total.value == pytest.approx(mine.total.value, abs=1e-6)


@pytest.mark.parametrize("failed", [[0], [1], [0, 5, 10, 50], list(range(1, 5 * (MIN_OTHER_SAMPLES - 1), 5))])
def test_no_index_is_said_of_what_happens_in_few_base_samples(failed):
    """The first point of each five is A, the second differs from it in the first parameter alone."""
    design = SensitivityDesign(SOBOL, 3, 128, seed=1)
    values = np.ones(design.size)
    values[failed] = 0.0
    result = found(design, values, STATUS)
    assert not result.influences
    assert result.reason == (
        f"not available: {len(failed)} of 128 base samples show another value than the most frequent one, 25 are needed"
    )


def test_intervals_of_a_rare_kind_hold_the_indices():
    """It is where x and y are below q, at a share q^2 = 8 % of the points: S = q / (1 + q), T = 1 / (1 + q)."""
    q, held, designs = np.sqrt(0.08), np.zeros((2, 3)), 40
    first, total = np.array([q, q, 0.0]) / (1.0 + q), np.array([1.0, 1.0, 0.0]) / (1.0 + q)
    for seed in range(designs):
        design = SensitivityDesign(SOBOL, 3, 256, seed)
        influences = found(design, np.all(design.points[:, :2] < q, axis=1).astype(float), KIND).influences
        for axis, one in enumerate(influences):
            held[:, axis] += half_widths(one.first, first[axis]) <= 1.0, half_widths(one.total, total[axis]) <= 1.0
    assert (held >= 0.85 * designs).all()


def test_indices_are_of_the_variance_of_all_points():
    """A and B alone may happen to vary less: here they do not vary at all, while a tenth of all points is different."""
    design = SensitivityDesign(SOBOL, 3, 64, seed=1)
    grouped = np.zeros((64, 5))
    grouped[::2, 1] = 1.0
    x, y, z = found(design, grouped.ravel(), KIND).influences
    assert x.total.value == pytest.approx(0.25 / (0.1 * 0.9))
    assert x.total.low < x.total.value < x.total.high
    assert y.total.value == z.total.value == 0.0


def test_a_resample_of_equal_values_has_no_first_order_index():
    assert np.isnan(easi(np.linspace(0.0, 1.0, 40), np.ones(40)))


def test_where_the_kind_jumps_indices_are_of_one_kind_alone():
    """The third parameter decides the kind; within the measured one, x and y have 4/5 and 1/5 of the variance."""
    design = SensitivityDesign(SOBOL, 3, 256, seed=3)
    measured = design.points[:, 2] < 0.5
    kind = found(design, measured.astype(float), KIND)
    assert kind.ranked()[0].parameter == "z"
    for one, truth in zip(kind.influences, (0.0, 0.0, 1.0), strict=True):
        assert half_widths(one.first, truth) <= 1.0
        assert half_widths(one.total, truth) <= 1.0
    result = found(design, np.where(measured, linear(design.points), np.nan))
    assert result.estimator == GIVEN_DATA
    assert result.points == measured.sum()
    for one, truth in zip(result.influences, (0.8, 0.2, 0.0), strict=True):
        assert half_widths(one.first, truth) < 2.0
        assert half_widths(one.total, truth) < 2.0
        assert one.total.high - one.total.low < 0.3


def test_a_parameter_that_decides_the_kind_keeps_its_influence_within_it():
    """Where x < 1/2 the variances of 2 x and y are equal."""
    design = SensitivityDesign(SOBOL, 3, 256, seed=4)
    result = found(design, np.where(design.points[:, 0] < 0.5, linear(design.points), np.nan))
    for one, truth in zip(result.influences, (0.5, 0.5, 0.0), strict=True):
        assert half_widths(one.first, truth) < 2.0


def test_a_first_order_index_within_a_kind_follows_what_is_nonlinear():
    """The variance of the mean of sin(2 pi x) (1 + y) over y is 27/28 of its own; that over x is none."""
    design = SensitivityDesign(SOBOL, 3, 256, seed=2)
    u = design.points
    result = found(design, np.where(u[:, 2] < 0.5, np.sin(2.0 * np.pi * u[:, 0]) * (1.0 + u[:, 1]), np.nan))
    for one, truth in zip(result.influences, (27.0 / 28.0, 0.0, 0.0), strict=True):
        assert half_widths(one.first, truth) < 2.0


@pytest.mark.slow
def test_intervals_within_a_kind_hold_the_truth_in_most_designs():
    held, designs = np.zeros((2, 3)), 40
    for seed in range(designs):
        design = SensitivityDesign(SOBOL, 3, 128, seed)
        result = found(design, np.where(design.points[:, 2] < 0.5, linear(design.points), np.nan))
        for axis, (one, truth) in enumerate(zip(result.influences, (0.8, 0.2, 0.0), strict=True)):
            held[:, axis] += half_widths(one.first, truth) <= 1.0, half_widths(one.total, truth) <= 1.0
    assert (held >= 0.85 * designs).all()


def test_elementary_effects_across_a_jump_of_kind_are_left_out_and_counted():
    design = SensitivityDesign(MORRIS, 3, 20, seed=3)
    values = np.where(design.points[:, 2] < 0.5, linear(design.points), np.nan)
    x, y, z = found(design, values).influences
    assert x.mu.value == pytest.approx(2.0)
    assert y.mu.value == pytest.approx(-1.0)
    assert MIN_EFFECTS <= x.count < 20
    assert z.mu_star is None  # each of its steps leaves the kind
    assert z.count == 0
    assert "0 of its steps" in z.reason


def test_what_too_few_points_show_is_not_available():
    morris, sobol = SensitivityDesign(MORRIS, 3, 10, seed=1), SensitivityDesign(SOBOL, 3, 64, seed=1)
    few = np.full(morris.size, np.nan)
    few[:2] = 1.0, 2.0
    assert all(one.mu_star is None and one.reason for one in found(morris, few).influences)
    some = np.full(sobol.size, np.nan)
    some[:30] = np.arange(30.0)
    assert found(sobol, some).reason == "not available: 30 points show it, 40 are needed"
    assert found(sobol, np.full(sobol.size, np.nan)).reason == "not available: no point shows it"


@pytest.mark.parametrize("method", [MORRIS, SOBOL])
def test_what_is_the_same_everywhere_has_no_indices(method):
    design = SensitivityDesign(method, 3, 64, seed=1)
    assert found(design, np.full(design.size, 0.3)).reason == "no parameter moves it: it is 0.3 at all points"
    assert "measured kind at all points" in found(design, np.ones(design.size), KIND).reason
    assert "at no point" in found(design, np.zeros(design.size), KIND).reason


@pytest.mark.parametrize("method", [MORRIS, SOBOL])
def test_a_larger_design_begins_with_the_smaller_one(method):
    small, large = SensitivityDesign(method, 3, 64, seed=5), SensitivityDesign(method, 3, 128, seed=5)
    np.testing.assert_array_equal(large.points[: small.size], small.points)
    assert small.points.shape == (small.size, 3)


@pytest.mark.parametrize(
    ("method", "groups", "said"),
    [
        ("moris", 20, "did you mean 'morris'"),
        (MORRIS, 3, "at least 4 trajectories, got 3"),
        (SOBOL, 32, "at least 64 samples, got 32"),
        (SOBOL, 100, "the nearest are 64 and 128"),
    ],
)
def test_an_impossible_design_is_refused(method, groups, said):
    with pytest.raises(CalibError, match=said):
        SensitivityDesign(method, 3, groups, seed=0)


def test_without_its_package_the_command_that_installs_it_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "SALib.sample.morris", None)
    with pytest.raises(CalibError, match=r'pip install "calib\[sensitivity\]"'):
        _ = SensitivityDesign(MORRIS, 2, 4, seed=0).points
