"""Curves of folds, flips and grazings over two parameters, on maps in closed form."""

import numpy as np
import pytest
from dynamics.plain_maps import GrazingMap, PlainMap, henon

from calib.dynamics.branch import follow
from calib.dynamics.codimension import in_words
from calib.dynamics.curves import follow_curves
from calib.dynamics.defining import ParameterPlane
from calib.errors import CalibError

HENON = ParameterPlane(henon, (-0.9, 3.3), (-1.05, 0.4))


def henon_branch():
    return follow(henon, [0.7, 0.2], 0.2, (-0.3, 0.6))


@pytest.fixture(scope="module")
def henon_curves():
    return follow_curves(henon_branch(), HENON, 0.3)


def of_kind(curves, kind):
    [curve] = [curve for curve in curves if curve.kind == kind]
    return curve


# --- fold and flip


def test_fold_and_flip_of_henon_are_the_curves_of_the_closed_form(henon_curves):
    for kind, share in (("fold", -0.25), ("flip", 0.75)):
        curve = of_kind(henon_curves, kind)
        assert curve.a.size > 10
        assert np.abs(curve.a - share * (1.0 - curve.b) ** 2).max() < 1e-9
        assert curve.errors.max() < 1e-9
        critical = np.abs(curve.multipliers - np.sign(share) * -1.0).min(axis=1)
        assert critical.max() < 1e-6


def test_a_map_that_does_not_know_its_derivative_has_the_same_curves():
    def by_differences(a, b):
        map = henon(a, b)
        map.derivative = None
        return map

    branch = follow(lambda a: by_differences(a, 0.3), [0.7, 0.2], 0.2, (-0.1, 0.6))
    [flip] = follow_curves(branch, ParameterPlane(by_differences, (-0.1, 1.0), (0.0, 0.5)), 0.3)
    assert np.abs(flip.a - 0.75 * (1.0 - flip.b) ** 2).max() < 1e-8


def test_the_flip_of_henon_has_its_second_multiplier_at_minus_one_where_b_is_minus_one(henon_curves):
    flip = of_kind(henon_curves, "flip")
    [point] = flip.points
    assert point.kind == "1:2 resonance"
    assert "eigenvectors" in point.test
    assert (point.a, point.b) == pytest.approx((3.0, -1.0), abs=1e-8)
    assert (flip.a[point.index], flip.b[point.index]) == (point.a, point.b)
    beside = np.arange(flip.a.size) != point.index
    assert (flip.bounding == (flip.b > -1.0))[beside].all()  # beyond it the other multiplier is outside
    test = flip.tests["1:2 resonance"]
    assert len(set(np.sign(test * (flip.b + 1.0))[beside])) == 1


def test_a_curve_ends_at_the_edges_of_the_plane_exactly():
    asked = []
    plane = ParameterPlane(lambda a, b: asked.append((a, b)) or henon(a, b), (-0.3, 1.0), (0.1, 0.5))
    flip = of_kind(follow_curves(henon_branch(), plane, 0.3), "flip")
    assert sorted(flip.b[[0, -1]]) == pytest.approx([0.1, 0.5], abs=1e-14)
    assert all(end.startswith("edge of the window") for end in flip.ends)
    assert (np.min(asked, axis=0) >= (-0.3, 0.1)).all()
    assert (np.max(asked, axis=0) <= (1.0, 0.5)).all()


def pitched(a, b):
    """Cubic map whose folds 27 a^2 = 4 b^3 meet in a cusp at (0, 0); the second multiplier is -1 where b = 0.6."""
    return PlainMap(
        lambda x: np.array([x[0] + 0.3 * (a + b * x[0] - x[0] ** 3), -(0.7 + 0.5 * b) * x[1]]),
        lambda x: np.diag([1.0 + 0.3 * (b - 3.0 * x[0] ** 2), -(0.7 + 0.5 * b)]),
        [0.0, 0.0],
    )


def test_both_folds_are_one_curve_through_their_cusp():
    branch = follow(lambda a: pitched(a, 0.5), [0.7, 0.0], 0.0, (-1.0, 1.0))
    assert [point.kind for point in branch.points] == ["fold", "fold"]
    [curve] = follow_curves(branch, ParameterPlane(pitched, (-1.0, 1.0), (-0.5, 0.8)), 0.5)
    assert np.abs(27.0 * curve.a**2 - 4.0 * curve.b**3).max() < 1e-9
    assert curve.b[[0, -1]] == pytest.approx([0.8, 0.8])
    assert [point.kind for point in curve.points] == ["fold-flip", "cusp", "fold-flip"]
    one, cusp, other = curve.points
    assert (cusp.a, cusp.b) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (one.b, other.b) == pytest.approx((0.6, 0.6), abs=1e-9)
    assert one.a == pytest.approx(-other.a, abs=1e-9)
    assert one.index < cusp.index < other.index


def test_the_birth_of_a_two_cycle_is_the_flip_of_the_cycle_that_it_comes_from():
    branch = follow(henon, henon(0.6).orbit(np.array([0.1, 0.1]), 401).states[-1], 0.6, (0.3, 0.7), periods=2)
    curve = of_kind(follow_curves(branch, ParameterPlane(henon, (0.1, 1.0), (0.1, 0.4)), 0.3), "flip")
    assert curve.periods == 1
    assert np.abs(curve.a - 0.75 * (1.0 - curve.b) ** 2).max() < 1e-9


# --- grazing


def grazing_map(gap, alpha):
    map = GrazingMap(gap, 0.1)
    map.alpha = alpha
    return map


GRAZING = ParameterPlane(grazing_map, (0.3, 2.0), (-1.5, 0.5))


@pytest.mark.parametrize(("guess", "gap"), [([1.0, -0.2], 1.5), ([0.85, -0.2], 0.7)], ids=["missing", "impacting"])
def test_the_grazing_is_the_curve_of_the_closed_form_from_either_side(guess, gap):
    branch = follow(lambda gap: grazing_map(gap, 0.3), guess, gap, (0.5, 2.0))
    curve = of_kind(follow_curves(branch, GRAZING, 0.3), "grazing")
    assert np.abs(curve.a - 0.9 / (1.2 - curve.b)).max() < 1e-9
    assert curve.errors.max() < 1e-9
    assert (curve.impacts == 0).all()
    known = [np.roots([1.0, -alpha, 0.2]) for alpha in curve.b]  # of the map without the impact
    assert np.abs(np.sort(np.abs(curve.multipliers)) - np.sort(np.abs(known))).max() < 1e-6


def test_where_the_missing_motion_flips_its_grazing_has_codimension_two():
    branch = follow(lambda gap: grazing_map(gap, 0.3), [1.0, -0.2], 1.5, (0.5, 2.0))
    [curve] = follow_curves(branch, GRAZING, 0.3)
    [point] = curve.points
    assert point.kind == "flip-grazing"
    assert point.test == "difference of a multiplier from -1"
    assert (point.a, point.b) == pytest.approx((0.9 / 2.4, -1.2), abs=1e-8)


def test_the_flip_beside_a_grazing_is_the_curve_of_the_closed_form():
    branch = follow(lambda gap: grazing_map(gap, 0.3), [0.85, -0.2], 0.7, (0.5, 2.0))
    curve = of_kind(follow_curves(branch, GRAZING, 0.3), "flip")
    speed = 0.1 / (2.0 * (1.2 + curve.b))  # where the trace of the derivative is -1 - 0.2
    assert np.abs(curve.a - (0.9 - 0.1 * speed) / (1.2 - curve.b) + speed**2).max() < 1e-9


# --- failures


def test_where_the_motion_fails_a_curve_is_lost_and_says_so():
    def maps(a, b):
        map = henon(a, b)
        map.limit = 1e3 if b > 0.2 else 0.0
        return map

    flip = of_kind(follow_curves(henon_branch(), ParameterPlane(maps, (-0.3, 1.0), (0.1, 0.5)), 0.3), "flip")
    assert any(end.startswith("lost at") and "fails" in end for end in flip.ends)
    assert flip.b.min() == pytest.approx(0.2, abs=1e-5)


def test_a_curve_whose_first_point_is_not_found_is_empty_and_says_why():
    plane = ParameterPlane(lambda a, b: henon(a + 0.2, b), (-0.3, 1.0), (0.1, 0.5))
    for curve in follow_curves(henon_branch(), plane, 0.3):
        assert curve.a.size == 0
        assert curve.states.shape == (0, 2)
        assert curve.ends[0].startswith("its first point is not found: ")


def test_each_special_point_is_told_of():
    told = []
    follow_curves(henon_branch(), HENON, 0.3, most=2, on_curve=lambda made, *count: told.append((len(made), *count)))
    assert told == [(1, 1, 2), (2, 2, 2)]


@pytest.mark.parametrize("plane", [((0.3, 0.6), (0.1, 0.5)), ((-0.3, 0.6), (0.4, 0.5)), ((-0.3, 0.6), (0.3, 0.3))])
def test_a_plane_without_the_branch_is_the_callers_mistake(plane):
    with pytest.raises(CalibError, match="window"):
        follow_curves(henon_branch(), ParameterPlane(henon, *plane), 0.3)


@pytest.mark.parametrize(
    ("multiplier", "said"),
    [
        (1.0 + 0.0j, "1.000000"),
        (-1.0 + 1e-9j, "-1.000000"),
        (0.3 - 0.4j, "0.300000 - 0.400000i"),
        (0.5j, "0.000000 + 0.500000i"),
    ],
)
def test_a_multiplier_is_said_as_a_real_number_or_with_its_imaginary_part(multiplier, said):
    assert in_words(multiplier) == said
