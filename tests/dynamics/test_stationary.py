"""The record of the stable motion beside an irregular one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from calib.dynamics.motion import perturbed
from calib.dynamics.stationary import stable_state, stationary_record
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.cycles import kind_of_motion
from calib.records.cycles.motion import BESIDE_ATTRIBUTE
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.study_file import load

STUDY = Path(__file__).parents[2] / "studies" / "paper_minimal"
REQUEST = Request(periods=6, samples=100)
IN_A_WINDOW, IN_CHAOS = 0.60, 0.50


def setting(restitution):
    return load(STUDY).setting({"restitution": restitution})


def irregular(held):
    """Run from a start that has not left chaos when the record is made."""
    map = held.map()
    for start in perturbed(map, map.initial, 40):
        request = replace(REQUEST, initial_state=start, settle=100)
        record = held.model.run(held.values, held.excitation, request)
        if kind_of_motion(record).period is None:
            return request, record
    raise AssertionError("every start has left chaos within 100 periods")


def test_where_the_run_is_still_irregular_the_record_is_of_the_stable_motion():
    held = setting(IN_A_WINDOW)
    request, run = irregular(held)
    record = stationary_record(held.model, held.values, held.excitation, request)
    motion = kind_of_motion(record)
    assert (motion.kind, motion.impacts) == ("period-2", 1.5)
    assert "found by Newton's method beside a motion that is" in motion.evidence
    assert record.displacement.shape == run.displacement.shape


def test_from_every_start_it_is_the_same_motion():
    held = setting(IN_A_WINDOW)
    map, peaks = held.map(), []
    for start in (map.initial, *perturbed(map, map.initial, 5)):
        request = replace(REQUEST, initial_state=start, settle=100)
        record = stationary_record(held.model, held.values, held.excitation, request)
        assert kind_of_motion(record).kind == "period-2"
        peaks.append(record.displacement.max("time").values)
    np.testing.assert_allclose(peaks, np.broadcast_to(peaks[0], np.shape(peaks)), rtol=1e-6)


def test_lasting_chaos_stays_chaos_and_says_what_was_tried():
    held = setting(IN_CHAOS)
    record = stationary_record(held.model, held.values, held.excitation, REQUEST)
    same = held.model.run(held.values, held.excitation, REQUEST)
    xr.testing.assert_equal(record, same)
    assert record.attrs[BESIDE_ATTRIBUTE] == "no stable periodic motion was found beside it within 1500 periods"
    assert kind_of_motion(record).evidence.endswith(record.attrs[BESIDE_ATTRIBUTE])


@pytest.mark.parametrize("restitution", [0.05, 0.2])
def test_a_regular_motion_is_the_run_itself(restitution):
    held = setting(restitution)
    record = stationary_record(held.model, held.values, held.excitation, REQUEST)
    xr.testing.assert_identical(record, held.model.run(held.values, held.excitation, REQUEST))


def test_a_motion_from_its_beginning_is_left_as_it_is():
    held = setting(IN_CHAOS)
    request = replace(REQUEST, settle=0, periods=80)
    record = stationary_record(held.model, held.values, held.excitation, request)
    xr.testing.assert_identical(record, held.model.run(held.values, held.excitation, request))


def test_a_free_decay_is_left_as_it_is():
    model = Model(FourDof())
    [place] = [place for quantity, place in model.simulator.excitations if quantity == "free decay"]
    decay = Excitation(place, "free decay")
    request = Request(times=np.linspace(0.0, 0.1, 50), initial_state=np.full(8, 1e-4))
    record = stationary_record(model, {}, decay, request)
    xr.testing.assert_identical(record, model.run({}, decay, request))


def test_the_state_holds_a_place_for_a_body_that_is_prescribed():
    held = setting(IN_A_WINDOW)
    map = Model(FourDof(drive="rigid")).period_map({"restitution": 0.05, "gap": 1e-3}, held.excitation)
    state = stable_state(map)
    assert (len(map.names), state.size) == (6, 8)
    assert state[[0, 4]].tolist() == [0.0, 0.0]  # q1 and its velocity
    assert state[1] != 0.0
