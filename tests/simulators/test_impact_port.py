"""Force laws at the port between the two bodies that meet."""

import numpy as np
import pytest

from calib.dynamics.tangent import jacobian
from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.four_dof.lumped import lumped
from calib.simulators.oscillator import Oscillator

DRIVE = Excitation("mass", "force", frequency=5.0, amplitude=3.0)
OWN = {"restitution": 0.6, "gap": 1e-3}


@force
def cushion(t, x, v, p, z, dz):
    """Return a damper's force per mass across the clearance."""
    return -p[0] * v


@force(states=1)
def late(t, x, v, p, z, dz):
    """Return a damper's force that comes late."""
    dz[0] = (v - z[0]) / p[1]
    return -p[0] * z[0]


def effect(law, **parameters):
    listed = tuple(Parameter(name, "1", 0.0, "for the test", null=0.0) for name in parameters)
    return Effect("extra", "force", law, listed, meaning="for the test", place="interface")


CUSHION = effect(cushion, c=4.0)


def test_a_damper_at_the_port_of_an_oscillator_is_one_on_its_mass():
    request = Request(periods=3, samples=100, settle=0)
    port = Model(Oscillator(stop=True), [CUSHION]).run({**OWN, "c": 4.0}, DRIVE, request)
    own = Model(Oscillator(stop=True)).run({**OWN, "damping": 5.0}, DRIVE, request)
    assert port.impact_time.size == own.impact_time.size > 3
    np.testing.assert_allclose(port.displacement, own.displacement, rtol=0, atol=1e-12)


def test_the_derivative_of_a_map_with_a_law_at_the_port_is_that_of_the_same_motion_in_closed_form():
    port = Model(Oscillator(stop=True), [CUSHION]).period_map({**OWN, "c": 4.0}, DRIVE)
    own = Model(Oscillator(stop=True)).period_map({**OWN, "damping": 5.0}, DRIVE)
    state = own.orbit(own.initial, 8).states[-1]
    assert port.tangent(state, np.eye(2), 1) is None
    found, expected = (jacobian(map, state)[1] for map in (port, own))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_inner_states_at_the_port_belong_to_the_state_of_the_map():
    model = Model(Oscillator(stop=True), [effect(late, c=4.0, tau=0.01)])
    map = model.period_map({**OWN, "c": 4.0, "tau": 0.01}, DRIVE)
    assert map.names[2:] == ("interface.law 1 state 1",)
    assert map.orbit(map.initial, 3).states[-1, 2] != 0.0


@pytest.mark.parametrize("drive", ["spring", "centre"])
def test_the_two_sides_push_one_another(drive):
    """What the layer gains the beam loses, where it is free to move."""
    simulator = FourDof(drive)
    values = {p.name: p.nominal for p in simulator.parameters}
    place = "centre" if drive == "centre" else "end"
    excitation = Excitation(place, "displacement", frequency=26.24, amplitude=1e-3)
    push = simulator.problem(values, excitation).push
    mass = np.diag(lumped(values).mass)
    if drive == "centre":
        np.testing.assert_allclose(push, [0.0, 1.0, 0.0])
    else:
        np.testing.assert_allclose(push, [0.0, -mass[2] / mass[1], 1.0, 0.0])


def test_a_law_on_all_bodies_does_not_act_at_the_port():
    simulator = FourDof()
    values = {p.name: p.nominal for p in simulator.parameters}
    excitation = Excitation("end", "displacement", frequency=26.24, amplitude=1e-3)
    everywhere = CUSHION.bound({"c": 1.0}, {"interface": None})
    at_port = CUSHION.bound({"c": 1.0}, simulator.places)
    acts = simulator.problem(values, excitation, [everywhere, at_port]).acts
    np.testing.assert_array_equal(acts[:2], [[True] * 4 + [False], [False] * 4 + [True]])
