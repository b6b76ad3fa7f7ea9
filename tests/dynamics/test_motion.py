"""Kinds of motion of maps whose dynamics are known."""

import math

import numpy as np
import pytest
from dynamics.plain_maps import PlainMap, delayed_logistic, henon, logistic
from dynamics.quasi_periodic_maps import GOLDEN, Struck, circle, spiral, torus

from calib.dynamics.irregular import kind_of_irregular
from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.orbit_kind import CHAOTIC, FAILED, QUASI_PERIODIC
from calib.dynamics.pseudo_orbit import pseudo_orbit
from calib.dynamics.recurrence import returned_after
from calib.dynamics.settling import settled_orbit
from calib.dynamics.single_run import _beyond_laminar_phase, kind_of_run
from calib.errors import CalibError

# the returns of the circle by 0.35... all but stand still, yet fall in each block of its section
IRRATIONAL = [circle(), circle(GOLDEN / 60.0), circle(1.0 / 6.0 + 0.001 * GOLDEN), circle(0.3515628140703518), torus()]


def multiplier_exponent(a, n):
    """Exponent of the stable cycle of n periods of the logistic map, from a long run."""
    x, total = 0.3, 0.0
    for k in range(20_000 + n):
        total += math.log(abs(a * (1.0 - 2.0 * x))) if k >= 20_000 else 0.0
        x = a * x * (1.0 - x)
    return total / n


@pytest.mark.parametrize(
    ("n", "a"),
    [(1, 1.5), (1, 2.9), (2, 3.01), (2, 3.2), (2, 3.4), (4, 3.46), (4, 3.52), (8, 3.55), (8, 3.56), (16, 3.566)]
    + [(3, 3.8285), (3, 3.83), (6, 3.845), (5, 3.74), (6, 3.627), (6, 3.63), (7, 3.702), (32, 3.5696)],
)
def test_a_cycle_of_the_logistic_map_has_its_period_and_its_exponent(n, a):
    found = kind_of_orbit(logistic(a))
    assert (found.kind, found.period, found.impacts, found.label) == (f"period-{n}", n, 0, f"0/{n}")
    assert found.exponent == pytest.approx(multiplier_exponent(a, n), abs=1e-4)
    assert found.error == 0.0
    assert math.isnan(found.zero_one)


@pytest.mark.parametrize("a", [3.572, 3.58, 3.6, 3.7, 3.828, 3.9, 4.0])
def test_chaos_of_the_logistic_map_is_called_chaotic(a):
    found = kind_of_orbit(logistic(a))
    assert (found.kind, found.label, found.period, found.impacts) == (CHAOTIC, CHAOTIC, 0, -1)
    assert found.zero_one > 0.5


def test_chaos_has_its_exponent_within_the_error():
    found = kind_of_orbit(logistic(4.0))
    assert found.exponent == pytest.approx(math.log(2.0), abs=4.0 * found.error)
    assert found.error < 0.03
    assert kind_of_orbit(henon(1.4)).exponent == pytest.approx(0.4192, abs=0.08)


@pytest.mark.parametrize(("n", "a"), [(1, 2.0), (2, 1.0 + math.sqrt(5.0)), (3, 3.8318740552833156)])
def test_a_superstable_cycle_is_periodic(n, a):
    found = kind_of_orbit(logistic(a))
    assert found.kind == f"period-{n}"
    assert found.exponent < -8.0


def test_a_motion_that_a_phase_of_contact_wipes_out_has_exponent_minus_infinity():
    found = kind_of_orbit(PlainMap(lambda x: np.array([0.3, 0.2]), lambda x: np.zeros((2, 2)), [0.1, 0.1]))
    assert (found.kind, found.exponent) == ("period-1", -math.inf)


@pytest.mark.parametrize("a", [2.001, 2.01, 2.04296644295302, 2.05, 2.1, 2.15])
def test_above_its_neimark_sacker_point_the_delayed_logistic_map_is_quasi_periodic(a):
    found = kind_of_orbit(delayed_logistic(a))
    assert (found.kind, found.period) == (QUASI_PERIODIC, 0)
    assert abs(found.exponent) < 3e-3


def test_a_locked_torus_is_periodic():
    assert kind_of_orbit(delayed_logistic(2.18)).kind == "period-7"
    assert kind_of_orbit(circle(3.0 / 64.0)).kind == "period-64"


@pytest.mark.parametrize("map", IRRATIONAL)
def test_irrational_turns_are_quasi_periodic(map):
    assert kind_of_orbit(map).kind == QUASI_PERIODIC


@pytest.mark.slow
def test_a_return_longer_than_64_periods_is_undecided_and_told():
    found = kind_of_orbit(circle(1.0 / 100.0))
    assert found.kind == "undecided"
    assert "returns after 100 period(s)" in found.evidence


@pytest.mark.parametrize(
    ("map", "likely"),
    [
        (logistic(2.9999), "likely period-1"),
        (logistic(3.0), "still settling"),
        (spiral(0.9998), "likely period-1"),
    ],
)
def test_a_motion_that_settles_for_ever_is_undecided_and_says_where_to(map, likely):
    found = kind_of_orbit(map)
    assert found.kind == "undecided"
    assert likely in found.evidence
    assert found.dropped > 6000


def test_where_a_motion_settles_to_is_not_said_without_an_exponent_to_agree():
    found = kind_of_orbit(delayed_logistic(2.0))
    assert found.kind == "undecided"
    assert found.evidence.endswith("still settling")


@pytest.mark.slow
def test_what_the_exponent_and_the_0_1_test_disagree_on_is_undecided():
    grown = kind_of_orbit(delayed_logistic(2.210677966101695))
    assert (grown.kind, grown.exponent > 3.0 * grown.error, grown.zero_one < 0.2) == ("undecided", True, True)
    edge = kind_of_orbit(logistic(3.5699456718))  # where the doublings pile up
    assert (edge.kind, abs(edge.exponent) < 3.0 * edge.error, edge.zero_one > 0.2) == ("undecided", True, True)


def test_a_chance_return_of_one_state_is_no_return():
    section = logistic(3.9).orbit(np.array([0.3]), 1000).states
    section[699] = section[999]
    assert returned_after(section) == 0
    assert returned_after(np.tile(section[:100], (10, 1))) == 100


def test_the_transient_is_dropped_to_a_thousandth_of_what_a_return_may_differ():
    assert np.ptp(kind_of_orbit(logistic(2.9)).orbit.states) < 1e-9


def test_a_torus_of_a_hundred_thousandth_of_the_motion_is_seen():
    map = circle()
    small = PlainMap(
        lambda x: np.array([1.0, *(1e-5 * map.function(1e5 * x[1:]))]),
        lambda x: np.block([[np.zeros((1, 1)), np.zeros((1, 2))], [np.zeros((2, 1)), map.derivative(1e5 * x[1:])]]),
        [1.0, 3e-6, 4e-6],
    )
    assert kind_of_orbit(small).kind == QUASI_PERIODIC


@pytest.mark.parametrize(
    ("map", "n", "exponent"),
    [
        (logistic(2.9995), 1, math.log(0.9995)),
        (logistic(2.996), 1, math.log(0.996)),
        (logistic(3.0001), 2, 0.5 * math.log(4.0 + 2.0 * 3.0001 - 3.0001**2)),
        (logistic(3.0005), 2, 0.5 * math.log(4.0 + 2.0 * 3.0005 - 3.0005**2)),
        (delayed_logistic(1.99), 1, 0.5 * math.log(0.99)),
    ],
)
def test_a_motion_that_settles_slowly_is_taken_to_its_cycle(map, n, exponent):
    found = kind_of_orbit(map)
    assert found.kind == f"period-{n}"
    assert found.exponent == pytest.approx(exponent, rel=1e-6)
    back = map.orbit(found.state, n).states[-1]
    np.testing.assert_allclose(back, found.state, atol=1e-10)


def test_a_fast_transient_costs_few_periods():
    assert kind_of_orbit(logistic(3.2)).dropped == 64


@pytest.mark.parametrize("shrink", [0.3, 0.9, 0.98])
def test_a_fixed_point_at_exactly_zero_is_period_1(shrink):
    found = kind_of_orbit(spiral(shrink))
    assert found.kind == "period-1"
    assert found.exponent == pytest.approx(math.log(shrink), abs=1e-9)


def test_small_motions_are_told_apart_by_their_own_size():
    map = logistic(3.2)
    small = PlainMap(lambda x: 1e-6 * map.function(1e6 * x), lambda x: map.derivative(1e6 * x), [3e-7])
    assert kind_of_orbit(small).kind == "period-2"


def test_components_are_compared_in_units_of_the_scale():
    map = logistic(3.2)
    mixed = PlainMap(
        lambda x: np.array([0.5, 1e-8 * map.function(1e8 * x[1:])[0]]),
        lambda x: np.diag([0.0, map.derivative(1e8 * x[1:])[0, 0]]),
        [0.5, 3e-9],
    )
    assert kind_of_orbit(mixed).kind == "period-1"
    mixed.scale = np.array([1.0, 1e-8])
    assert kind_of_orbit(mixed).kind == "period-2"


def test_rest_on_an_unstable_cycle_is_called_so():
    found = kind_of_orbit(logistic(3.9), np.zeros(1))
    assert found.kind == "period-1"
    assert found.exponent == pytest.approx(math.log(3.9))
    assert "unstable" in found.evidence


def test_a_start_next_to_an_unstable_cycle_is_left():
    assert kind_of_orbit(logistic(3.01), np.array([1.0 - 1.0 / 3.01])).kind == "period-2"
    assert kind_of_orbit(logistic(3.9), np.array([1.0 - 1.0 / 3.9])).kind == CHAOTIC
    assert kind_of_orbit(logistic(3.2), np.array([1.0 - 1.0 / 3.2 + 1e-15])).kind == "period-2"
    assert kind_of_orbit(logistic(3.05), np.array([1.0 - 1.0 / 3.05 + 1e-13])).kind == "period-2"


@pytest.mark.parametrize("apart", [1e-4, 3e-6])
@pytest.mark.parametrize("beyond", [0.0003, 0.0015])
def test_a_start_beside_a_weakly_unstable_cycle_tells_of_the_motion_it_goes_to(beyond, apart):
    """Growth by 0.03 to 0.3 % a period: the first thousands of periods are neither a torus nor chaos."""
    a = 3.0 + beyond
    found = kind_of_orbit(logistic(a), [1.0 - 1.0 / a + apart])
    assert found.kind == "period-2"
    assert found.exponent == pytest.approx(0.5 * math.log(abs(4.0 + 2.0 * a - a**2)), rel=1e-6)


@pytest.mark.parametrize(("start", "end"), [(1.0 - 1e-4, 0.0), (1.0 + 1e-4, 2.0)])
def test_a_start_beside_an_unstable_fixed_point_goes_to_the_side_it_is_on(start, end):
    def function(x):
        return x + 0.002 * (x - 1.0) * (1.0 - (x - 1.0) ** 2)

    def derivative(x):
        return np.array([[1.002 - 0.006 * (x[0] - 1.0) ** 2]])

    found = kind_of_orbit(PlainMap(function, derivative, [start]))
    assert found.kind == "period-1"
    assert found.state[0] == pytest.approx(end, abs=1e-3)


def test_a_push_to_where_there_is_no_motion_is_taken_back():
    """The second component follows the first up to 0.004; beyond 0.006, where the push leads, the map has no image."""

    def function(x):
        away = x[0] - 1.0
        follows = 0.5 * x[1] + 0.5 * np.clip(away, -0.004, 0.004)
        return np.array([x[0] + 0.002 * away * (1.0 - away**2), follows if abs(x[1]) < 0.006 else np.inf])

    def derivative(x):
        away = x[0] - 1.0
        return np.array([[1.002 - 0.006 * away**2, 0.0], [0.5 * (abs(away) < 0.004), 0.5]])

    map = PlainMap(function, derivative, [1.0 + 1e-4, 1e-4])
    found = settled_orbit(map, map.initial)
    lingering = kind_of_irregular(map, found)
    pushed = _beyond_laminar_phase(map, lingering)
    assert lingering.laminar
    assert map.orbit(pushed, 2).status == "diverged"
    found = kind_of_run(map, map.initial)
    assert (found.kind, found.state.tolist()) == ("period-1", pytest.approx([2.0, 0.004], abs=1e-6))


@pytest.mark.parametrize("slope", [1.03, 1.05, 1.4])
def test_chaos_of_one_slope_everywhere_is_chaotic(slope):
    def derivative(x):
        return np.array([[math.copysign(slope, 0.5 - x[0])]])

    tent = PlainMap(lambda x: slope * np.minimum(x, 1.0 - x), derivative, [0.3])
    assert kind_of_orbit(tent).kind == CHAOTIC


def test_a_diverging_map_has_failed():
    found = kind_of_orbit(logistic(4.1))
    assert (found.kind, found.status, found.label) == (FAILED, "diverged", FAILED)
    assert found.reason == "the map's state grew beyond bounds"
    assert np.isfinite(found.state).all()


@pytest.mark.parametrize("last", [30, 1050, 1300, 1700])
def test_a_motion_that_fails_late_has_failed(last):
    def chaos_until(x):
        return np.array([3.9 * x[0] * (1.0 - x[0]), x[1] + 1e-9 if x[1] < (last - 0.5) * 1e-9 else 1e9])

    found = kind_of_orbit(PlainMap(chaos_until, None, [0.3, 0.0]))
    assert (found.kind, found.status) == (FAILED, "diverged")


def test_a_state_that_is_not_a_number_has_failed():
    class Silent:
        def __init__(self, map):
            self.scale, self.initial, self.impacting, self.map = map.scale, map.initial, False, map

        def orbit(self, state, periods):
            orbit = self.map.orbit(self.initial, periods)
            return orbit._replace(states=np.full_like(orbit.states, np.nan))

    found = kind_of_orbit(Silent(logistic(3.2)))
    assert (found.kind, found.status) == (FAILED, "diverged")


@pytest.mark.parametrize("map", [logistic(3.5), logistic(3.9), delayed_logistic(2.1), henon(1.4)])
def test_a_map_that_does_not_know_its_derivative_has_the_same_kind(map):
    known, blind = kind_of_orbit(map), kind_of_orbit(PlainMap(map.function, None, map.initial))
    assert blind.kind == known.kind
    assert blind.exponent == pytest.approx(known.exponent, abs=1e-3 if known.period else 0.1)


def test_a_motion_that_never_meets_the_stop_has_no_contact():
    assert kind_of_orbit(Struck(logistic(2.9), lambda x: 0)).kind == "no contact"
    assert kind_of_orbit(logistic(2.9)).kind == "period-1"  # no stop, no contact to miss
    found = kind_of_orbit(Struck(logistic(3.2), lambda x: 0))
    assert (found.kind, found.label) == ("period-2", "0/2")


def test_contact_without_an_impact_is_contact():
    held = Struck(logistic(2.9), lambda x: 0)
    free = held.orbit
    held.orbit = lambda state, periods: free(state, periods)._replace(contact=1.0)
    assert kind_of_orbit(held).kind == "period-1"


def test_the_label_counts_the_impacts_of_one_return():
    found = kind_of_orbit(Struck(logistic(3.2), lambda x: 2 if x[0] > 0.6 else 1))
    assert (found.kind, found.label, found.impacts) == ("period-2", "3/2", 3)
    assert found.impacts_per_period == 1.5
    three = kind_of_orbit(Struck(logistic(3.83), lambda x: int(x[0] > 0.9)))
    assert (three.label, three.impacts_per_period) == ("1/3", pytest.approx(1.0 / 3.0))  # 99 of 100 cycles are whole


def test_chaos_has_impacts_per_period_too():
    found = kind_of_orbit(Struck(logistic(4.0), lambda x: int(x[0] > 0.5)))
    assert (found.impacts, found.label) == (-1, CHAOTIC)
    assert found.impacts_per_period == len(found.orbit.impacts) / 100
    assert 0.3 < found.impacts_per_period < 0.7


def test_the_kept_orbit_goes_on_from_the_dropped_one():
    map = logistic(3.9)
    found = kind_of_orbit(map, settle=300, cycles=120)
    assert found.dropped == 300
    state = map.initial
    for periods in (64, 64, 64, 64, 44):  # as the transient is dropped
        state = pseudo_orbit(map, state, periods).states[-1]
    np.testing.assert_array_equal(found.orbit.states, pseudo_orbit(map, state, 120).states)
    np.testing.assert_array_equal(found.state, found.orbit.states[-1])


def test_the_kind_does_not_depend_on_the_unit_of_the_state():
    map = henon(1.0)
    millimetre = PlainMap(lambda x: 1e3 * map.function(1e-3 * x), lambda x: map.derivative(1e-3 * x), 1e3 * map.initial)
    millimetre.scale, millimetre.limit = np.full(2, 1e3), 1e6
    found, other = kind_of_orbit(map), kind_of_orbit(millimetre)
    assert (found.kind, found.dropped) == (other.kind, other.dropped)
    assert found.exponent == pytest.approx(other.exponent, rel=1e-6)


def test_too_few_cycles_are_refused():
    with pytest.raises(CalibError, match="expected at least 96 cycles to keep, got 50"):
        kind_of_orbit(logistic(3.2), cycles=50)


@pytest.mark.parametrize("number", [50, pytest.param(150, marks=pytest.mark.slow)])
def test_a_sweep_of_the_logistic_map_calls_no_cycle_chaotic_and_no_chaos_regular(number):
    a = 2.9 + 1.1 * (np.arange(number) + 0.5) / number
    x, total, last = np.full(a.size, 0.3), np.zeros(a.size), 20_000
    for k in range(2 * last):
        if k >= last:
            total += np.log(np.abs(a * (1.0 - 2.0 * x)))
        x = a * x * (1.0 - x)
    exact = total / last
    kinds = [kind_of_orbit(logistic(value)).kind for value in a]
    for value, exponent, kind in zip(a, exact, kinds, strict=True):
        assert kind not in (QUASI_PERIODIC, FAILED), (value, kind)
        if exponent < -0.01:
            assert kind != CHAOTIC, value
        if exponent > 0.05:
            assert kind == CHAOTIC, (value, kind)
    assert kinds.count("undecided") <= 0.02 * number
