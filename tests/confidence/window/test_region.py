"""Windows of known shape: share, boundary, what bounds them, box and ellipsoid inside."""

from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.bench_window import boosted_trees, emulated_margins
from benchmarks.window_cases import CASES, RIDGE
from scipy.stats import qmc
from stated_interval import half_widths

from calib.confidence.window.design import WindowDesign, estimated_at, space_filling, start_points
from calib.confidence.window.document import WINDOW_END
from calib.confidence.window.emulated_margin import signed_distances
from calib.confidence.window.faces import faces
from calib.confidence.window.observed import KIND_MARGIN, Observed, graded
from calib.confidence.window.region import emulated
from calib.confidence.window.sampling import fine_sample, region_sample
from calib.confidence.window.shape import extent_along_axes, inscribed_ellipsoid, largest_box
from calib.confidence.window.share import undiscovered_share, volume_share

CENTRE, RADIUS, WALL = np.array([0.4, 0.5]), 0.25, 0.55


def disc(points):
    """A disc of misfit, cut by a wall beyond which the motion is of another kind; the clearance is seen inside."""
    clearance = WALL - points[:, 0]
    right = clearance > 0
    misfit = graded(np.linalg.norm(points - CENTRE, axis=1), RADIUS)
    margins = np.where(right[:, None], np.column_stack([misfit, clearance]), np.nan)
    return Observed(points, right, margins, ("misfit", "grazing"), (False, True))


def area():
    """Area of the disc left of the wall."""
    angle = np.arccos((WALL - CENTRE[0]) / RADIUS)
    return RADIUS**2 * (np.pi - angle + 0.5 * np.sin(2.0 * angle))


def explored(observe, dim, number, batch=8, seed=1):
    design = WindowDesign(dim, seed)
    observed = observe(space_filling(dim, start_points(dim), seed))
    while len(observed.points) < number:
        more = design.next_points(observed, min(batch, number - len(observed.points)))
        observed = observe(np.vstack([observed.points, more]))
    return design.region(observed), observed


@pytest.fixture(scope="module")
def drawn():
    region, observed = explored(disc, 2, 48)
    return region, observed, region_sample(region, observed.points[observed.admissible], 1)


def test_a_margin_is_zero_at_its_tolerance_and_falls_with_the_size():
    sizes = np.linspace(0.0, 10.0, 101)
    margins = graded(sizes, 2.0)
    assert graded(2.0, 2.0) == pytest.approx(0.0, abs=1e-15)
    assert (np.diff(margins) < 0).all()
    assert np.isfinite(margins).all()


def test_the_share_of_the_box_is_that_of_the_window(drawn):
    region, observed, sample = drawn
    share = volume_share(region, sample, observed, 1)
    assert half_widths(share, area()) < 2.0
    assert share.value == pytest.approx(area(), rel=0.03)
    assert share.high - share.low < 0.1 * area()


def test_stated_misclassification_is_as_large_as_it_is(drawn):
    region, observed, sample = drawn
    points = qmc.Sobol(2, seed=9).random(1 << 12)
    wrong = ((region.probability(points) > 0.5) != disc(points).admissible).mean()
    stated = volume_share(region, sample, observed, 1).misclassified
    assert wrong < 0.03 * area()
    assert stated < 0.05 * area()


def test_points_are_chosen_near_the_boundary(drawn):
    """In the first batch: after it this boundary is known to a thousandth."""
    _, observed, _ = drawn
    chosen = observed.points[start_points(2) :][:8]
    near = np.abs(np.linalg.norm(chosen - CENTRE, axis=1) - RADIUS) < 0.12
    assert near.mean() > 0.6


def test_what_bounds_the_window_is_named_on_each_side(drawn):
    region, _, sample = drawn
    found = {(face.parameter, face.side): face.mechanisms for face in faces(region, sample, 1)}
    assert max(found[0, "high"], key=found[0, "high"].get) == "grazing"
    assert set(found[0, "low"]) == set(found[1, "low"]) == {"misfit"}
    assert sum(found[-1, ""].values()) == pytest.approx(1.0)


def test_a_parameter_that_matters_for_nothing_is_bounded_by_the_end_of_its_window():
    def cylinder(points):
        misfit = graded(np.abs(points[:, 0] - 0.5), 0.2)
        return Observed(points, np.ones(len(points), dtype=bool), misfit[:, None], ("misfit",), (False,))

    region, observed = explored(cylinder, 2, 32)
    sample = region_sample(region, observed.points[observed.admissible], 1)
    found = {(face.parameter, face.side): face.mechanisms for face in faces(region, sample, 1)}
    assert found[1, "low"] == found[1, "high"] == {WINDOW_END: 1.0}
    low, high = extent_along_axes(region, np.array([0.5, 0.5]))
    np.testing.assert_allclose([low[0], high[0]], [0.3, 0.7], atol=0.01)
    np.testing.assert_allclose([low[1], high[1]], [0.0, 1.0])


def test_box_and_ellipsoid_are_inside_and_large(drawn):
    region, _, sample = drawn
    low, high = largest_box(region, CENTRE)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    assert disc(corners).admissible.all()
    assert np.prod(high - low) > 0.85 * 0.11  # the largest box of the cut disc has 0.11
    ellipsoid = inscribed_ellipsoid(region, sample.points[sample.probability > 0.5])
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    ring = ellipsoid.centre + ellipsoid.radius * np.column_stack([np.cos(angle), np.sin(angle)]) @ ellipsoid.root.T
    assert disc(ring).admissible.all()
    assert np.pi * ellipsoid.radius**2 * np.linalg.det(ellipsoid.root) > 0.6 * area()


def test_an_ellipsoid_is_not_larger_than_the_box_that_is_searched():
    everywhere = SimpleNamespace(probability=lambda points: np.ones(len(points)))
    ellipsoid = inscribed_ellipsoid(everywhere, space_filling(2, 1024, 1))
    reach = ellipsoid.radius * np.linalg.norm(ellipsoid.root, axis=1)
    assert reach == pytest.approx([0.5, 0.5], abs=0.01)
    assert (ellipsoid.centre - reach > -1e-6).all()


def test_a_kind_of_which_only_the_label_is_known_has_its_boundary_midway():
    points = space_filling(2, 64, 3)
    right = points[:, 0] < 0.5
    signed = signed_distances(points, right)
    assert (signed[right] > 0).all()
    assert (signed[~right] < 0).all()

    def unannounced(x):
        observed = disc(x)
        return Observed(x, observed.right, observed.margins[:, :1], ("misfit",), (False,))

    region, observed = explored(unannounced, 2, 64)
    assert KIND_MARGIN in region.labels
    test = qmc.Sobol(2, seed=9).random(1 << 12)
    assert ((region.probability(test) > 0.5) != disc(test).admissible).mean() < 0.08 * area()


@pytest.mark.slow
def test_the_next_batch_depends_on_the_points_alone():
    """A design that saw every batch, and one that is shown all points at once, ask for the same."""
    _, observed = explored(disc, 2, 40)
    design = WindowDesign(2, 1)
    for number in (16, 24, 32, 40):
        asked = design.next_points(observed.first(number), 8)
    np.testing.assert_array_equal(asked, WindowDesign(2, 1).next_points(observed, 8))


def test_hyperparameters_are_estimated_at_numbers_that_grow_by_a_third():
    numbers = sorted({estimated_at(number, 48) for number in range(48, 1000)})
    assert numbers[:4] == [48, 64, 85, 113]
    assert all(1.3 < later / former < 1.35 for former, later in zip(numbers, numbers[1:], strict=False))


def oblique(points):
    """A misfit that is narrow across the direction (1, 1, 0, 0), ten times wider along (1, -1, 0, 0), and open else."""
    across, along = points[:, 0] + points[:, 1] - 1.0, points[:, 0] - points[:, 1]
    misfit = graded(np.hypot(across / 0.06, np.tanh(along) / 0.6), 1.0)
    return Observed(points, np.ones(len(points), dtype=bool), misfit[:, None], ("misfit",), (False,))


def test_an_oblique_window_is_emulated_along_its_own_axes():
    points = space_filling(4, 64, 1)
    [margin] = emulated(oblique(points)).margins
    assert np.abs(margin.axes[:, 0] @ [1.0, 1.0, 0.0, 0.0]) / np.sqrt(2.0) > 0.99
    np.testing.assert_allclose(margin.axes.T @ margin.axes, np.eye(4), atol=1e-12)
    assert margin.process.lengths[0, 1] > 2.0 * margin.process.lengths[0, 0]
    truth = oblique(qmc.Sobol(4, seed=9).random(1 << 10)).admissible
    said = emulated(oblique(points)).probability(qmc.Sobol(4, seed=9).random(1 << 10)) > 0.5
    assert (said != truth).sum() < 0.1 * truth.sum()


def test_the_share_is_bounded_by_the_design_as_long_as_no_admissible_point_is_known():
    """The emulator of a misfit that is far off everywhere is certain that there is no window; it only extrapolates."""
    points = space_filling(2, 24, 1)
    far = graded(10.0 + points[:, 0], 1.0)
    observed = Observed(points, np.ones(len(points), dtype=bool), far[:, None], ("misfit",), (False,))
    region = emulated(observed)
    share = volume_share(region, region_sample(region, np.zeros((0, 2)), 1), observed, 1)
    assert share.low == 0.0
    assert (1.0 - share.high) ** start_points(2) == pytest.approx(0.025)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_part_of_the_window_that_no_point_has_met_is_within_the_bound_of_undiscovered_ones(seed):
    """Two discs of known kind and no margin, the second a sixth as large as the first and far from it."""

    def discs(points):
        large = np.linalg.norm(points - [0.35, 0.4], axis=1) < 0.2
        small = np.linalg.norm(points - [0.85, 0.85], axis=1) < 0.08
        return Observed(points, large | small, np.zeros((len(points), 0)), (), ())

    truth = np.pi * (0.2**2 + 0.08**2)
    bounds = []
    for number in (32, 128):
        region, observed = explored(discs, 2, number, seed=seed)
        sample = fine_sample(region, observed.points[observed.admissible], seed)
        share, undiscovered = (f(region, sample, observed, seed) for f in (volume_share, undiscovered_share))
        assert share.high + undiscovered.high > truth
        bounds.append(undiscovered)
    assert bounds[1].high < 0.8 * bounds[0].high
    assert bounds[0].points < bounds[1].points


def test_no_part_is_undiscovered_outside_a_window_that_is_the_whole_box():
    points = space_filling(2, 32, 1)
    near = graded(0.1 + 0.1 * points[:, 0], 1.0)
    observed = Observed(points, np.ones(len(points), dtype=bool), near[:, None], ("misfit",), (False,))
    region = emulated(observed)
    assert undiscovered_share(region, region_sample(region, points, 1), observed, 1).high == 0.0


@pytest.mark.slow
def test_the_share_of_a_window_of_a_25000th_of_the_box_errs_as_its_interval_says():
    found = emulated_margins(RIDGE._replace(test_points=1 << 16), 1, [200])[200]
    assert found.error < 2.0
    assert found.misclassified < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in CASES if case is not RIDGE], ids=lambda case: case.name)
def test_six_parameters_take_fewer_points_than_labels_would(case):
    emulated, labelled = emulated_margins(case, 0, [150])[150], boosted_trees(case, 0, [150])[150]
    assert emulated.misclassified < 0.15
    assert emulated.misclassified < 0.3 * labelled.misclassified
    assert emulated.error < 2.0
