"""What holds for the distance of any two loops."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from phase_loops import FREQUENCY, clapping, noisy

from calib.features.phase_curve import PhaseCurve
from calib.objective import Objective, Reference, Term

PERIOD = 1.0 / FREQUENCY
triggers = st.floats(0.0, PERIOD, exclude_max=True)
jumps = st.floats(0.0, 0.8)
impacts = st.floats(0.0, 1.0, exclude_max=True)


def total(record, run, nuisance=("trigger",)):
    return Objective({"run": Reference("run", record, nuisance=nuisance)}, [Term(PhaseCurve())])({"run": run}).cost


@settings(deadline=None, max_examples=25)
@given(triggers, triggers)
def test_a_smooth_loop_may_start_anywhere(first, second):
    assert total(clapping(jump=0.0, trigger=first), clapping(jump=0.0, trigger=second)) < 1e-4


@settings(deadline=None, max_examples=25)
@given(triggers, jumps, impacts)
@example(0.003, 0.75, 0.0)  # the jump is at the very instant of a sample: rounding puts it before it or behind it
@example(0.03125, 0.5, 0.9999999999999999)  # it is at the end of the record, where the loop begins anew
def test_a_loop_with_a_jump_may_start_anywhere(trigger, jump, impact):
    # half the jump in one sample of 400 would cost 6e-3: next to the impact velocity is not compared
    assert total(clapping(jump=jump, impact=impact, trigger=trigger), clapping(jump=jump, impact=impact)) < 1e-3


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 399), jumps, impacts, st.integers(0, 5))
def test_whole_samples_of_trigger_change_nothing(shift, jump, impact, seed):
    run, record = clapping(jump=jump, impact=impact), noisy(clapping(jump=jump, impact=impact + 0.01), seed)
    rolled = record.copy(deep=True)
    for channel in ("displacement", "velocity"):
        rolled[channel] = record[channel].roll(time=shift)
    assert abs(total(record, run) - total(rolled, run)) < 1e-9


@settings(deadline=None, max_examples=25)
@given(st.floats(0.01, 4.0), jumps, impacts)
def test_the_distance_is_linear_in_the_size(size, jump, impact):
    found = total(clapping(jump=jump, impact=impact), clapping(jump=jump, impact=impact, size=size), nuisance=())
    one = total(clapping(jump=jump, impact=impact), clapping(jump=jump, impact=impact, size=2.0), nuisance=())
    assert np.isclose(found, abs(size - 1.0) * one, rtol=1e-9, atol=1e-12)


@settings(deadline=None, max_examples=25)
@given(st.floats(0.1, 10.0), jumps, triggers)
def test_the_distance_does_not_depend_on_the_unit_of_length(unit, jump, trigger):
    record, run = clapping(jump=jump, trigger=trigger), clapping(jump=jump + 0.1)
    scaled = total(clapping(jump=jump, trigger=trigger, size=unit), clapping(jump=jump + 0.1, size=unit))
    assert np.isclose(total(record, run), scaled, rtol=1e-6)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.5, 2.0), st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3), triggers)
def test_what_the_nuisances_explain_costs_nothing(scale, offset, shear, trigger):
    record = clapping(jump=0.0, trigger=trigger)
    x, v = record.displacement, record.velocity
    record["displacement"] = x.copy(data=scale * x.values + offset + shear * v.values)
    assert total(record, clapping(jump=0.0), ("trigger", "offset", "scale", "shear")) < 1e-3
