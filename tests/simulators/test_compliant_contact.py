"""Motions through a compliant contact: against DOP853 with events, their derivative, what acts on them."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.linalg import expm
from simulators.contact_peer import dop853_in_contact
from simulators.four_dof_peer import spring_drive
from simulators.test_period_map import differences

from calib.dynamics.tangent import jacobian
from calib.effects.quadratic_drag import EFFECT as DRAG
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import force, restitution
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records import MIN_SECTION_PERIODS
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.impact.contact_laws import contact_law
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.problem import COMPRESSION, FREE, PARTED, REGIME
from calib.simulators.oscillator import Oscillator
from calib.testing import SimulatorSuite

LAWS = ("kelvin_voigt", "hunt_crossley", "lankarani_nikravesh")
pytestmark = pytest.mark.slow  # the kernel is compiled for them; a sample runs uncompiled in `test_uncompiled_contact`
PERIOD = 1.0 / 26.24  # s
NORMAL, HIT = np.array([0.0, -1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0, 0.0])
SHAKER = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
PUSH = Excitation("mass", "force", frequency=5.0, amplitude=3.0)
TOUCHING = {"kelvin_voigt": {"restitution": 0.5}, "hunt_crossley": {"hunt_crossley": 2.0},
            "lankarani_nikravesh": {"restitution": 0.5}}  # fmt: skip


def drawn(contact, seed):
    """Values of four_dof in a random compliant contact; every other one has exponent 1, every fourth 1.5."""
    rng = np.random.default_rng(seed)
    return {
        **Model(FourDof(contact=contact)).nominal,
        "gap": rng.uniform(5e-4, 1.2e-3),
        "damping": 10 ** rng.uniform(-3.0, -1.5),
        "layer_stiffness": rng.uniform(0.6, 1.5),
        "contact_time": PERIOD * 10 ** rng.uniform(-2.5, -1.2),
        "contact_exponent": (1.5 if seed % 4 else rng.uniform(1.0, 1.5)) if seed % 2 == 0 else 1.0,
        **({"hunt_crossley": 10 ** rng.uniform(-1.0, 1.0)} if contact == "hunt_crossley" else
           {"restitution": rng.uniform(0.05, 0.95)}),
    }  # fmt: skip


@pytest.mark.parametrize("contact", [*LAWS, "gonthier"])
@pytest.mark.parametrize("seed", range(20))
def test_the_motion_agrees_with_dop853(contact, seed):
    values, periods = drawn(contact, seed), 2
    mass, stiffness, damping, load = spring_drive(values, 1.5e-3)
    inverse, pull, omega = np.linalg.inv(mass), np.array([load, 0.0, 0.0, 0.0]), 2.0 * np.pi * 26.24

    def acceleration(t, q, dq):
        return inverse @ (pull * np.cos(omega * t) - stiffness @ q - damping @ dq)

    law = contact_law(contact, values)
    peer = dop853_in_contact(
        acceleration, NORMAL, HIT, values["gap"], law, np.zeros(8), periods * PERIOD, values["contact_time"] / 10.0
    )
    map = Model(FourDof(contact=contact)).period_map(values, SHAKER)
    orbit = map.orbit(map.initial, periods)
    assert len(orbit.impacts) == len(peer.times) >= 2
    np.testing.assert_allclose(orbit.impacts[:, :2].sum(axis=1), peer.times / PERIOD, rtol=0, atol=1e-9)
    np.testing.assert_allclose(orbit.impacts[:, 2], peer.speeds, rtol=0, atol=1e-9 * peer.speeds.max())
    scale = np.repeat([np.abs(peer.state[:4]).max(), np.abs(peer.state[4:]).max()], 4)
    np.testing.assert_allclose(orbit.states[-1, :8] / scale, peer.state / scale, rtol=0, atol=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.5])
def test_parted_bodies_meet_anew_before_they_have_separated(exponent):
    """A damper that loses nearly all holds the mass back in the dent, and a growing force presses it in again."""
    values = {"damping": 0.0, "stiffness": 0.0, "gap": 0.0, "restitution": 0.02, "contact_time": 2e-2,
              "contact_exponent": exponent}  # fmt: skip
    drive = Excitation("mass", "force", frequency=20.0, amplitude=8.0, phase=3.4)
    law = contact_law("kelvin_voigt", values)
    begin = np.array([-1e-3, 0.3])
    peer = dop853_in_contact(
        lambda t, q, dq: 8.0 * np.cos(40.0 * np.pi * t + np.array([3.4])),
        np.array([-1.0]), np.array([-1.0]), 0.0, law, begin, 0.1, 1e-3,
    )  # fmt: skip
    map = Model(Oscillator(stop=True, contact="kelvin_voigt")).period_map(values, drive)
    orbit = map.orbit(begin, 2)
    assert peer.renewals == 1
    assert len(orbit.impacts) == len(peer.times)  # a renewed contact is none
    np.testing.assert_allclose(orbit.states[-1], peer.state, rtol=1e-9)


def random_orbits(contact, count, seed=11):
    """Motions with impacts, well away from a graze, of four_dof in random compliant contacts."""
    rng = np.random.default_rng(seed)
    while count:
        values = drawn(contact, int(rng.integers(1000)))
        map = Model(FourDof(contact=contact)).period_map(values, SHAKER, rng.uniform(0.0, 1.0))
        state = map.orbit(map.initial, 30).states[-1]
        orbit = map.orbit(state, 1)
        near = min([*orbit.impacts[:, 2] / 0.5, *np.abs(map.near_misses(state)) / 1e-4], default=0.0)
        edges = min([*orbit.impacts[:, 1], *(1.0 - orbit.impacts[:, 1])], default=0.0)  # of the section
        if len(orbit.impacts) and near > 0.2 and edges > 0.02:
            count -= 1
            yield map, state


@pytest.mark.parametrize("contact", LAWS)
def test_multipliers_agree_with_differences_of_the_map(contact):
    for map, state in random_orbits(contact, count=12):
        after, exact = jacobian(map, state)
        np.testing.assert_array_equal(after, map.orbit(state, 1).states[0])
        expected, found = np.linalg.eigvals(differences(map, state, 1e-4)), np.linalg.eigvals(exact)
        for multiplier in expected:
            assert np.abs(found - multiplier).min() <= 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("contact", LAWS)
def test_a_section_within_the_contact_splits_the_motion_and_not_its_derivative(contact):
    values = {"damping": 1.0, "gap": 1e-3, "contact_time": 0.04, **TOUCHING[contact]}
    model, found = Model(Oscillator(stop=True, contact=contact)), []
    for phase in (0.0, 0.4, 0.6):
        map = model.period_map(values, PUSH, phase)
        state = map.orbit(map.initial, 200).states[-1]
        within = start(map.problem, state[:1], state[1:2]).counters[REGIME] != FREE
        whole, parts = map.orbit(state, 6), []
        for _ in range(6):
            parts.append(map.orbit(state, 1))
            state = parts[-1].states[-1]
        assert sum(len(part.impacts) for part in parts) == len(whole.impacts)
        np.testing.assert_allclose(state / map.scale, whole.states[-1] / map.scale, rtol=0, atol=1e-11)
        _, derivative = jacobian(map, state)
        np.testing.assert_allclose(
            derivative, differences(map, state, 1e-4), rtol=0, atol=1e-7 * np.abs(derivative).max()
        )
        found.append((within, np.sort(np.abs(np.linalg.eigvals(derivative)))[-2:]))
    assert {within for within, _ in found} == {False, True}
    for _, multipliers in found:
        np.testing.assert_allclose(multipliers, found[0][1], rtol=1e-6)


@pytest.mark.parametrize("share", [1e-4, 1e-8, 1e-11])
@pytest.mark.parametrize("contact", LAWS)
def test_a_graze_is_judged_by_its_depth_however_short_it_is(contact, share):
    """The clearance of an undamped oscillator dips to -share or +share of its amplitude for a moment."""
    for depth, hits in ((share, 1), (-share, 0)):
        values = {"damping": 0.0, "gap": 1e-3 * (1.0 - depth), "contact_time": 1e-2, "contact_exponent": 1.0,
                  "initial_displacement": -1e-3, **TOUCHING[contact]}  # fmt: skip
        record = Model(Oscillator(stop=True, contact=contact)).run(
            values, Excitation("mass", "free decay"), Request(times=np.linspace(0.0, 0.15, 16))
        )
        assert record.attrs["status"] == "ok"
        assert record.impact_time.size == hits


@pytest.mark.parametrize("contact", LAWS)
def test_energy_never_grows_without_excitation(contact):
    values = {"damping": 0.2, "gap": 2e-3, "initial_velocity": 0.5, "contact_time": 5e-3, **TOUCHING[contact]}
    simulator = Oscillator(stop=True, contact=contact)
    record = Model(simulator).run(values, Excitation("mass", "free decay"), Request(times=np.linspace(0.0, 1.0, 4001)))
    x, v = record.displacement.values[0], record.velocity.values[0]
    law = contact_law(contact, Model(simulator).nominal | values)
    depth = np.maximum(0.0, x - 2e-3)
    held = law.stiffness * depth ** (law.exponent + 1.0) / (law.exponent + 1.0)
    if contact == "kelvin_voigt":  # what the dent holds after the force is gone is lost
        held *= law.stiffness * depth + law.damping * v > 0.0
    energy = 0.5 * v**2 + 0.5 * 1000.0 * x**2 + held
    assert (np.diff(energy) <= 1e-11 * energy[0]).all()
    assert x.max() > 2.2e-3


def test_a_mass_that_has_bounced_out_rests_in_its_dent():
    values = {"damping": 0.0, "stiffness": 0.0, "load": 9.81, "gap": 0.05, "restitution": 0.5, "contact_time": 5e-3,
              "contact_exponent": 1.0}  # fmt: skip
    map = Model(Oscillator(stop=True, contact="kelvin_voigt")).period_map(
        values, Excitation("mass", "force", frequency=1.0, amplitude=0.0)
    )
    orbit = map.orbit(map.initial, 8)
    resting = map.orbit(orbit.states[-1], 1)
    assert resting.contact == 1.0
    assert not len(resting.impacts)
    np.testing.assert_allclose(resting.states[-1], [0.05 + 9.81 * (5e-3 / np.pi) ** 2, 0.0], rtol=0, atol=1e-12)
    law = contact_law("kelvin_voigt", values)
    expected = expm(np.array([[0.0, 1.0], [-law.stiffness, -law.damping]]))
    _, found = jacobian(map, resting.states[-1])
    np.testing.assert_allclose(found, expected * map.scale / map.scale[:, None], rtol=0, atol=1e-12)


def test_a_start_beyond_the_surface_is_pressed_or_parted_as_its_force_is():
    simulator = Oscillator(stop=True, contact="kelvin_voigt")
    map = Model(simulator).period_map({"gap": 1e-3, "restitution": 0.1}, PUSH)
    for rate, regime in ((0.1, COMPRESSION), (-10.0, PARTED)):
        assert start(map.problem, np.array([1.001e-3]), np.array([rate])).counters[REGIME] == regime


@pytest.mark.parametrize("contact", LAWS)
def test_a_record_goes_on_from_its_state(contact):
    values = {"contact_time": 2e-3, **TOUCHING[contact]}
    model = Model(FourDof(contact=contact))
    first = model.run(values, SHAKER, Request(periods=2, samples=100, settle=20))
    after = model.run(values, SHAKER, Request(periods=2, samples=100, settle=0, initial_state=first.state.values))
    longer = model.run(values, SHAKER, Request(periods=2, samples=100, settle=MIN_SECTION_PERIODS))
    np.testing.assert_allclose(after.velocity[:, :200], longer.velocity[:, :200], rtol=0, atol=1e-8)
    assert 0.0 < first.attrs["contact_fraction"] < 0.3


def test_shooting_finds_the_motion_that_waiting_finds():
    values = {"contact_time": 1e-3, "restitution": 0.05}
    model, plain = Model(FourDof(contact="kelvin_voigt")), Request(periods=2, samples=100)
    before = model.run({**values, "damping": 0.0044}, SHAKER, plain)
    near = Request(periods=2, samples=100, initial_state=before.state.values, near=True)
    waited, shot = (model.run(values, SHAKER, request) for request in (plain, near))
    assert shot.attrs["settled_periods"] == 0 < waited.attrs["settled_periods"]
    np.testing.assert_allclose(shot.displacement, waited.displacement, rtol=0, atol=1e-8 * 1e-2)


def test_a_miss_is_the_least_clearance_between_impacts():
    model, values = Model(FourDof(contact="kelvin_voigt")), {"restitution": 0.05, "contact_time": 1e-3}
    map = model.period_map(values, SHAKER)
    [miss] = map.near_misses(map.orbit(map.initial, 300).states[-1])
    record = model.run(values, SHAKER, Request(periods=1, samples=20_000))
    r = 1e-3 + record.displacement.values[2] - record.displacement.values[1]
    inner = (r[1:-1] < r[:-2]) & (r[1:-1] < r[2:]) & (r[1:-1] > 0.0)
    assert r[1:-1][inner] == pytest.approx([miss], rel=1e-5)
    assert r.min() < -1e-5


@pytest.mark.parametrize(("contact", "exponent"), [("kelvin_voigt", 1.0), ("hunt_crossley", 1.4)])
def test_finer_numerics_give_the_same_motion(contact, exponent):
    values = {**TOUCHING[contact], "contact_exponent": exponent}
    simulator, request = FourDof(contact=contact), Request(periods=2, samples=50, settle=3)
    own, *finer = (
        Model(each).run(values, SHAKER, request)
        for each in (simulator, simulator.finer("time_step", 4.0), simulator.finer("event_tolerance", 100.0))
    )
    assert not finer[0].displacement.identical(own.displacement)
    for record in finer:
        np.testing.assert_allclose(record.displacement, own.displacement, rtol=0, atol=1e-12)


# what acts on it


@force
def viscous(t, x, v, p, z, dz):
    """Return a damper's force per mass."""
    return -p[0] * v


@force(states=1)
def late(t, x, v, p, z, dz):
    """Return a force that follows the velocity late."""
    dz[0] = (v - z[0]) / p[1]
    return -p[0] * z[0]


@restitution
def livelier(e, speed, p):
    """Return a change of the restitution."""
    return p[0]


def effect(law, place, site="force", **parameters):
    listed = tuple(Parameter(name, "1", 0.0, "for the test", null=0.0) for name in parameters)
    return Effect("extra", site, law, listed, meaning="for the test", place=place)


@pytest.mark.parametrize("place", ["body", "interface"])
@pytest.mark.parametrize("contact", LAWS)
def test_force_laws_act_in_the_contact_as_out_of_it(contact, place):
    """A damper by a law, on the mass or across the clearance, is one of the oscillator's own."""
    values = {"damping": 1.0, "gap": 1e-3, "contact_time": 1e-2, **TOUCHING[contact]}
    simulator, request = Oscillator(stop=True, contact=contact), Request(periods=3, samples=100, settle=0)
    law = Model(simulator, [effect(viscous, place, c=4.0)]).run({**values, "c": 4.0}, PUSH, request)
    own = Model(simulator).run({**values, "damping": 5.0}, PUSH, request)
    assert law.impact_time.size == own.impact_time.size >= 2
    np.testing.assert_allclose(law.displacement, own.displacement, rtol=0, atol=1e-10)
    np.testing.assert_allclose(law.velocity, own.velocity, rtol=0, atol=1e-7)  # of lower order within a step


@pytest.mark.parametrize(
    ("contact", "loss"), [("kelvin_voigt", {"restitution": 0.5}), ("hunt_crossley", {"hunt_crossley": 20.0})]
)
def test_long_runs_with_force_laws_come_to_their_end(contact, loss):
    """Impacts of all depths: some lose nearly all in a moment, some end where rounding has the force at zero."""
    values = {**loss, "contact_time": 0.02 / 26.24, "contact_exponent": 1.0, "c2": 1.0}
    model = Model(FourDof(contact=contact), [DRAG])
    record = model.run(values, SHAKER, Request(periods=300, samples=1, settle=0, step_budget=200_000))
    assert record.attrs["status"] == "ok", record.attrs["reason"]


def test_internal_states_of_force_laws_go_on_through_the_contact():
    values = {"damping": 1.0, "gap": 1e-3, "contact_time": 2e-2, "restitution": 0.5, "c": 3.0, "tau": 0.01}
    map = Model(
        Oscillator(stop=True, contact="lankarani_nikravesh"), [effect(late, "body", c=3.0, tau=0.01)]
    ).period_map(values, PUSH)
    assert map.names[2:] == ("mass.law 1 state 1", "interface.closing speed")
    whole = map.orbit(map.initial, 5)
    parts = map.orbit(map.orbit(map.initial, 2).states[-1], 3)
    np.testing.assert_allclose(parts.states / map.scale, whole.states[2:] / map.scale, rtol=0, atol=1e-9)
    assert map.tangent(map.initial, np.eye(4), 1) is None


def test_effects_of_restitution_are_refused():
    probe = effect(livelier, "body", site="restitution", more=0.1)
    with pytest.raises(CalibError, match="acts at 'restitution', but simulator 'four_dof' takes laws at"):
        Model(FourDof(contact="kelvin_voigt"), [probe]).run({"more": 0.1}, SHAKER)


# contract


class TestConformanceOfKelvinVoigt(SimulatorSuite):
    excitation = SHAKER
    values = {"restitution": 0.05, "contact_time": 1e-3}

    def make(self):
        return FourDof(contact="kelvin_voigt")


class TestConformanceOfHuntCrossley(SimulatorSuite):
    excitation = Excitation("mass", "force", frequency=4.0, amplitude=1.0)
    values = {"damping": 3.0, "gap": 1e-3, "hunt_crossley": 1.0, "contact_time": 5e-3}

    def make(self):
        return Oscillator(stop=True, contact="hunt_crossley")


class TestConformanceOfLankaraniNikravesh(TestConformanceOfHuntCrossley):
    values = {"damping": 3.0, "gap": 1e-3, "restitution": 0.4, "contact_time": 2e-2}

    def make(self):
        return Oscillator(stop=True, contact="lankarani_nikravesh")


def test_it_runs_without_the_compiler():
    code = (
        "from calib.simulators.four_dof import FourDof; from calib.modelling.model import Model;"
        "from calib.modelling.simulator import Request; from calib.records.excitation import Excitation;"
        "x = Excitation('end', 'displacement', frequency=26.24, amplitude=1.5e-3);"
        "values = {'restitution': 0.3, 'contact_time': 1e-3, 'contact_exponent': 1.2};"
        "r = Model(FourDof(contact='kelvin_voigt')).run(values, x, Request(settle=1, periods=1, samples=20));"
        "print(r.impact_time.values.tolist())"
    )
    times = [
        eval(subprocess.run([sys.executable, "-c", code], env={**os.environ, "NUMBA_DISABLE_JIT": jit},
                            capture_output=True, text=True, check=True, timeout=300).stdout)
        for jit in "01"
    ]  # fmt: skip
    assert len(times[0]) > 0
    np.testing.assert_allclose(times[0], times[1], rtol=1e-12)
