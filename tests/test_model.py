import pickle
from dataclasses import replace

import numpy as np
import pytest

from calib import record
from calib.effect import Effect
from calib.effects import air_drag_quadratic, gap_offset, velocity_lag
from calib.errors import CalibError
from calib.excitation import Excitation
from calib.laws import SLOTS, gap, slots
from calib.model import Model, Request
from calib.parameter import Parameter

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
    longer = model.extended(gap_offset.EFFECT, air_drag_quadratic.EFFECT)
    assert (list(model.parameters), list(longer.parameters)) == (["gap"], ["gap", "dg", "c2"])
    assert longer.name == "still + gap_offset + air_drag_quadratic"


def test_a_sensor_law_acts_on_the_record_and_not_in_the_simulator():
    model = Model(Still(), [velocity_lag.EFFECT])
    seen = model.run({"lag": 0.01}, DRIVE, Request(periods=2, samples=100))
    assert model.simulator.handed == ()
    assert seen.velocity.values[0] == pytest.approx(np.roll(seen.displacement.values[0], 25), abs=1e-12)


def test_an_unknown_parameter_is_answered_with_the_nearest():
    with pytest.raises(CalibError, match="did you mean 'gap'"):
        Model(Still()).run({"gab": 1.0}, DRIVE)


@pytest.mark.parametrize(
    ("effect", "said"),
    [(replace(gap_offset.EFFECT, bodies=("q9",)), "acts on body 'q9'"),
     (replace(gap_offset.EFFECT, parameters=(Parameter("gap", "m", 0.0, "", null=0.0),)), "the model has already")],
)
def test_an_effect_that_does_not_fit_is_refused(effect, said):
    with pytest.raises(CalibError, match=said):
        Model(Still(), [effect])


def test_a_site_that_the_simulator_lacks_is_refused():
    simulator = Still()
    simulator.sites = frozenset({"force"})
    with pytest.raises(CalibError, match="takes laws at \\['force'\\]"):
        Model(simulator, [gap_offset.EFFECT])


def test_more_effects_than_slots_are_refused():
    many = [
        replace(gap_offset.EFFECT, name=f"g{i}", parameters=(Parameter(f"dg{i}", "m", 0.0, "", null=0.0),))
        for i in range(SLOTS + 1)
    ]
    with pytest.raises(CalibError, match="at most 4"):
        Model(Still(), many)


def test_a_law_stays_the_same_through_a_pickle():
    law = pickle.loads(pickle.dumps(gap_offset.EFFECT)).law
    assert law is gap_offset.offset


def test_empty_slots_give_nothing():
    functions, p, count = slots([gap_offset.EFFECT.bound({"dg": 2e-4})], "gap")
    assert (count, len(functions), p.shape[0]) == (1, SLOTS, SLOTS)
    assert sum(f(0.0, row) for f, row in zip(functions, p, strict=True)) == 2e-4


def test_an_effect_needs_a_null():
    with pytest.raises(CalibError, match="no null"):
        Effect("x", "gap", gap(lambda place, p: p[0]), (Parameter("a", "m", 0.0, ""),), meaning="")
