"""Pseudo-orbits: what rounding does not part."""

import numpy as np
import pytest
from dynamics.plain_maps import PlainMap, henon, logistic

from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.pseudo_orbit import LATTICE_SPACING, PERIODS_PER_PIECE, on_lattice, pseudo_orbit, pseudo_tangent
from calib.dynamics.tangent import tangent


def rounded(noise):
    """Chaos of Henon's map on a processor that rounds by `noise`."""
    plain, rng = henon(1.4), np.random.default_rng(1)
    return PlainMap(lambda x: plain.function(x) * (1.0 + noise * rng.choice([-1.0, 0.0, 1.0], 2)), None, plain.initial)


def test_two_processors_follow_one_pseudo_orbit_where_their_orbits_part():
    one, other = rounded(0.0), rounded(np.finfo(float).eps)
    apart = np.abs(one.orbit(one.initial, 320).states - other.orbit(other.initial, 320).states).max()
    assert apart > 0.1
    pair = [pseudo_orbit(map, map.initial, 320).states for map in (one, other)]
    assert np.abs(pair[0] - pair[1]).max() < LATTICE_SPACING


def test_each_step_is_the_map_s_to_within_the_lattice():
    map = henon(1.4)
    states = np.vstack([map.initial, pseudo_orbit(map, map.initial, 200).states])
    images = np.array([map.function(state) for state in states[:-1]])
    assert np.abs(images - states[1:]).max() < 4.0 * LATTICE_SPACING
    inside = [k for k in range(200) if k % PERIODS_PER_PIECE]
    np.testing.assert_array_equal(images[inside], states[1:][inside])


def test_rest_is_on_the_lattice_and_a_state_is_moved_by_half_of_it_at_most():
    map = henon(1.4)
    assert on_lattice(map, np.zeros(2)).tolist() == [0.0, 0.0]
    states = np.random.default_rng(2).normal(size=(100, 2))
    assert max(np.abs(on_lattice(map, state) - state).max() for state in states) <= 0.5 * LATTICE_SPACING * 1.0000001
    assert on_lattice(map, on_lattice(map, states[0])).tolist() == on_lattice(map, states[0]).tolist()


def test_vectors_are_carried_along_it():
    map = henon(1.4)
    carried = pseudo_tangent(map, map.initial, np.eye(2), 100)
    np.testing.assert_array_equal(carried.states, pseudo_orbit(map, map.initial, 100).states)
    first = tangent(map, on_lattice(map, map.initial), np.eye(2), PERIODS_PER_PIECE)
    np.testing.assert_array_equal(carried.growth[:PERIODS_PER_PIECE], first.growth)
    assert carried.growth.shape == (100, 2, 2)


def test_an_orbit_that_fails_ends_with_its_status():
    map = logistic(4.1)
    orbit = pseudo_orbit(map, map.initial, 500)
    assert orbit.status == "diverged"
    assert len(orbit.states) < 500


def test_impacts_are_counted_from_its_beginning():
    class Struck:
        def __init__(self, map):
            self.map, self.scale, self.initial = map, map.scale, map.initial

        def orbit(self, state, periods):
            impacts = np.column_stack([np.arange(periods), np.full(periods, 0.5), np.ones(periods)])
            return self.map.orbit(state, periods)._replace(impacts=impacts)

    map = Struck(logistic(3.9))
    assert pseudo_orbit(map, map.initial, 100).impacts[:, 0].tolist() == list(range(100))


def test_the_share_of_contact_is_of_all_periods_however_long_the_pieces():
    class Touching:
        """In contact for the whole of a period that ends above 0.5."""

        def __init__(self, map):
            self.map, self.scale, self.initial = map, map.scale, map.initial

        def orbit(self, state, periods):
            orbit = self.map.orbit(state, periods)
            return orbit._replace(contact=float((orbit.states > 0.5).mean()))

    map, periods = Touching(logistic(3.9)), PERIODS_PER_PIECE + 8
    orbit = pseudo_orbit(map, map.initial, periods)
    touching = orbit.states[:, 0] > 0.5
    assert orbit.contact == pytest.approx(touching.mean(), abs=1e-12)
    assert touching[:PERIODS_PER_PIECE].mean() != pytest.approx(touching[PERIODS_PER_PIECE:].mean(), abs=0.05)


def test_starts_that_differ_by_rounding_have_one_verdict():
    map = logistic(3.7)
    found = [kind_of_orbit(map, np.array([0.3 + noise]), runs=1) for noise in (0.0, 1e-15, -1e-12, 1e-10)]
    assert len({(one.kind, one.exponent, one.zero_one) for one in found}) == 1
