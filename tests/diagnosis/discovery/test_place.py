"""Places of missing forces: what a force law sees there."""

import numpy as np
import pytest

from calib.diagnosis.bench import Bench
from calib.diagnosis.discovery.place import force_places, visited_regions
from calib.diagnosis.evidence import pairs_compared
from calib.effects.quadratic_stiffness import EFFECT as QUADRATIC_STIFFNESS
from calib.execution.pool import InProcess
from calib.features.frequency_response import ResponseDistance
from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term
from calib.records.excitation import Excitation
from calib.records.response import make_response
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


def swept(place, *effects, values=()):
    """Region of an oscillator under two levels of a stepped force, and that which it sees in measured amplitudes."""
    points = np.tile(np.linspace(2.7, 3.7, 5), 2)
    record = make_response(
        points, ["mass"], np.full((1, 10), 0.02 - 0.01j), np.repeat([0.2, 0.4], 5), "N", np.repeat([0, 1], 5), 1.0
    )
    excitation = Excitation("mass", "force", frequency=3.0, amplitude=1.0)
    objective = Objective({"a": Reference("a", record, excitation=excitation)}, [Term(ResponseDistance())])
    model = Model(Oscillator(), effects)
    bench = Bench(model, objective, pairs_compared(objective))
    known = {"mass": 1.0, "stiffness": 400.0, "damping": 2.0, **dict(values)}
    with InProcess(bench) as pool:
        return visited_regions(pool, bench, objective.references, known, [place])[place.name]


def test_a_response_visits_the_ellipses_of_its_first_harmonics():
    [body] = force_places(Oscillator())
    region = swept(body)
    amplitude = abs(0.02 - 0.01j)
    assert region.half_wave_symmetric
    assert region.ends["displacement"] == pytest.approx((-amplitude, amplitude), rel=0.01)
    fastest = 2.0 * np.pi * 3.7 * amplitude
    assert region.ends["velocity"] == pytest.approx((-fastest, fastest), rel=0.01)


def test_motions_of_a_spring_that_is_not_odd_are_not_symmetric():
    [body] = force_places(Oscillator())
    assert not swept(body, QUADRATIC_STIFFNESS, values={"k2": 2e3}.items()).half_wave_symmetric
