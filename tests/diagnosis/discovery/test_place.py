"""Places of missing forces: what a force law sees there, from the displacements and velocities of bodies."""

import numpy as np
import pytest

from calib.diagnosis.discovery.place import force_places
from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator


@force
def linear(t, x, v, p, z, dz):
    """Return the force per unit mass [m/s^2] of a spring and a damper, less what the spring has at rest."""
    return -p[0] * (x - p[1]) - p[2] * v


def motion(place, rest, spring=100.0):
    """Displacement of an oscillator that does not reach its stop, with a linear law at a place."""
    parameters = (
        Parameter("spring", "1/s^2", 0.0, "over mass", null=0.0),
        Parameter("rest", "m", 0.0, "at which it is free"),
        Parameter("damper", "1/s", 0.0, "over mass", null=0.0),
    )
    law = Effect("linear", "force", linear, parameters, "stiffer", bodies=(place,))
    simulator, drive = Oscillator(stop=True), Excitation("mass", "force", frequency=5.0, amplitude=1.0)
    values = {p.name: p.nominal for p in simulator.parameters} | {"gap": 1.0, "rest": rest}
    run = Model(simulator, [law]).run({**values, "spring": spring, "damper": 0.02 * spring}, drive, Request(samples=40))
    return run.displacement.values[0]


def test_a_law_at_the_interface_of_the_oscillator_sees_the_distance_to_the_stop():
    body, stop = force_places(Oscillator(stop=True))
    assert (body.name, body.preposition, stop.name, stop.preposition) == ("mass", "on", "interface", "at the")
    x, v = stop.states(np.array([[0.25], [3.0]]), {"gap": 1.0})
    assert (x, v) == (pytest.approx(0.75), pytest.approx(-3.0))
    on_body, at_stop = motion("mass", 0.0), motion("interface", 1.0)  # one spring, by x and by 1 - x
    assert at_stop == pytest.approx(on_body, rel=1e-6, abs=1e-9)
    assert np.abs(on_body - motion("mass", 0.0, 0.0)).max() > 0.05 * np.abs(on_body).max()


def test_a_simulator_without_a_stop_has_bodies_only():
    assert [place.name for place in force_places(Oscillator())] == ["mass"]


def test_the_clearance_of_two_bodies_is_the_gap_and_their_distance():
    layer, interface = force_places(FourDof())
    assert (layer.name, interface.name) == ("q3", "interface")
    assert interface.rows[:2] == (("q3", "displacement"), ("q2", "displacement"))
    rows = np.array([[3.0], [1.0], [30.0], [10.0]])
    assert interface.states(rows, {"gap": 0.5}).ravel().tolist() == [2.5, 20.0]
    assert interface.states(rows, {}).ravel().tolist() == [2.0 + 1e-3, 20.0]
