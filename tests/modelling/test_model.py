"""A simulator with effects is a model."""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.effects import channel_lag, gap_offset, quadratic_drag
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import force, gap, numerical, stop, structure
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import MappedSimulator, RefinableSimulator, Request, Simulator, StoppedSimulator
from calib.records import record
from calib.records.excitation import Excitation

DRIVE = Excitation("end", "displacement", frequency=25.0, amplitude=1e-3)


class Still:
    """Gives a fixed sine, and remembers which laws it was handed."""

    name = "still"
    bodies = ("q2", "q3")
    parameters = (Parameter("gap", "m", 1e-3, "width of the gap"),)
    sites = frozenset({"force", "gap"})

    def run(self, values, excitation, laws, request):
        self.handed = laws
        t = np.arange(request.periods * request.samples) / request.samples / excitation.frequency
        x = np.sin(2 * np.pi * excitation.frequency * t) * np.ones((2, 1))
        return record.make(t, self.bodies, {"displacement": x, "velocity": x}, frequency=excitation.frequency)


def test_an_effect_at_null_is_dropped_before_the_run():
    model = Model(Still(), [gap_offset.EFFECT])
    model.run({}, DRIVE)
    assert model.simulator.handed == ()
    model.run({"dg": 1e-4}, DRIVE)
    assert [law.site for law in model.simulator.handed] == ["gap"]


def test_extending_leaves_the_model_as_it_was():
    model = Model(Still())
    longer = model.extended(gap_offset.EFFECT, quadratic_drag.EFFECT)
    assert (list(model.parameters), list(longer.parameters)) == (["gap"], ["gap", "dg", "c2"])
    assert longer.name == "still + gap_offset + quadratic_drag"


def test_a_sensor_law_acts_on_the_record_and_not_in_the_simulator():
    model = Model(Still(), [channel_lag.EFFECT])
    seen = model.run({"lag": 0.01}, DRIVE, Request(periods=2, samples=100))
    assert model.simulator.handed == ()
    assert seen.velocity.values[0] == pytest.approx(np.roll(seen.displacement.values[0], 25), abs=1e-12)


def test_an_unknown_parameter_is_answered_with_the_nearest():
    with pytest.raises(CalibError, match="did you mean 'gap'"):
        Model(Still()).run({"gab": 1.0}, DRIVE)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (replace(gap_offset.EFFECT, bodies=("q9",)), "acts on body 'q9'"),
        (replace(gap_offset.EFFECT, parameters=(Parameter("gap", "m", 0.0, "", null=0.0),)), "the model has already"),
    ],
)
def test_an_effect_that_does_not_fit_is_refused(effect, said):
    with pytest.raises(CalibError, match=said):
        Model(Still(), [effect])


def test_a_site_that_the_simulator_lacks_is_refused():
    simulator = Still()
    simulator.sites = frozenset({"force"})
    with pytest.raises(CalibError, match="takes laws at \\['force'\\]"):
        Model(simulator, [gap_offset.EFFECT])


def test_a_law_stays_the_same_through_a_pickle():
    law = pickle.loads(pickle.dumps(gap_offset.EFFECT)).law
    assert law is gap_offset.offset


def test_an_effect_that_says_no_group_is_listed_by_its_site_and_an_unknown_group_is_refused():
    assert (gap_offset.EFFECT.group, channel_lag.EFFECT.group) == ("contact", "instrument")
    with pytest.raises(CalibError, match="groups are stiffness, damping"):
        replace(gap_offset.EFFECT, group="gaps")


def test_an_effect_needs_a_null():
    with pytest.raises(CalibError, match="no null"):
        Effect("x", "gap", gap(lambda place, p: p[0]), (Parameter("a", "m", 0.0, ""),), meaning="")


@structure
def swapped(present, p):
    """Return two values with a share of each moved to the other."""
    return present[0] - p["moved"], present[1] + p["moved"]


@numerical
def finer(simulator, p):
    """Return the simulator with a finer step."""
    return simulator.finer("time_step", p["refinement"])


@force
def borrowing(t, x, v, p, z, dz):
    """Return the second number, which is the simulator's."""
    return p[0] * p[1]


MOVED = Effect(
    "moved", "structure", swapped, (Parameter("moved", "m", 0.0, "", null=0.0),), meaning="for the test",
    changes=(("g_max", "s"), ("gap", "s")),
)  # fmt: skip
FINER = Effect(
    "finer", "numerical", finer, (Parameter("refinement", "1", 1.0, "", null=1.0),), "", changes=(("time_step",),)
)
BORROWING = Effect(
    "borrowing", "force", borrowing, (Parameter("size", "1", 0.0, "", null=0.0),), meaning="for the test",
    place="interface", borrowed=("gap",),
)  # fmt: skip


@stop
def softened(simulator, p):
    """Return the simulator with a soft stop."""
    return simulator.compliant("soft")


SOFTENED = Effect(
    "softened", "stop", softened, (Parameter("softness", "1", 0.0, "", null=0.0),), "", changes=(("soft",),)
)


class Placed(Still):
    """Has places, a second parameter, and a step that can be refined."""

    parameters = (*Still.parameters, Parameter("s", "m", 0.0, "shift"))
    places = {"body": ("q3",), "interface": ("port",)}
    numerics = frozenset({"time_step"})
    refined = 1.0
    seen = None

    def finer(self, what, factor):
        other = Placed()
        other.refined, other.seen = factor, self
        return other

    def run(self, values, excitation, laws, request):
        (self.seen or self).given = values, self.refined
        return super().run(values, excitation, laws, request)


def test_a_law_of_the_structure_changes_the_first_parameters_that_are_there():
    model = Model(Placed(), [MOVED])
    seen = model.run({"moved": 2e-4}, DRIVE)
    assert model.simulator.given[0] == {"gap": 8e-4, "s": 2e-4}
    assert '"gap": 0.001' in seen.attrs["values"]


def test_a_numerical_law_puts_another_simulator_in_the_place_of_the_models():
    model = Model(Placed(), [FINER])
    model.run({"refinement": 2.0}, DRIVE)
    assert model.simulator.given[1] == 2.0
    model.run({}, DRIVE)
    assert model.simulator.given[1] == 1.0


def test_a_law_of_the_stop_puts_a_simulator_in_the_place_of_the_models_and_gives_it_its_parameters():
    class Soft(Placed):
        parameters = (Placed.parameters[0], Parameter("softness", "1", 9.0, ""), Parameter("sides", "1", 2.0, ""))
        sites = frozenset({"force"})

    class Stopped(Placed):
        contacts = frozenset({"soft"})

        def compliant(self, contact):
            other = Soft()
            other.seen = self
            return other

    model = Model(Stopped(), [SOFTENED, gap_offset.EFFECT])
    model.run({"softness": 3.0}, DRIVE)
    assert model.simulator.given[0] == {"gap": 1e-3, "softness": 3.0, "sides": 2.0}
    failing = model.run({"softness": 3.0, "dg": 1e-4}, DRIVE)
    assert "'gap' and 'softened' exclude one another" in failing.attrs["reason"]
    model.run({"dg": 1e-4}, DRIVE)
    assert "softness" not in model.simulator.given[0]


def test_a_law_at_a_place_is_bound_to_the_bodies_there_and_borrows_what_the_structure_has():
    model = Model(Placed(), [BORROWING, MOVED])
    values = {"size": 3.0, "moved": 1e-4}
    (law,) = model._laws(values | {"gap": 1e-3, "s": 0.0}, model._own(values | {"gap": 1e-3, "s": 0.0}))
    assert law.bodies == ("port",)
    assert law.p[:2] == pytest.approx([3.0, 9e-4])


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (MOVED, "it changes g_max, s or gap, s, which simulator 'still' does not have"),
        (FINER, "it refines time_step, which simulator 'still' cannot refine"),
        (SOFTENED, "it needs a rigid stop that contact soft can replace, which simulator 'still' does not have"),
        (BORROWING, "it acts at the interface, which simulator 'still' does not have"),
        (replace(BORROWING, borrowed=("width",)), "it needs width"),
        (channel_lag.EFFECT, ""),
    ],
    ids=["structure", "numerical", "stop", "place", "borrowed", "sensor"],
)
def test_an_effect_says_why_a_simulator_cannot_take_it(effect, said):
    reason = effect.refusal(Still())
    assert said in reason
    assert bool(reason) == bool(said)


def test_an_effect_that_is_explicit_in_time_has_no_period_map():
    simulator = Placed()
    simulator.period_map = lambda *given: given
    model = Model(simulator, [replace(BORROWING, transient=True)])
    assert model.period_map({}, DRIVE)
    with pytest.raises(CalibError, match="explicit in time"):
        model.period_map({"size": 1.0}, DRIVE)


def test_an_effect_survives_as_a_key_and_through_a_pickle():
    effect = replace(FINER, natural={"refinement": (2.0, 4.0)})
    assert {pickle.loads(pickle.dumps(effect)): 1}[effect] == 1


def test_the_guide_of_a_simulator_numbers_its_items_and_names_what_is_read():
    guide = Simulator.__doc__
    assert [int(number) for number in re.findall(r"^    (\d+)\. ", guide, re.M)] == list(range(1, 27))
    optional = set(re.findall(r"Optionally `(\w+)", guide)) | {"numerics", "contacts"}
    read = {
        n
        for protocol in (MappedSimulator, RefinableSimulator, StoppedSimulator)
        for n in vars(protocol)
        if not n.startswith("_")
    }
    for path in Path(calib.__file__).parent.rglob("*.py"):
        text = path.read_text()
        read |= set(re.findall(r"(?:get|has)attr\((?:\w+\.)*simulator, \"(\w+)\"", text))
    assert optional == read
