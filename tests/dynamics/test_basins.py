"""Basins of attraction against a map whose basins are known."""

import os

import numpy as np
import pytest
import xarray as xr
from dynamics.plain_maps import henon
from tiny_simulators import DRIVE, MEMORY, Echo, Mapped

from calib.dynamics.basins import Plane, _motion, basins
from calib.dynamics.pseudo_orbit import on_lattice
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.pools import started
from calib.execution.pools.settings import PoolSettings
from calib.modelling.model import Model
from calib.report.plots.sections import basin_map

X = ("body.displacement", np.linspace(-1.6, 1.6, 9))
Y = ("body.velocity", np.linspace(-0.65, 3.0, 6))


def plane(x=X, y=Y, simulator=None, values=None, **more):
    return Plane(Setting(Model(simulator or Mapped("bistable")), DRIVE, values or {}), x, y, **more)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return basins(plane(), tmp_path_factory.mktemp("basins") / "basins.nc", jobs=2)


def starts(found):
    """Displacement + velocity (y, x) of the states."""
    return found[X[0]].values[None, :] + found[Y[0]].values[:, None]


def ends(found):
    """Displacement (y, x) of the fixed point that each state leads to, NaN where it leads to none."""
    place = np.append(found.section_x.values[:, 0], np.nan)
    return place[found.attractor.values]


# --- what is found


def test_states_on_either_side_of_the_boundary_lead_to_different_motions(found):
    """The boundary is oblique, so that rows taken for columns are seen."""
    u = starts(found)
    near = np.abs(u) < np.sqrt(3.0)
    assert near.sum() > 20
    assert np.abs(u).min() > 1e-3  # none on the boundary
    np.testing.assert_allclose(ends(found)[near], np.sign(u[near]), atol=1e-6)


def test_states_that_lead_nowhere_say_so(found):
    lost = np.abs(starts(found)) > np.sqrt(5.0)
    assert lost.any()
    np.testing.assert_array_equal(found.attractor.values == -1, lost)
    np.testing.assert_array_equal(found.status.values == "diverged", lost)
    assert (found.reason.values[lost] == "the map's state grew beyond bounds").all()
    assert (found.status.values[~lost] == "ok").all()


def test_attractors_are_described(found):
    assert found.attractor_kind.values.tolist() == ["period-1", "period-1"]
    assert found.attractor_period.values.tolist() == [1, 1]
    assert sorted(found.section_x.values[:, 0].round(6)) == [-1.0, 1.0]
    np.testing.assert_allclose(found.section_y, 0.0, atol=1e-6)
    shares = [np.mean(found.attractor == k) for k in range(2)]
    np.testing.assert_allclose(found.attractor_share, shares)


def test_coordinates_are_the_components_of_the_state(found):
    assert found.attractor.dims == ("body.velocity", "body.displacement")
    assert found[X[0]].values.tolist() == X[1].tolist()
    assert (found[X[0]].attrs["units"], found[Y[0]].attrs["units"]) == ("m", "m/s")
    assert (found.attrs["model"], found.attrs["phase"]) == ("mapped", 0.0)


def test_the_other_way_round_is_the_transposed_plane(tmp_path, found):
    turned = basins(plane(Y, X), tmp_path / "basins.nc")
    np.testing.assert_allclose(ends_turned(turned), ends(found).T, atol=1e-6)


def ends_turned(found):
    place = np.append(found.section_y.values[:, 0], np.nan)
    return place[found.attractor.values]


@pytest.mark.parametrize(("a", "kind", "cycles"), [(0.5, "period-2", 2), (1.4, "chaotic", 100)])
def test_a_longer_motion_is_one_attractor_wherever_on_it_a_state_ends(tmp_path, a, kind, cycles):
    x, y = ("body.displacement", np.linspace(-0.2, 0.2, 6)), ("body.velocity", np.linspace(-0.1, 0.1, 6))
    found = basins(plane(x, y, Mapped(), {"a": a}), tmp_path / "basins.nc")
    assert (found.attractor == 0).all()
    assert found.attractor_kind.values.tolist() == [kind]
    assert found.section_x.shape == (1, cycles)


def test_other_components_start_where_they_are_held(tmp_path):
    held = Setting(Model(Mapped(), [MEMORY]), DRIVE, {"lag": 1.0})
    three = Plane(held, X, Y, start={"memory.0": 7.0})
    states = three.states(three.map())
    assert states.shape == (6, 9, 3)
    assert (states[..., 2] == 7.0).all()
    np.testing.assert_array_equal(states[2, :, 0], X[1])
    np.testing.assert_array_equal(states[:, 2, 1], Y[1])
    with pytest.raises(CalibError, match=r"no component 'memory.1' \(did you mean 'memory.0'\?\)"):
        Plane(held, X, Y, start={"memory.1": 0.0})


# --- the same however it is run


def test_one_process_finds_what_two_find(tmp_path, found):
    xr.testing.assert_identical(basins(plane(), tmp_path / "basins.nc"), found)


@pytest.mark.slow
def test_workers_elsewhere_find_the_same(tmp_path, found):
    pool = PoolSettings("executor", executor="concurrent.futures:ThreadPoolExecutor", options={"max_workers": 2})
    xr.testing.assert_identical(basins(plane(), tmp_path / "basins.nc", pool=pool), found)
    started.end_all()


class Stopped(Exception):
    pass


def test_a_stopped_plane_ends_as_an_uninterrupted_one(tmp_path, found):
    def stop(done, total):
        if done == 32:
            raise Stopped

    with pytest.raises(Stopped):
        basins(plane(), tmp_path / "basins.nc", on_done=stop)
    told = []
    again = basins(plane(), tmp_path / "basins.nc", on_done=lambda *done: told.append(done))
    assert told == [(32, 54), (54, 54)]
    xr.testing.assert_identical(again, found)
    assert os.listdir(tmp_path) == ["basins.nc"]


def test_another_plane_is_refused_and_fresh_replaces(tmp_path):
    small = ("body.displacement", [0.1, 0.2])
    basins(plane(small, Y), tmp_path / "basins.nc")
    with pytest.raises(CalibError, match=r"differs in plane.*--fresh"):
        basins(plane(X, Y), tmp_path / "basins.nc")
    assert basins(plane(X, Y), tmp_path / "basins.nc", fresh=True).sizes["body.displacement"] == 9


# --- what fails


@pytest.mark.parametrize(("fault", "status", "reason"), [("dies", "crashed", "code 11"), ("raises", "raised", "broke")])
def test_a_state_that_fails_costs_no_other(tmp_path, fault, status, reason, found):
    start = on_lattice(plane().map(), np.array([X[1][4], Y[1][1]]))
    simulator = Mapped("bistable", traps={fault: tuple(start.tolist())})
    broken = basins(plane(simulator=simulator), tmp_path / "basins.nc", jobs=2)
    assert broken.attractor[1, 4] == -1
    assert broken.status[1, 4] == status
    assert reason in broken.reason[1, 4].item()
    others = np.ones((6, 9), dtype=bool)
    others[1, 4] = False
    np.testing.assert_array_equal(broken.attractor.values[others], found.attractor.values[others])


def test_a_plane_without_any_motion_has_a_file_and_a_picture(tmp_path):
    x, y = ("body.displacement", [5.0, 6.0]), ("body.velocity", [0.0, 1.0])
    found = basins(plane(x, y), tmp_path / "basins.nc")
    assert (found.attractor == -1).all()
    assert found.sizes["attractor"] == 0
    xr.testing.assert_identical(basins(plane(x, y), tmp_path / "basins.nc"), found)
    basin_map(found).savefig(tmp_path / "basins.png")


@pytest.mark.parametrize(
    ("x", "simulator", "values", "said"),
    [
        (("body.displacemnt", [0.0]), None, {}, r"no component 'body.displacemnt' \(did you mean"),
        (Y, None, {}, "two components, got 'body.velocity' twice"),
        (("body.displacement", [0.0, np.inf]), None, {}, "list of finite numbers"),
        (("body.displacement", []), None, {}, "list of finite numbers"),
        (X, Mapped(faults={"impossible": [3.0]}), {"a": 3.0}, "a mass of 0 kg"),
        (X, Echo(), {}, "offers no period map"),
    ],
)
def test_a_plane_without_sense_is_refused_and_says_why(x, simulator, values, said):
    with pytest.raises(CalibError, match=said):
        plane(x, Y, simulator, values)


@pytest.mark.parametrize("start", [[0.1, 0.1], [0.0, 0.0], [-0.2, 0.1]])
def test_a_motion_that_settles_slowly_is_not_counted_as_irregular(start):
    assert _motion(henon(1.24), np.array(start), settle=64).period == 7


def test_a_chaotic_motion_is_not_given_more_time():
    assert _motion(henon(1.4), np.array([0.1, 0.1]), settle=64).dropped == 64
