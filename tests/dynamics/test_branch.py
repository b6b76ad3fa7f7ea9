"""Branches: a cycle followed through one parameter by pseudo-arclength continuation."""

import math

import numpy as np
import pytest
import xarray as xr
from dynamics.plain_maps import GrazingMap, PlainMap, delayed_logistic, henon, logistic

from calib.dynamics.branch import follow
from calib.errors import CalibError

FOLD, FLIP = -(0.7**2) / 4.0, 3.0 * 0.7**2 / 4.0  # of Henon's map with b = 0.3


def by_differences(a):
    map = henon(a)
    map.derivative = None
    return map


def henon_branch(maps=henon):
    return follow(maps, [0.7, 0.2], 0.2, (-0.3, 0.6))


def found(branch, kind):
    return [point for point in branch.points if point.kind == kind]


# --- fold and flip


@pytest.mark.parametrize("maps", [henon, by_differences])
def test_the_fold_of_henon_is_found(maps):
    branch = henon_branch(maps)
    [fold] = found(branch, "fold")
    assert abs(fold.parameter - FOLD) < 1e-9
    assert fold.state == pytest.approx([-0.35 / FOLD, -0.105 / FOLD], abs=1e-6)
    assert branch.multipliers[fold.index][0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("maps", [henon, by_differences])
def test_the_flip_of_henon_is_found(maps):
    branch = henon_branch(maps)
    [flip] = found(branch, "flip")
    assert abs(flip.parameter - FLIP) < 1e-9
    assert branch.multipliers[flip.index][0] == pytest.approx(-1.0, abs=1e-6)


def test_the_branch_is_followed_round_the_fold_to_its_unstable_side():
    branch = henon_branch()
    fold, flip = found(branch, "fold")[0].index, found(branch, "flip")[0].index
    a, x = branch.parameter, branch.states[:, 0]
    assert np.abs(a * x**2 + 0.7 * x - 1.0).max() < 1e-9
    assert 10 < fold < flip
    assert (np.diff(a[: fold + 1]) < 0.0).all()
    assert (np.diff(a[fold:]) > 0.0).all()
    assert not branch.stable[:fold].any()
    assert branch.stable[fold + 1 : flip].all()
    assert not branch.stable[flip + 1 :].any()


def test_the_multipliers_along_the_branch_are_those_of_the_closed_form():
    branch = henon_branch()
    ax = branch.parameter * branch.states[:, 0]
    expected = np.sort(np.column_stack([-ax - np.sqrt(ax**2 + 0.3), -ax + np.sqrt(ax**2 + 0.3)]), axis=1)
    assert np.abs(np.sort(branch.multipliers.real, axis=1) - expected).max() < 1e-8


def test_special_points_are_points_of_the_branch():
    branch = henon_branch()
    assert len(branch.points) == 2
    for point in branch.points:
        assert branch.parameter[point.index] == point.parameter
        assert (branch.states[point.index] == point.state).all()


def test_a_branch_is_the_same_bit_for_bit():
    one, other = henon_branch(), henon_branch()
    assert (one.states == other.states).all()
    assert one.points[0].parameter == other.points[0].parameter


def test_the_scale_of_the_map_may_change_with_the_parameter():
    def scaled(a):
        map = by_differences(a)
        map.scale = np.array([10.0 ** (2.0 * a), 0.5])
        return map

    branch = henon_branch(scaled)
    assert abs(found(branch, "flip")[0].parameter - FLIP) < 1e-9
    assert abs(found(branch, "fold")[0].parameter - FOLD) < 1e-9


def straight(*multipliers):
    """Map with the fixed point 0 and multipliers that are functions of the parameter."""

    def maps(p):
        jacobian = np.diag([multiplier(p) for multiplier in multipliers])
        return PlainMap(lambda x: jacobian @ x, lambda x: jacobian, np.zeros(len(multipliers)))

    return maps


def test_special_points_between_neighbours_stand_in_the_order_of_the_branch():
    maps = straight(lambda p: -0.5 - p, lambda p: 0.499 + p)
    branch = follow(maps, [0.0, 0.0], 0.1, (0.0, 1.0))
    assert [point.kind for point in branch.points] == ["flip", "branching"]
    assert branch.points[1].index == branch.points[0].index + 1
    assert [point.parameter for point in branch.points] == pytest.approx([0.5, 0.501], abs=1e-9)


def test_a_multiplier_that_jumps_past_the_circle_is_no_flip():
    branch = follow(straight(lambda p: -0.5 if p < 0.503 else -1.5), [0.0], 0.1, (0.0, 1.0))
    assert branch.parameter[[0, -1]].tolist() == [0.0, 1.0]
    assert branch.stable[0]
    assert not branch.stable[-1]
    assert branch.points == ()


def test_where_another_branch_crosses_stability_is_exchanged():
    branch = follow(logistic, [0.6], 2.5, (0.5, 2.9))
    [point] = branch.points
    assert point.kind == "branching"
    assert abs(point.parameter - 1.0) < 1e-6
    beside = np.arange(len(branch.stable)) != point.index
    assert (branch.stable == (branch.parameter > point.parameter))[beside].all()
    assert np.abs(branch.states[:, 0] - 1.0 + 1.0 / branch.parameter).max() < 1e-7


# --- Neimark-Sacker


def test_the_neimark_sacker_point_of_the_delayed_logistic_map_is_found():
    branch = follow(delayed_logistic, [0.4, 0.4], 1.8, (1.5, 2.3))
    [point] = branch.points
    assert point.kind == "Neimark-Sacker"
    assert abs(point.parameter - 2.0) < 1e-9
    assert "0.166667 of a circle" in point.evidence
    beside = np.arange(len(branch.stable)) != point.index
    assert (branch.stable == (branch.parameter < point.parameter))[beside].all()


def neutral_saddle(p):
    """Multipliers 2 and p: their product goes through 1 at p = 0.5, and neither leaves its side of the circle."""
    jacobian = np.array([[2.0, 0.3], [0.0, p]])
    return PlainMap(lambda x: jacobian @ x + [p, 0.1], lambda x: jacobian, [0.0, 0.0])


def test_a_neutral_saddle_is_no_neimark_sacker_point():
    branch = follow(neutral_saddle, [0.0, 0.1], 0.3, (0.3, 0.7))
    products = np.prod(branch.multipliers, axis=1).real
    assert products.min() < 0.9 < 1.1 < products.max()
    assert branch.points == ()


# --- cycles of several periods


def test_a_two_cycle_ends_at_the_flip_that_it_comes_from():
    branch = follow(logistic, [0.799], 3.2, (2.8, 3.6), periods=2)
    birth, flip = branch.points
    assert branch.periods == 2
    assert birth.index == 0
    assert abs(birth.parameter - 3.0) < 1e-6
    assert "half its period" in branch.ends[0]
    assert flip.kind == "flip"
    assert abs(flip.parameter - 1.0 - math.sqrt(6.0)) < 1e-9
    assert branch.parameter[-1] == 3.6


@pytest.mark.parametrize("scale", [10.0, 100.0])
def test_a_two_cycle_small_against_the_scale_is_not_left_for_the_cycle_that_it_comes_from(scale):
    def maps(a):
        map = logistic(a)
        map.scale = np.array([scale])
        return map

    branch = follow(maps, [0.799], 3.2, (2.8, 3.6), periods=2)
    assert branch.parameter[0] == pytest.approx(3.0, abs=2e-6)  # the ends stay away from the fixed point below
    first, second = branch.displacement[0]
    assert (np.abs(first - second)[1:] > 1e-7 * scale).all()


def test_a_fixed_point_sought_with_two_periods_is_followed_with_one():
    branch = follow(logistic, [0.65], 2.9, (2.5, 3.3), periods=2)
    assert branch.periods == 1
    assert [point.kind for point in branch.points] == ["flip"]
    assert abs(branch.points[0].parameter - 3.0) < 1e-9


# --- grazing


@pytest.mark.parametrize("kick", [0.1, -0.1], ids=["impact goes on", "both end"])
def test_a_branch_ends_where_its_miss_comes_to_zero(kick):
    branch = follow(lambda gap: GrazingMap(gap, kick), [1.0, -0.2], 1.5, (0.5, 2.0))
    [point] = branch.points
    assert point.kind == "grazing"
    assert abs(point.parameter - 1.0) < 1e-9
    assert np.abs(point.state - [1.0, -0.2]).max() < 1e-9
    assert branch.ends[0] == "grazing at 1"
    assert "nearest miss at" in point.evidence
    assert branch.nearest == pytest.approx(branch.parameter - 1.0, abs=1e-10)
    assert (branch.impacts == 0).all()
    assert branch.parameter[-1] == 2.0


@pytest.mark.parametrize("known", [True, False], ids=["derivative", "differences"])
def test_a_branch_ends_where_its_impact_slows_down_to_nothing(known):
    def maps(gap):
        map = GrazingMap(gap)
        if not known:
            map.tangent = lambda state, vectors, periods: None
        return map

    branch = follow(maps, [0.85, -0.2], 0.7, (0.5, 2.0))
    [point] = found(branch, "grazing")
    assert abs(point.parameter - 1.0) < 1e-7
    assert point.index == len(branch.parameter) - 1
    assert branch.slowest[-1] < 1e-2 * branch.slowest[0]
    assert (branch.impacts == 1).all()
    assert 0.9 * branch.slowest**2 + 0.1 * branch.slowest == pytest.approx(0.9 * (1.0 - branch.parameter), abs=1e-9)


def test_cycles_with_and_without_impact_end_at_one_grazing():
    speed = 0.05
    branch = follow(
        lambda gap: GrazingMap(gap, -0.1), [1.01, -0.2], 1.0 - speed**2 + 0.1 * speed / 0.9, (0.5, 2.0)
    )  # on the impacting side, above the grazing: the branch folds before it grazes
    [fold], [grazing] = found(branch, "fold"), found(branch, "grazing")
    assert abs(fold.parameter - 1.0 - (0.1 / 1.8) ** 2) < 1e-9
    assert abs(grazing.parameter - 1.0) < 1e-7


def test_chatter_may_gain_and_lose_impacts_along_a_branch():
    def chattering(contact):
        def maps(a):
            map = henon(a)
            plain = map.orbit
            impacts = np.array([(0.0, 0.3, 0.1**k) for k in range(3 if a < 0.1 else 5)])
            map.orbit = lambda state, periods: plain(state, periods)._replace(impacts=impacts, contact=contact)
            return map

        return follow(maps, [0.7, 0.2], 0.2, (0.0, 0.3))

    assert set(chattering(contact=0.2).impacts) == {3, 5}
    assert set(chattering(contact=0.0).impacts) == {5}
    assert "impacts per return change from 5 to 3" in chattering(contact=0.0).ends[0]


# --- ends


def test_the_edges_of_the_window_are_reached_exactly():
    branch = follow(delayed_logistic, [0.4, 0.4], 1.8, (1.1, 2.7))
    assert branch.parameter[[0, -1]].tolist() == [1.1, 2.7]
    assert branch.ends == ("edge of the window, 1.1", "edge of the window, 2.7")
    assert (np.diff(branch.parameter) > 0.0).all()


def test_a_branch_may_start_at_an_edge():
    branch = follow(delayed_logistic, [0.4, 0.4], 1.8, (1.8, 2.1))
    assert branch.parameter[[0, -1]].tolist() == [1.8, 2.1]
    assert (np.diff(branch.parameter) > 0.0).all()


def test_the_map_is_never_asked_for_outside_the_window():
    asked = []
    follow(lambda a: asked.append(a) or delayed_logistic(a), [0.4, 0.4], 1.8, (1.1, 2.7))
    assert (min(asked), max(asked)) == (1.1, 2.7)


def circle(p):
    return PlainMap(lambda x: x - 0.5 * (x**2 + p**2 - 1.0), lambda x: np.diag(1.0 - x), [1.0])


@pytest.mark.parametrize("low", [0.44, 0.7])
def test_a_branch_that_bends_towards_an_edge_does_not_leave_the_window(low):
    asked = []
    branch = follow(lambda p: asked.append(p) or circle(p), [0.6], 0.8, (low, 2.0))
    assert branch.parameter[[0, -1]].tolist() == [low, low]
    assert branch.states[0] == pytest.approx(-branch.states[-1], abs=1e-9)
    assert min(asked) == low


def test_a_branch_does_not_jump_to_another():
    def maps(p):
        return PlainMap(lambda x: 0.5 * x + (0.15 if p > 0.6 else 0.0), lambda x: np.diag([0.5]), [0.0])

    branch = follow(maps, [0.0], 0.2, (0.0, 1.0))
    assert "off the branch" in branch.ends[1]
    assert branch.parameter[-1] == pytest.approx(0.6, abs=1e-5)
    assert np.abs(branch.states).max() < 1e-9


def test_a_branch_that_closes_on_itself_is_gone_round_once():
    branch = follow(circle, [1.0], 0.0, (-2.0, 2.0))
    assert branch.ends == ("the branch closes on itself",) * 2
    assert sorted(round(point.parameter, 9) for point in branch.points) == [-1.0, 1.0]
    assert branch.parameter[0] == branch.parameter[-1]
    turned = np.unwrap(np.arctan2(branch.parameter, branch.states[:, 0]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2.0 * np.pi, abs=1e-9)


def test_a_branch_stops_after_the_points_allowed():
    branch = follow(delayed_logistic, [0.4, 0.4], 1.8, (1.1, 2.7), most=5)
    assert len(branch.parameter) == 11
    assert branch.ends == ("5 points are made",) * 2


def failing_below(edge, impacts=()):
    def maps(a):
        map = delayed_logistic(a)
        plain, limit = map.orbit, 1e3 if a >= edge else 0.0

        def orbit(state, periods):
            map.limit = limit
            return plain(state, periods)._replace(impacts=np.array(impacts, dtype=float).reshape(-1, 3))

        map.orbit = orbit
        return map

    return maps


def test_where_the_motion_fails_the_branch_is_lost_and_says_so():
    branch = follow(failing_below(1.5), [0.4, 0.4], 1.8, (1.1, 1.9))
    assert branch.ends[0].startswith("lost at 1.5")
    assert "fails" in branch.ends[0]
    assert branch.parameter[0] == pytest.approx(1.5, abs=1e-5)
    assert branch.points == ()


@pytest.mark.parametrize(("size", "rate"), [(5e-3, 0.1), (0.5, 5e-3)], ids=["small but slow", "fast but large"])
def test_a_miss_that_would_not_come_to_zero_at_the_end_is_no_grazing(size, rate):
    def maps(a):
        map = failing_below(1.5)(a)
        map.near_misses = lambda state: np.array([size * 4.0 ** ((a - 1.5) / rate)])
        return map

    branch = follow(maps, [0.4, 0.4], 1.8, (1.1, 1.9))
    assert branch.nearest[0] < 1.1 * size
    assert branch.ends[0].startswith("lost at 1.5")


def test_an_impact_at_the_section_is_named_as_a_cause():
    at, off = ([(0.0, phase, 1.0)] for phase in (0.9995, 0.5))
    told, untold = (follow(failing_below(1.5, section), [0.4, 0.4], 1.8, (1.1, 1.9)).ends[0] for section in (at, off))
    assert "1.5" in untold
    assert told.startswith(untold.rstrip("."))  # the same, and a remedy beside it
    assert "another phase" in told.removeprefix(untold.rstrip("."))


def test_without_a_cycle_at_the_start_the_branch_is_empty_and_says_why():
    branch = follow(henon, [0.0, 0.0], -0.2, (-0.3, 0.6))
    assert branch.parameter.size == 0
    assert branch.displacement.shape == (1, 1, 0)
    assert branch.states.shape == (0, 2)
    assert "residual" in branch.ends[0]
    assert branch.dataset("a", "1").sizes["step"] == 0


@pytest.mark.parametrize("window", [(0.3, 0.6), (0.2, 0.2), (0.6, -0.3), (-math.inf, 0.6)])
def test_a_window_that_is_none_is_the_callers_mistake(window):
    with pytest.raises(CalibError, match="window"):
        follow(henon, [0.7, 0.2], 0.2, window)


# --- the dataset


def test_the_dataset_is_the_branch_after_a_file(tmp_path):
    branch = henon_branch()
    branch.dataset("a", "1").to_netcdf(tmp_path / "branch.nc")
    with xr.open_dataset(tmp_path / "branch.nc") as read:
        assert read.parameter.attrs == {"units": "1", "name": "a"}
        assert (read.parameter == branch.parameter).all()
        assert (read.displacement.transpose("body", "cycle", "step") == branch.displacement).all()
        assert read.displacement.attrs["units"] == "m"
        rebuilt = read.multiplier_modulus * np.exp(1j * read.multiplier_angle)
        assert np.abs(rebuilt.values - branch.multipliers).max() < 1e-12
        assert read.special_kind.values.tolist() == ["fold", "flip"]
        assert (read.parameter.values[read.special_index.values] == read.special_parameter.values).all()
        assert (read.stable.values == branch.stable).all()
        assert read.attrs["last_end"] == branch.ends[1]


def test_a_motion_without_a_period_is_refused_before_it_is_followed():
    with pytest.raises(CalibError, match=r"got the period 0 at 3\.9.*does not return; begin at another value"):
        follow(logistic, [0.3], 3.9, (3.5, 4.0), periods=0)
