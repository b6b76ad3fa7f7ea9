"""The period maps of the lumped simulators: their derivative, near misses, section phase."""

import numpy as np
import pytest

from calib.dynamics.orbits import shoot
from calib.dynamics.tangent import jacobian
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import excitation, force, restitution
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

SHAKER = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)


def differences(map, state, step):
    """Derivative of the map by central differences of order six, in units of the scale."""
    columns = []
    for unit in np.eye(state.size):
        h = step * map.scale * unit
        terms = [(1, 0.75), (2, -0.15), (3, 1.0 / 60.0)]
        ends = [(map.orbit(state + k * h, 1), map.orbit(state - k * h, 1), c) for k, c in terms]
        assert len({len(orbit.impacts) for a, b, _ in ends for orbit in (a, b)}) == 1, "the stencil crosses a graze"
        columns.append(sum(c * (a.states[0] - b.states[0]) for a, b, c in ends) / (step * map.scale))
    return np.array(columns).T


def shrinking(map, impacts, e):
    """Closed form of the Jacobian's determinant over a period with `impacts` impacts (PHYSICS, section 2)."""
    return e ** (2 * impacts) * np.exp(-2.0 * map.problem.regimes.rate[0].sum() * map.period)


def random_orbits(count):
    """Motions with impacts and without contact phases, well away from a graze."""
    rng = np.random.default_rng(7)
    while count:
        e, gap = rng.uniform(0.05, 0.9), rng.uniform(0.5e-3, 1.5e-3)
        map = Model(FourDof()).period_map({"restitution": e, "gap": gap}, SHAKER, rng.uniform(0.0, 1.0))
        state = map.orbit(rng.normal(size=8) * 0.5 * map.scale, 40).states[-1]
        orbit = map.orbit(state, 1)
        near = min([*orbit.impacts[:, 2] / 0.5, *np.abs(map.near_misses(state)) / 1e-4], default=0.0)
        if orbit.contact == 0.0 and len(orbit.impacts) and near > 0.2 and orbit.impacts[:, 1].max() < 0.99:
            count -= 1
            yield e, map, state, len(orbit.impacts)


def test_multipliers_from_saltation_agree_with_differences_of_the_map_on_20_random_orbits():
    seen = set()
    for e, map, state, impacts in random_orbits(20):
        _, exact = jacobian(map, state)
        expected = np.linalg.eigvals(differences(map, state, 3e-4))
        found = np.linalg.eigvals(exact)
        for multiplier in expected:
            assert np.abs(found - multiplier).min() <= 1e-9 * abs(multiplier)
        assert np.prod(found).real == pytest.approx(shrinking(map, impacts, e), rel=1e-13)
        seen.add(impacts)
    assert len(seen) > 1  # orbits of several patterns


def test_the_tangent_runs_along_the_orbit_bit_for_bit():
    map = Model(FourDof()).period_map({"restitution": 0.5}, SHAKER)
    carried = map.tangent(map.initial, np.ones((8, 1)), 50)
    np.testing.assert_array_equal(carried.states, map.orbit(map.initial, 50).states)


@pytest.mark.parametrize("e", [0.05, 0.2, 0.34])
def test_a_phase_of_contact_wipes_two_directions_out_and_keeps_the_others(e):
    map = Model(FourDof()).period_map({"restitution": e, "gap": 2e-4}, SHAKER)
    state = map.orbit(map.initial, 50).states[-1]
    assert map.orbit(state, 1).contact > 0.05
    after, exact = jacobian(map, state)
    singular = np.linalg.svd(exact)[1]
    assert singular[5] > 1e-3
    assert singular[6] < 1e-12
    step = 1e-4
    ends = [(map.orbit(state + step * map.scale * u, 1), map.orbit(state - step * map.scale * u, 1)) for u in np.eye(8)]
    rough = np.array([(a.states[0] - b.states[0]) / (2 * step * map.scale) for a, b in ends]).T
    np.testing.assert_allclose(exact, rough, atol=1e-4 * np.abs(exact).max())
    np.testing.assert_array_equal(after, map.orbit(state, 1).states[0])


@pytest.mark.parametrize(("drive", "quantity", "place", "amplitude"),
                         [("rigid", "displacement", "end", 1.5e-3), ("centre", "displacement", "centre", 1e-3),
                          ("force", "force", "end", 1.0)])  # fmt: skip
def test_the_derivative_holds_for_every_drive(drive, quantity, place, amplitude):
    excitation = Excitation(place, quantity, frequency=26.24, amplitude=amplitude)
    map = Model(FourDof(drive)).period_map({"restitution": 0.4, "gap": 5e-4}, excitation, 0.1)
    states = map.orbit(map.initial, 60).states
    state = next(x for x in states[20:] if len(map.orbit(x, 1).impacts) and map.orbit(x, 1).contact == 0.0)
    _, exact = jacobian(map, state)
    np.testing.assert_allclose(exact, differences(map, state, 1e-4), atol=3e-6 * np.abs(exact).max())


@restitution
def softer(e, speed, p):
    """Return less rebound the faster the impact is."""
    return -p[0] * speed


@excitation
def harmonic(t, phase, amplitude, x, p):
    """Return a second harmonic of the drive."""
    return p[0] * amplitude * np.cos(2.0 * phase)


@force
def cubic(t, x, v, p, z, dz):
    """Return a hardening spring's force per mass."""
    return -p[0] * x * x * x


@force(states=1)
def lagging(t, x, v, p, z, dz):
    """Return a force that follows the velocity late."""
    dz[0] = (v - z[0]) / p[1]
    return -p[0] * z[0]


def effect(site, law, **parameters):
    listed = tuple(Parameter(name, "1", value, "for the test", null=0.0) for name, value in parameters.items())
    return Effect("extra", site, law, listed, meaning="for the test")


@pytest.mark.parametrize("extra", [effect("restitution", softer, s=0.3), effect("excitation", harmonic, h=0.2)])
def test_laws_of_restitution_and_of_the_excitation_have_their_part_in_the_derivative(extra):
    map = Model(FourDof(), [extra]).period_map({"restitution": 0.6}, SHAKER)
    states = map.orbit(map.initial, 60).states
    state = next(x for x in states[30:] if len(map.orbit(x, 1).impacts) and map.orbit(x, 1).contact == 0.0)
    _, exact = jacobian(map, state)
    np.testing.assert_allclose(exact, differences(map, state, 1e-4), atol=3e-6 * np.abs(exact).max())


def test_force_laws_are_differenced_and_their_inner_states_belong_to_the_state():
    drive = Excitation("mass", "force", frequency=5.0, amplitude=5.0)
    map = Model(Oscillator(), [effect("force", lagging, c=3.0, tau=0.05)]).period_map({}, drive)
    assert map.names == ("mass.displacement", "mass.velocity", "mass.law 1 state 1")
    state = map.orbit(map.initial, 5).states[-1]
    assert state[2] != 0.0
    assert map.tangent(state, np.eye(3), 1) is None
    _, found = jacobian(map, state)  # linear, so the derivative is that of the matrix x' = A x
    a = np.array([[0.0, 1.0, 0.0], [-1000.0, -1.0, -3.0], [0.0, 20.0, -20.0]])
    values, vectors = np.linalg.eig(a * map.period)
    expected = (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real
    np.testing.assert_allclose(found, expected * map.scale / map.scale[:, None], rtol=1e-6, atol=1e-7)


def test_two_calls_in_a_row_give_what_one_gives():
    map = Model(Oscillator(), [effect("force", lagging, c=3.0, tau=0.05)]).period_map(
        {}, Excitation("mass", "force", frequency=5.0, amplitude=5.0)
    )
    whole = map.orbit(map.initial, 7).states
    parts = map.orbit(map.orbit(map.initial, 4).states[-1], 3).states
    np.testing.assert_allclose(parts, whole[4:], rtol=1e-9)


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_the_section_is_the_record_s_motion_at_that_phase(phase):
    model, values = Model(FourDof()), {"restitution": 0.05}
    record = model.run(values, SHAKER, Request(periods=1, samples=1000))
    map = model.period_map(values, SHAKER, phase)
    orbit = map.orbit(map.initial, 300)
    at = record.isel(time=round(1000 * phase))
    np.testing.assert_allclose(orbit.displacement[:, -1], at.displacement.values, rtol=1e-8)
    np.testing.assert_allclose(orbit.velocity[:, -1], at.velocity.values, rtol=1e-7)
    impact = (record.impact_time.values[0] * SHAKER.frequency - phase) % 1.0
    assert orbit.impacts[-1, 1] == pytest.approx(impact, abs=1e-8)
    assert orbit.impacts[-1, 2] == pytest.approx(record.impact_speed.values[0], rel=1e-7)
    assert orbit.impacts[-1, 0] == 299


def test_prescribed_bodies_stand_in_the_section():
    map = Model(FourDof("rigid")).period_map({}, SHAKER, 0.25)
    orbit = map.orbit(map.initial, 3)
    assert map.initial.size == 6
    np.testing.assert_allclose(orbit.displacement[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(orbit.velocity[0], -2.0 * np.pi * 26.24 * 1.5e-3, rtol=1e-12)


@pytest.mark.parametrize(("e", "expected"), [(0.0, 421e-6), (0.05, 328e-6), (0.10, 208e-6), (0.168, 5e-6)])
def test_the_second_minimum_of_the_gap_falls_as_restitution_grows(e, expected):
    map = Model(FourDof()).period_map({"restitution": e}, SHAKER)  # figures of PHYSICS, section 2
    [miss] = map.near_misses(map.orbit(map.initial, 400).states[-1])
    assert miss == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("extra", [{}, {"lag_force": 20.0, "lag": 0.005}])
def test_a_miss_is_the_least_clearance_between_impacts(extra):
    effects = [effect("force", lagging, **dict.fromkeys(extra, 0.0))] if extra else []
    model, values = Model(FourDof(), effects), {"restitution": 0.05, **extra}
    map = model.period_map(values, SHAKER)
    [miss] = map.near_misses(map.orbit(map.initial, 300).states[-1])
    record = model.run(values, SHAKER, Request(periods=1, samples=20_000))
    r = 1e-3 + record.displacement.values[2] - record.displacement.values[1]
    inner = (r[1:-1] < r[:-2]) & (r[1:-1] < r[2:]) & (r[1:-1] > 1e-5)  # not the impact itself
    assert r[1:-1][inner] == pytest.approx([miss], rel=1e-5)


def test_a_stop_that_is_never_touched_has_its_miss_above_zero_and_none_without_a_stop():
    map = Model(FourDof()).period_map({"gap": 10e-3}, SHAKER)
    state = map.orbit(map.initial, 100).states[-1]
    assert not len(map.orbit(state, 1).impacts)
    assert (map.near_misses(state) > 1e-3).all()
    free = Model(Oscillator()).period_map({}, Excitation("mass", "force", frequency=5.0, amplitude=1.0))
    assert not free.impacting
    assert free.near_misses(free.initial).size == 0


def test_chatter_ends_within_its_budget_of_steps():
    drive = Excitation("mass", "force", frequency=1.0, amplitude=0.5)
    values = {"stiffness": 0.0, "damping": 0.0, "load": 9.81, "gap": 0.01}
    for e in (0.3, 0.9, 0.99, 1.0):
        map = Model(Oscillator(stop=True)).period_map({**values, "restitution": e}, drive)
        orbit = map.orbit(map.initial, 20)
        assert orbit.status in ("ok", "step budget")
        if e < 0.99:
            assert orbit.status == "ok"
            assert orbit.contact > 0.1


def test_a_motion_beyond_bounds_is_a_status():
    map = Model(Oscillator()).period_map({"damping": -1.0}, Excitation("mass", "force", frequency=1.0, amplitude=1.0))
    orbit = map.orbit(map.initial, 500)
    assert orbit.status == "diverged"
    assert 0 < len(orbit.states) < 500
    assert len(map.tangent(map.initial, np.eye(2), 500).states) < 500


def test_what_has_no_period_map_says_so():
    recorded = Excitation("end", "displacement", time=np.linspace(0.0, 1.0, 50), value=np.zeros(50))
    with pytest.raises(CalibError, match="harmonic"):
        Model(FourDof()).period_map({}, recorded)
    with pytest.raises(CalibError, match="fixed step"):
        Model(FourDof(mode="fixed_step")).period_map({}, SHAKER)
    with pytest.raises(CalibError, match="prescribed"):
        Model(Oscillator()).period_map({}, Excitation("mass", "displacement", frequency=1.0, amplitude=1.0))
    with pytest.raises(CalibError, match="phase"):
        Model(FourDof()).period_map({}, SHAKER, 1.0)
    with pytest.raises(ValueError, match="restitution is nan"):
        Model(FourDof()).period_map({"restitution": np.nan}, SHAKER)
    with pytest.raises(ValueError, match="mass of 0 kg"):
        Model(Oscillator()).period_map({"mass": 0.0}, Excitation("mass", "force", frequency=1.0, amplitude=1.0))


@pytest.mark.parametrize("phase", [0.0, 0.55, 0.6])
def test_a_state_from_within_a_contact_starts_in_contact(phase):
    map = Model(FourDof()).period_map({"restitution": 0.2, "gap": 2e-4}, SHAKER, phase)
    state = map.orbit(map.initial, 200).states[-1]
    whole, parts = map.orbit(state, 20), []
    for _ in range(20):
        orbit = map.orbit(state, 1)
        parts.append(len(orbit.impacts))
        state = orbit.states[-1]
    assert sum(parts) == len(whole.impacts)
    np.testing.assert_allclose(state / map.scale, whole.states[-1] / map.scale, atol=1e-9)


def test_multipliers_do_not_depend_on_the_section_s_phase_even_through_chatter():
    found = []
    for phase in (0.0, 0.55, 0.6):  # within the contact, too
        map = Model(FourDof()).period_map({"restitution": 0.2, "gap": 2e-4}, SHAKER, phase)
        found.append(np.abs(shoot(map, map.orbit(map.initial, 300).states[-1]).multipliers[0]))
    assert np.ptp(found) < 2e-4 * found[0]
