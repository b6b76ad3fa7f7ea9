"""Motions that lie beside each other: what rounding could lead to, and how long transient chaos lasts."""

import math

import numpy as np
import pytest
from dynamics.plain_maps import PlainMap, henon, logistic

from calib.dynamics.escape import EscapeTime
from calib.dynamics.motion import CoexistingMotions, kind_of_orbit, perturbed, rounding_decides, stable_cycles
from calib.dynamics.orbit_kind import CHAOTIC
from calib.dynamics.orbits import attracting_cycle, shoot
from calib.dynamics.single_run import kind_of_run

# just within its window of period 3, whose stable cycle is born beside chaos at 1 + sqrt(8); within that of period 5
WINDOWS = [(3.8289, 3), (3.7382, 5)]


def leaky(rate):
    """Logistic chaos out of which a narrow hole leads to a fixed point; runs leave it at about `rate` a period.

    The density of that chaos at 3/4 is 1 / (pi sqrt(3) / 4). The hole lies about an unstable fixed point of multiplier
    -2, so that half of those who come to it had been there the period before.
    """
    width = rate * math.pi * math.sqrt(3.0) / 4.0

    def function(x):
        if x[1] > 0.5:
            return np.array([0.2 + 0.5 * (x[0] - 0.2), 1.0])
        return np.array([4.0 * x[0] * (1.0 - x[0]), 1.0 if abs(x[0] - 0.75) < width else 0.0])

    def derivative(x):
        slope = 0.5 if x[1] > 0.5 else 4.0 - 8.0 * x[0]
        return np.array([[slope, 0.0], [0.0, 0.0]])

    return PlainMap(function, derivative, [0.3, 0.0])


@pytest.mark.parametrize(("a", "period"), WINDOWS)
def test_transient_chaos_has_the_kind_of_the_stable_cycle_from_every_start(a, period):
    map = logistic(a)
    found = {start: kind_of_orbit(map, np.array([start]), settle=100) for start in np.linspace(0.05, 0.95, 13)}
    assert {start: one.period for start, one in found.items()} == dict.fromkeys(found, period)
    assert [start for start, one in found.items() if not one.exponent < 0.0] == []


def test_from_states_that_only_pass_by_the_stable_cycle_is_found_by_their_close_returns():
    map, rng = logistic(3.84), np.random.default_rng(1)
    passing = map.orbit(np.array([0.3]), 400).states + rng.normal(0.0, 3e-3, (400, 1))
    cycles = list(stable_cycles(map, passing))
    assert {cycle.periods for cycle in cycles} == {3}
    for cycle in cycles:
        assert abs(cycle.multipliers[0]) < 1.0
        np.testing.assert_allclose(map.orbit(cycle.state, 3).states[-1], cycle.state, atol=1e-10)


@pytest.mark.parametrize("map", [logistic(4.0), logistic(3.9), henon(1.4)])
def test_where_there_is_no_stable_cycle_none_is_found(map):
    found = kind_of_orbit(map)
    assert found.kind == CHAOTIC
    assert (found.coexisting, found.share, found.certain, found.runs) == ((), 1.0, True, 6)
    assert found.escape.escapes == 0
    assert f"none of the runs left it within {found.escape.observed} periods" in found.evidence


def test_runs_that_leave_chaos_tell_its_mean_escape_time():
    covered = []
    for start in np.linspace(0.21, 0.39, 10):
        found = kind_of_orbit(leaky(1.0 / 300.0), np.array([start, 0.0]), runs=12)
        assert (found.period, found.certain) == (1, True)
        assert found.state[0] == pytest.approx(0.2)
        if found.runs > 1:  # the first run has not left it before a difference of rounding had grown
            low, high = found.escape.interval
            covered.append(low < 300.0 < high)
    assert sum(covered) >= len(covered) - 2 >= 6


@pytest.mark.parametrize("rate", [1.0 / 8000.0, 1.0 / 1500.0])
def test_chaos_beside_a_stable_motion_is_told_with_the_share_of_the_runs(rate):
    found = kind_of_orbit(leaky(rate), settle=1000, runs=24)
    stable, chaos = sorted((found, *found.coexisting), key=lambda one: not one.period)
    assert (stable.period, chaos.kind, found.runs) == (1, CHAOTIC, 24)
    assert stable.share == pytest.approx(found.escape.escapes / 24.0)
    assert chaos.share == pytest.approx(1.0 - stable.share)
    established = found.escape.escapes >= 3
    assert (found.period == 1, found.certain) == (established, established)
    assert f"{round(24 * found.share)} of 24 runs lead to it" in found.evidence


@pytest.mark.parametrize("start", np.linspace(0.21, 0.29, 9))
def test_a_regular_motion_that_a_run_comes_to_after_chaos_is_met_again_before_it_is_certain(start):
    map = leaky(1.0 / 2000.0)
    state = np.array([start, 0.0])
    one, found = kind_of_run(map, state), kind_of_orbit(map, state)
    assert (found.runs == 1) == (bool(one.period) and not rounding_decides(map, state, one.dropped))
    sightings = [one.sightings for one in (found, *found.coexisting) if one.period]
    assert found.certain == (not sightings or sightings[0] >= 3)
    assert (found.period == 1) == bool(sightings and (sightings[0] >= 3 or not found.coexisting))


def test_the_start_of_a_run_is_no_part_of_the_chaos_that_it_was_on():
    chaos, decay = logistic(4.0), 0.6  # beside it a component that decays from far away

    def function(x):
        return np.append(chaos.function(x[:1]), decay * x[1])

    def derivative(x):
        return np.array([[4.0 - 8.0 * x[0], 0.0], [0.0, decay]])

    map = PlainMap(function, derivative, [0.3, 30.0])
    coexisting = CoexistingMotions(map, [])
    coexisting.add_transient([map.initial], 100)
    [chaotic] = coexisting.motions
    assert chaotic.motion.kind == CHAOTIC
    assert np.abs(chaotic.states[:, 1]).max() < 1e-6


def test_what_a_single_run_finds_periodic_costs_nothing_more():
    calls = []
    map = logistic(3.2)
    orbit = map.orbit
    map.orbit = lambda state, periods: (calls.append(periods), orbit(state, periods))[1]
    kind_of_run(map, map.initial)
    alone = sum(calls)
    calls.clear()
    kind_of_orbit(map)
    assert sum(calls) == alone


def test_a_long_stable_cycle_is_periodic():
    found = kind_of_orbit(logistic(3.56994))  # a period doubling beyond 64
    assert found.period in (128, 256)
    assert found.exponent < 0.0
    assert found.impacts_per_period == 0.0


def test_perturbed_starts_differ_imperceptibly_and_from_each_other():
    map = henon(1.4)
    starts = list(perturbed(map, map.initial, 5))
    assert len({tuple(start) for start in starts}) == 5
    assert all(0.0 < np.abs((start - map.initial) / map.scale).max() <= 1e-6 for start in starts)


def test_rounding_decides_where_the_transient_is_chaotic_and_not_where_it_shrinks():
    assert rounding_decides(logistic(4.0), np.array([0.3]), 100)
    assert not rounding_decides(logistic(3.2), np.array([0.3]), 100)
    assert not rounding_decides(logistic(4.0), np.array([0.3]), 0)


def test_newton_from_a_close_return_gives_what_shooting_gives():
    map = logistic(3.83)
    near = attracting_cycle(map, np.array([0.157]), 3, reach=0.05)
    np.testing.assert_allclose(near.state, shoot(map, np.array([0.157]), 3).state, atol=1e-10)
    assert attracting_cycle(map, np.array([0.157]), 3, reach=1e-6) is None  # beyond its reach
    assert attracting_cycle(logistic(4.0), np.array([0.75]), 1, reach=0.05) is None  # unstable
    assert attracting_cycle(logistic(3.83), np.array([0.157]), 6, reach=0.05).periods == 3


def test_the_interval_of_the_mean_escape_time_covers_it():
    rng, mean, limit, covered = np.random.default_rng(1), 500.0, 400, 0
    for _ in range(400):
        lifetimes = rng.exponential(mean, 8)
        low, high = EscapeTime(int(np.minimum(lifetimes, limit).sum()), int((lifetimes < limit).sum())).interval
        covered += low <= mean <= high
    assert covered / 400 > 0.93


def test_without_an_escape_only_a_lower_bound_is_said():
    escape = EscapeTime(3000, 0)
    assert escape.mean == math.inf
    assert escape.interval == (pytest.approx(3000 / -math.log(0.025)), math.inf)
    assert "none of the runs left it within 3000 periods: mean escape time above 813" in str(escape)
    assert str(EscapeTime(3000, 3)).startswith("mean escape time 1000 periods (95 % 342 to 4849")
