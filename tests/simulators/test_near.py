"""The short way to the stationary motion from a state near it."""

import numpy as np
import pytest

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.plugins import load
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.impact import kernel
from calib.simulators.impact.problem import STEPS
from calib.simulators.oscillator import Oscillator


@force(states=1)
def memory(t, x, v, p, z, dz):
    """Follow the velocity with a delay, and push back."""
    dz[0] = 50.0 * (v - z[0])
    return -p[0] * z[0]


PUSH = Parameter("memory", "1/s", 0.0, "of the push", null=0.0)
MEMORY = Effect("memory", "force", memory, (PUSH,), "a delayed drag")
HESITATION = Parameter("hesitation", "1/s", 0.0, "of the push", null=0.0)
HESITATING = Effect("hesitation", "force", memory, (HESITATION,), "a delayed drag of its own")
DRIVES = {
    "four_dof": (FourDof(), Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3), {"restitution": 0.1}),
    "oscillator": (
        Oscillator(stop=True), Excitation("mass", "force", frequency=5.0, amplitude=1.0),
        {"gap": 1e-3, "restitution": 0.3, "damping": 2.0},
    ),
}  # fmt: skip


def both_ways(name, values, **changed):
    """Records of the settled motion, by waiting and by shooting from the motion at other `values`."""
    simulator, drive, own = DRIVES[name]
    model = Model(simulator, [MEMORY])
    plain = Request(periods=2, samples=100)
    before = model.run(own | values, drive, plain)
    near = Request(periods=2, samples=100, initial_state=before.state.values, near=True)
    return [model.run(own | values | changed, drive, request) for request in (plain, near)]


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("memory", [0.0, 0.3])
def test_shooting_finds_the_motion_that_waiting_finds(name, memory):
    waited, near = both_ways(name, {"memory": memory}, damping=1.1 * (DRIVES[name][2].get("damping") or 0.004))
    for channel in ("displacement", "velocity"):
        error = np.abs(near[channel] - waited[channel]).max() / np.abs(waited[channel]).max()
        assert error < 1e-8
    assert near.attrs.get("settled_periods") == 0 < waited.attrs["settled_periods"]
    assert near.sizes["period"] == 2


def test_a_motion_of_another_period_is_waited_for():
    waited, near = both_ways("four_dof", {"memory": 0.0, "restitution": 0.2}, restitution=0.201)
    assert near.attrs["settled_periods"] > 0
    np.testing.assert_allclose(near.displacement, waited.displacement, atol=1e-9)


def test_a_record_goes_on_from_its_state():
    simulator, drive, own = DRIVES["four_dof"]
    model = Model(simulator, [MEMORY])
    first = model.run(own | {"memory": 0.3}, drive, Request(periods=2, samples=100))
    after = Request(periods=2, samples=100, settle=0, initial_state=first.state.values)
    np.testing.assert_allclose(model.run(own | {"memory": 0.3}, drive, after).velocity, first.velocity, atol=1e-9)


@pytest.mark.parametrize("laws", [[MEMORY, HESITATING], [MEMORY]])
def test_a_record_goes_on_where_a_law_with_a_state_is_added_or_left_out(laws):
    """What the two laws remember is handed on to one, and what one does to two: the first goes on from its state."""
    simulator, drive, own = DRIVES["four_dof"]
    before = [effect for effect in (MEMORY, HESITATING) if effect is MEMORY or effect not in laws]
    values = own | {"memory": 0.3}
    first = Model(simulator, before).run(
        values | ({"hesitation": 1e-12} if HESITATING in before else {}), drive, Request(periods=2, samples=100)
    )
    after = Request(periods=2, samples=100, settle=0, initial_state=first.state.values)
    on = Model(simulator, laws).run(values | ({"hesitation": 1e-12} if HESITATING in laws else {}), drive, after)
    np.testing.assert_allclose(on.velocity, first.velocity, atol=1e-9)


def test_the_step_budget_holds_for_all_periods_that_shooting_takes(monkeypatch):
    """Friction that sticks within a nanometre takes thousands of steps in every period."""
    model = Model(DRIVES["oscillator"][0], [load("calib.effects", "presliding")])
    values = DRIVES["oscillator"][2] | {"dahl_force": 0.5, "dahl_distance": 1e-9}
    drive, budget, steps = DRIVES["oscillator"][1], 5_000, []
    before = model.run(values | {"dahl_distance": 1e-4}, drive, Request(periods=2, samples=100))

    def counted(problem, state, *rest):
        begun = int(state.counters[STEPS])
        code = advance(problem, state, *rest)
        steps.append(int(state.counters[STEPS]) - begun)
        return code

    advance = kernel.advance
    monkeypatch.setattr(kernel, "advance", counted)
    near = Request(periods=2, samples=100, initial_state=before.state.values, near=True, step_budget=budget)
    assert model.run(values, drive, near).attrs["status"] == "step budget"
    assert budget < sum(steps) < 2.2 * budget  # shooting, then waiting
