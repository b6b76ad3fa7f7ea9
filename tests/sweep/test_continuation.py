"""Regular motions taken from one value of a sweep to the next."""

import importlib

import numpy as np
import pytest
from dynamics.plain_maps import FOLDS
from tiny_simulators import DRIVE, Mapped

from calib.dynamics.escape import EscapeTime
from calib.dynamics.orbit_kind import CHAOTIC, QUASI_PERIODIC, OrbitKind
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.sweep import Sweep, run
from calib.sweep.compute import as_run
from calib.sweep.continuation import ContinuationChain, Known, Regular, continued

PUSH = np.linspace(-0.6, 0.6, 13)


def bistable(over=None, simulator=None, **more):
    return Sweep(Setting(Model(simulator or Mapped("bistable")), DRIVE), over or {"push": PUSH}, **more)


def regular(period, displacement, velocity):
    return Regular(period, 0, {}, np.atleast_2d(displacement), np.atleast_2d(velocity))


def test_a_grid_is_gone_through_both_ways_along_each_axis():
    sweep = bistable({"push": [0.1, 0.0], "b": [0.1, 0.2, 0.3]})
    rows = [(0, 1), (2, 3), (4, 5)]  # the first parameter runs fastest
    columns = [(0, 2, 4), (1, 3, 5)]
    rising = [row[::-1] for row in rows] + columns  # values of the first fall in the order in which they were given
    assert set(sweep.chains()) == {*rising, *(chain[::-1] for chain in rising)}


@pytest.mark.parametrize("more", [{"carry": "both"}, {"carry": "forward"}])
def test_carried_states_and_lists_of_points_are_not_continued(more):
    assert not list(bistable(**more).chains())
    assert not list(bistable({"push": [0.1, 0.2], "b": [0.1, 0.2]}, paired=True).chains())
    assert not list(bistable({"push": [0.1]}).chains())


def test_a_motion_is_near_another_at_whatever_phase_of_its_return():
    one = regular(2, [1.0, -1.0], [0.2, 0.1])
    shifted = regular(2, [-1.0, 1.0], [0.1, 0.2])
    assert one.apart(shifted) == 0.0
    assert one.apart(regular(2, [1.1, -1.0], [0.2, 0.1])) == 0.0  # the last state is what is compared
    assert one.apart(regular(2, [1.0, -0.9], [0.2, 0.1])) == pytest.approx(0.1)
    assert one.apart(regular(2, [1.0, -1.0], [0.2, 0.12])) == pytest.approx(0.1)


def test_a_cycle_is_taken_to_where_it_ends_in_a_fold():
    sweep = bistable()
    left, nothing = run_of(sweep, 0), Known((), False, False)
    found = continued(sweep, ContinuationChain(tuple(range(13)), (nothing,) * 13, (left,)))
    np.testing.assert_array_equal(PUSH[found["at"]], PUSH[PUSH < FOLDS])
    assert (found["displacement"][:, 0, -1] < 0.0).all()
    assert (found["share"] == 0.0).all()


def test_what_is_known_there_is_confirmed_and_not_told_again():
    sweep = bistable()
    whole = run_of(sweep, 3)._replace(sightings=2)
    found = continued(sweep, ContinuationChain((3,), (Known((whole,), False, False),), (whole,)))
    assert found["at"].size == 0
    assert found["confirmed"].tolist() == [[1]]
    assert found["support"].tolist() == [[2]]


def test_sightings_add_up_along_a_branch():
    sweep = bistable()
    known = [run_of(sweep, point)._replace(sightings=1) for point in range(3)]
    found = continued(sweep, ContinuationChain((0, 1, 2), tuple(Known((one,), True, False) for one in known), ()))
    assert found["support"].tolist() == [[0], [1], [2]]


def run_of(sweep, point):
    map = sweep.map_at(point)
    orbit = map.orbit(map.initial, 300)
    named = dict(zip(map.names, orbit.states[-1].tolist(), strict=True))
    return Regular(1, 0, named, orbit.displacement[:, -1:], orbit.velocity[:, -1:])


def test_points_that_failed_are_passed_over():
    sweep = bistable(simulator=Mapped("bistable", {"impossible": PUSH[4:6].tolist()}))
    begin = run_of(sweep, 3)
    known = tuple(Known((), False, failed) for failed in (True, True, False))
    found = continued(sweep, ContinuationChain((4, 5, 6), known, (begin,)))
    assert found["at"].tolist() == [2]


def test_a_chain_that_breaks_costs_no_point(tmp_path, monkeypatch):
    whole = run(bistable(), tmp_path / "whole.nc")

    def breaking(function):
        def called(task):
            if isinstance(task, ContinuationChain):
                raise RuntimeError("the simulator broke")
            return function(task)

        return called

    module = importlib.import_module("calib.sweep.run")
    monkeypatch.setattr(module, "workers", lambda function, pool, timeout: InProcess(breaking(function)))
    found = run(bistable(), tmp_path / "sweep.nc")
    assert whole.sizes["other"] == 1
    assert found.sizes["other"] == 0
    for name in ("kind", "displacement", "exponent", "certain"):
        np.testing.assert_array_equal(found[name], whole[name])


def test_a_sweep_without_runs_is_refused():
    with pytest.raises(CalibError, match="expected at least 1 run per value, got 0"):
        bistable(runs=0)


@pytest.mark.parametrize("kind", [QUASI_PERIODIC, CHAOTIC])
def test_a_carried_motion_stays_the_run_s_own_beside_a_stable_one(kind):
    """Whatever the run is on: a torus has no escape time."""
    orbit = bistable().map_at(0).orbit(np.zeros(2), 96)
    run = OrbitKind(kind, "the run", orbit, orbit.states[-1], 0, share=0.5)
    escape = EscapeTime(1000, 1) if kind == CHAOTIC else None
    stable = OrbitKind(
        "period-1", "a cycle", orbit, orbit.states[0], 0, 1, 0, -1.0,
        coexisting=(run,), escape=escape, run_state=run.state,
    )  # fmt: skip
    carried = as_run(stable)
    assert (carried.kind, carried.certain) == (kind, False)
    assert [one.kind for one in carried.coexisting] == ["period-1"]
    assert carried.state is run.state
    assert ("escape time" in carried.evidence) == (kind == CHAOTIC)
    assert "None" not in carried.evidence
    assert as_run(run) is run
