"""Sweeps, run: what they find, what they keep, and what a point that fails costs."""

import math
import os
import time
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from dynamics.plain_maps import FOLDS
from tiny_simulators import DRIVE, MEMORY, Mapped

from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.pools import started
from calib.execution.pools.settings import PoolSettings
from calib.modelling.model import Model
from calib.sweep import Sweep, run

A = np.linspace(0.2, 1.2, 11)  # of Henon's map: period 1, 2, 4 and chaos
COUNT = 20  # values, in three pieces


def plan(over, simulator=None, effects=(), values=None, phase=0.0, **more):
    return Sweep(Setting(Model(simulator or Mapped(), effects), DRIVE, values or {}, phase), over, **more)


def hysteresis(**more):
    """Loads across both folds of the bistable map."""
    return plan({"push": np.linspace(-0.6, 0.6, 25)}, Mapped("bistable"), **more)


def children():
    """Processes that this one has started and that are alive, but for the two servants of multiprocessing."""
    found = set()
    for thread in os.listdir(f"/proc/{os.getpid()}/task"):
        with open(f"/proc/{os.getpid()}/task/{thread}/children") as file:
            found |= set(file.read().split())
    return found


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """Sweep of Henon's map over both of its parameters, run by two processes."""
    sweep = plan({"a": A, "b": [0.3, -0.2]}, cycles=96)
    return sweep, run(sweep, tmp_path_factory.mktemp("grid") / "sweep.nc", jobs=2)


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    return run(hysteresis(carry="both"), tmp_path_factory.mktemp("loop") / "sweep.nc", jobs=2)


# --- what a sweep holds


def test_values_at_i_j_are_those_of_the_parameters_there(grid):
    sweep, found = grid
    assert found.kind.dims == ("a", "b")
    for i, a in enumerate(A):
        for j, b in enumerate([0.3, -0.2]):
            alone = kind_of_orbit(sweep.setting.map({"a": a, "b": b}), None, 1000, 96)
            cell = found.isel(a=i, b=j)
            assert (cell.kind, cell.period, cell.dropped) == (alone.kind, alone.period, alone.dropped)
            np.testing.assert_array_equal(cell.displacement, alone.orbit.displacement)
            np.testing.assert_array_equal(cell.velocity, alone.orbit.velocity)
            np.testing.assert_array_equal(cell.state, alone.state)
            np.testing.assert_array_equal(cell.exponent, alone.exponent)
    assert len(np.unique(found.kind)) > 3


def test_the_section_is_the_orbit_of_the_map(grid):
    sweep, found = grid
    first = found.displacement.isel(a=4, b=0, cycle=0, body=0).item()
    cell = found.isel(a=4, b=0)
    orbit = sweep.map_at(4).orbit([first, cell.velocity.values[0, 0]], 95)
    np.testing.assert_allclose(cell.displacement[0, 1:], orbit.displacement[0], rtol=1e-9)


def test_coordinates_and_variables_have_names_and_units(grid):
    found = grid[1]
    assert found.sizes == {"a": 11, "b": 2, "body": 1, "cycle": 96, "component": 2, "impact": 0, "other": 0}
    assert found.a.values.tolist() == A.tolist()
    assert found.a.attrs["units"] == "1"
    assert "nonlinearity" in found.a.attrs["long_name"]
    assert found.displacement.attrs["units"] == "m"
    assert found.component_unit.values.tolist() == ["m", "m/s"]
    assert (found.attrs["model"], found.attrs["phase"]) == ("mapped", 0.0)


def test_a_list_of_points_has_the_dimension_point(tmp_path):
    a, b = [0.2, 0.5, 1.1], [0.3, 0.3, -0.2]
    found = run(plan({"a": a, "b": b}, paired=True), tmp_path / "sweep.nc")
    assert found.kind.dims == ("point",)
    assert (found.a.dims, found.b.dims) == (("point",), ("point",))
    for k, point in enumerate(zip(a, b, strict=True)):
        alone = kind_of_orbit(Mapped().period_map(dict(zip("ab", point, strict=True)), DRIVE, (), 0.0))
        np.testing.assert_array_equal(found.displacement.isel(point=k), alone.orbit.displacement)


def test_the_frequency_of_the_excitation_varies(tmp_path):
    frequencies = 10.0 * A / 0.2
    found = run(plan({"excitation.frequency": frequencies}), tmp_path / "one.nc")
    same = run(plan({"a": A}), tmp_path / "two.nc")
    assert found.excitation_frequency.attrs["units"] == "Hz"
    assert found.excitation_frequency.attrs["name"] == "excitation.frequency"
    np.testing.assert_allclose(found.displacement.values[:, :, :4], same.displacement.values[:, :, :4], rtol=1e-9)


def test_a_parameter_may_have_the_name_of_something_in_the_sweep(tmp_path):
    found = run(plan({"period": [1.0, 2.0]}), tmp_path / "sweep.nc")
    assert found.period.values.tolist() == [1, 1]
    assert found.period_.values.tolist() == [1.0, 2.0]
    assert found.period_.attrs["name"] == "period"


def test_a_law_through_its_null_has_its_component_where_it_acts(tmp_path):
    sweep = plan({"lag": [-1.0, 0.0, 1.0]}, effects=[MEMORY], carry="forward")
    found = run(sweep, tmp_path / "sweep.nc")
    assert found.component.values.tolist() == ["body.displacement", "body.velocity", "memory.0"]
    assert found.kind.values.tolist() == ["period-1"] * 3
    memory = found.state.sel(component="memory.0").values
    assert math.isnan(memory[1])
    np.testing.assert_allclose(memory[[0, 2]], found.displacement.values[0, -1, [0, 2]])


# --- states carried and given


def test_carried_states_find_both_edges_of_the_hysteresis(loop):
    assert loop.kind.dims == ("branch", "push")
    assert loop.branch.values.tolist() == ["forward", "backward"]
    end = loop.displacement.isel(body=0, cycle=-1)
    loads = loop.push.values
    np.testing.assert_array_equal(end.sel(branch="forward") > 0.0, loads > FOLDS)
    np.testing.assert_array_equal(end.sel(branch="backward") > 0.0, loads > -FOLDS)


def test_without_carrying_the_other_cycle_lies_beside(tmp_path, loop):
    found = run(hysteresis(), tmp_path / "sweep.nc", jobs=2)
    assert found.kind.dims == ("push",)
    np.testing.assert_array_equal(found.displacement.values[0, -1] > 0.0, found.push.values > FOLDS)
    beside = np.isin(found.other_kind.values, ["period-1"]).any(axis=0)
    np.testing.assert_array_equal(beside, np.abs(found.push.values) < FOLDS)
    upper = loop.displacement.sel(branch="backward").isel(body=0, cycle=-1).values[beside]
    np.testing.assert_allclose(found.other_displacement.values[0, 0, -1, beside], upper, atol=1e-6)
    assert (found.other_share.values[0, beside] == 0.0).all()
    assert found.certain.values.all()


def test_several_starts_are_branches(tmp_path):
    starts = [{"body.displacement": -1.0}, {"body.displacement": 0.5, "body.velocity": 0.5}]
    found = run(hysteresis(starts=starts), tmp_path / "sweep.nc")
    end = found.displacement.isel(body=0, cycle=-1)
    np.testing.assert_array_equal(end.sel(branch="start 1") > 0.0, found.push.values > FOLDS)
    np.testing.assert_array_equal(end.sel(branch="start 2") > 0.0, found.push.values > -FOLDS)


def test_each_value_of_the_second_parameter_starts_anew(tmp_path):
    sweep = replace(hysteresis(carry="backward"), over={"push": np.linspace(-0.6, 0.6, 25), "b": [0.1, 0.2]})
    found = run(sweep, tmp_path / "sweep.nc")
    np.testing.assert_array_equal(found.state.sel(b=0.1), found.state.sel(b=0.2))
    assert (found.displacement.sel(push=0.0).isel(cycle=-1) > 0.9).all()


def test_a_carried_state_passes_over_points_that_fail(tmp_path, loop):
    """All points of a piece of either way fail; and two of one piece, of which one breaks off the whole piece."""
    impossible, broken = loop.push.values[[*range(8, 17), 19]], loop.push.values[[20]]
    simulator = Mapped("bistable", {"impossible": impossible.tolist(), "raises": broken.tolist()})
    sweep = plan({"push": loop.push.values}, simulator, carry="both", values={"a": 9.0})
    found = run(sweep, tmp_path / "sweep.nc")
    failed = np.isin(loop.push.values, [*impossible, *broken])
    np.testing.assert_array_equal(found.kind == "failed", np.array([failed, failed]))
    np.testing.assert_allclose(found.state[..., ~failed], loop.state[..., ~failed], atol=1e-9)


# --- the same however it is run


def test_two_processes_find_what_one_finds(tmp_path, grid):
    sweep, found = grid
    one = run(sweep, tmp_path / "sweep.nc", jobs=1)
    xr.testing.assert_identical(one, found)


def test_carried_states_are_the_same_from_two_processes(tmp_path, loop):
    xr.testing.assert_identical(run(hysteresis(carry="both"), tmp_path / "sweep.nc", jobs=1), loop)


@pytest.mark.slow
def test_it_is_the_same_on_workers_elsewhere(loop, tmp_path):
    pool = PoolSettings("executor", executor="concurrent.futures:ThreadPoolExecutor", options={"max_workers": 2})
    xr.testing.assert_identical(run(hysteresis(carry="both"), tmp_path / "sweep.nc", pool=pool), loop)
    started.end_all()


def test_what_is_returned_is_what_the_file_holds(tmp_path):
    path = tmp_path / "new" / "sweep.nc"
    found = run(plan({"a": A}), path)
    with xr.open_dataset(path) as stored:
        assert stored.attrs == found.attrs
        assert set(stored.variables) == set(found.variables)
        for name, variable in found.variables.items():
            assert stored[name].attrs == variable.attrs
            np.testing.assert_array_equal(stored[name].values, variable.values)
    assert os.listdir(path.parent) == ["sweep.nc"]


def test_the_same_sweep_is_read_and_not_run_again(tmp_path):
    found, told = run(plan({"a": A}), tmp_path / "sweep.nc"), []
    before = (tmp_path / "sweep.nc").stat().st_mtime_ns
    again = run(plan({"a": A}), tmp_path / "sweep.nc", on_done=lambda *done: told.append(done))
    xr.testing.assert_identical(again, found)
    assert told == [(11, 11)]
    assert (tmp_path / "sweep.nc").stat().st_mtime_ns == before


def test_another_sweep_is_refused_and_fresh_replaces(tmp_path):
    path = tmp_path / "sweep.nc"
    run(plan({"a": A}), path)
    before = path.read_bytes()
    with pytest.raises(CalibError, match=r"holds something else \(it differs in values\).*--fresh"):
        run(plan({"a": A}, values={"b": 0.2}), path)
    assert path.read_bytes() == before
    assert run(plan({"a": A[:3]}, values={"b": 0.2}), path, fresh=True).sizes["a"] == 3
    assert os.listdir(tmp_path) == ["sweep.nc"]


@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize("content", ["a record of months", "netcdf"])
def test_a_file_that_is_no_sweep_is_never_replaced(tmp_path, fresh, content):
    path = tmp_path / "sweep.nc"
    if content == "netcdf":
        xr.Dataset({"x": 1.0}).to_netcdf(path)
    else:
        path.write_text(content)
    before = path.read_bytes()
    with pytest.raises(CalibError, match=r"sweep\.nc: not a"):
        run(plan({"a": A}), path, fresh=fresh)
    assert path.read_bytes() == before


# --- stopped, and gone on with


class Stopped(Exception):
    pass


def stop_after(points):
    """Stop the sweep when so many points are done."""

    def on_done(done, total):
        if done >= points:
            raise Stopped

    return on_done


@pytest.mark.parametrize("carry", ["none", "both"])
def test_a_stopped_sweep_ends_as_an_uninterrupted_one(tmp_path, carry):
    sweep, path = plan({"a": np.linspace(0.2, 1.2, COUNT)}, carry=carry), tmp_path / "sweep.nc"
    for points in (8, 16):
        with pytest.raises(Stopped):
            run(sweep, path, on_done=stop_after(points))
        assert not path.exists()
    told = []
    found = run(sweep, path, on_done=lambda *done: told.append(done))
    total = COUNT * (2 if carry == "both" else 1)
    assert told[0] == (16, total)
    assert told[-1] == (total, total)
    xr.testing.assert_identical(found, run(sweep, tmp_path / "whole" / "sweep.nc"))
    assert sorted(os.listdir(tmp_path)) == ["sweep.nc", "whole"]


def test_fresh_forgets_what_was_done(tmp_path):
    sweep, told = plan({"a": np.linspace(0.2, 1.2, COUNT)}), []
    with pytest.raises(Stopped):
        run(sweep, tmp_path / "sweep.nc", on_done=stop_after(8))
    run(sweep, tmp_path / "sweep.nc", fresh=True, on_done=lambda done, total: told.append(done))
    assert told[0] == 0


def test_pieces_of_another_sweep_are_not_taken(tmp_path):
    with pytest.raises(Stopped):
        run(plan({"a": np.linspace(0.2, 0.3, COUNT)}), tmp_path / "sweep.nc", on_done=stop_after(8))
    told = []
    found = run(plan({"a": A}), tmp_path / "sweep.nc", on_done=lambda done, total: told.append(done))
    assert told[0] == 0
    assert found.sizes["a"] == 11
    assert os.listdir(tmp_path) == ["sweep.nc"]


@pytest.mark.parametrize("other", [plan({"a": A}), plan({"a": A[:3]})])
def test_one_process_at_a_time_works_for_a_file(tmp_path, other):
    """Whether it is the same sweep or another one."""
    refused = []

    def meanwhile(done, total):
        with pytest.raises(CalibError, match=rf"sweep\.nc is being written by process {os.getpid()}") as said:
            run(other, tmp_path / "sweep.nc")
        refused.append(said)
        raise Stopped

    with pytest.raises(Stopped):
        run(plan({"a": A}), tmp_path / "sweep.nc", on_done=meanwhile)
    assert refused
    run(other, tmp_path / "sweep.nc")


def test_no_process_is_left(tmp_path):
    run(plan({"a": A}), tmp_path / "first.nc")
    before = children()
    run(plan({"a": A}), tmp_path / "sweep.nc", jobs=2)
    with pytest.raises(Stopped):
        run(plan({"a": A}, carry="both"), tmp_path / "stopped.nc", jobs=2, on_done=stop_after(8))
    deadline = time.monotonic() + 10.0
    while children() - before and time.monotonic() < deadline:
        time.sleep(0.05)
    assert children() <= before


# --- points that fail


FAULTS = [
    ("raises", "raised", "RuntimeError: the echo broke"),
    ("hangs", "timeout", "no result within"),
    ("dies", "crashed", "exit code 11"),
    ("impossible", "impossible value", "a mass of 0 kg"),
]


@pytest.mark.parametrize("carry", ["none", "forward"])
@pytest.mark.parametrize(("fault", "status", "reason"), FAULTS)
def test_a_point_that_fails_is_data_and_costs_no_other(tmp_path, fault, status, reason, carry):
    """It stands in the middle of the second piece: a process's first call is allowed to compile, and takes longer."""
    a = [*np.linspace(0.2, 0.3, 11), 0.305, 0.31, 0.32]
    sweep = plan({"a": a}, Mapped(faults={fault: [0.305]}), carry=carry)
    told = []
    found = run(sweep, tmp_path / "sweep.nc", timeout=0.5, on_done=lambda *done: told.append(done))
    bad = found.isel({found.kind.dims[0]: 11})
    assert (bad.kind, bad.status) == ("failed", status)
    assert reason in bad.evidence.item()
    assert np.isnan(bad.displacement).all()
    assert (bad.period, bad.impacts) == (0, -1)
    good = found.isel({found.kind.dims[0]: [k for k in range(len(found.kind)) if k != 11]})
    assert set(good.kind.values) == {"period-1"}
    assert set(good.status.values) == {"ok"}
    assert told[-1] == (len(found.kind), len(found.kind))


def test_a_motion_that_diverges_is_data(tmp_path):
    found = run(plan({"a": [0.2, 3.0]}), tmp_path / "sweep.nc")
    assert found.kind.values.tolist() == ["period-1", "failed"]
    assert found.status.values.tolist() == ["ok", "diverged"]
    assert "grew beyond bounds" in found.evidence.values[1]


def test_a_sweep_of_which_nothing_succeeds_has_a_file(tmp_path):
    found = run(plan({"a": [3.0, 4.0]}), tmp_path / "sweep.nc")
    assert found.kind.values.tolist() == ["failed", "failed"]
    assert found.sizes["component"] == 0
    xr.testing.assert_identical(run(plan({"a": [3.0, 4.0]}), tmp_path / "sweep.nc"), found)


@pytest.mark.parametrize("last", [[9.0], [9.0, 0.2]])
def test_what_the_simulator_refuses_ends_the_sweep(tmp_path, last):
    """Wherever it stands; what was done before is kept."""
    sweep = plan({"a": [*np.linspace(0.3, 0.4, 9), *last]}, Mapped(faults={"refuses": [9.0]}))
    with pytest.raises(CalibError, match="such a value is not taken"):
        run(sweep, tmp_path / "sweep.nc")
    assert not (tmp_path / "sweep.nc").exists()
    assert [name for *_, names in os.walk(tmp_path) for name in names if name.endswith("npz")] == ["0-0.npz"]


def test_what_is_refused_beside_a_point_that_fails_ends_the_sweep_too(tmp_path):
    sweep = plan({"a": [0.2, 6.0, 9.0]}, Mapped(faults={"raises": [6.0], "refuses": [9.0]}))
    with pytest.raises(CalibError, match="such a value is not taken"):
        run(sweep, tmp_path / "sweep.nc")
    assert os.listdir(tmp_path) == []


def test_a_refused_sweep_leaves_nothing(tmp_path):
    with pytest.raises(CalibError, match="such a value is not taken"):
        run(plan({"a": [0.2, 9.0]}, Mapped(faults={"refuses": [9.0]})), tmp_path / "new" / "sweep.nc")
    assert os.listdir(tmp_path / "new") == []
