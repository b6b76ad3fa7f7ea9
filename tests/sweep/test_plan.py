"""What is swept, in which order and from which states."""

import math

import numpy as np
import pytest
from tiny_simulators import DRIVE, MEMORY, Echo, Mapped

from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.parameter import Window
from calib.sweep import Sweep, latin_hypercube

A, B = [0.1, 0.2, 0.3], [0.3, -0.3]


def plan(over, simulator=None, effects=(), values=None, **more):
    return Sweep(Setting(Model(simulator or Mapped(), effects), DRIVE, values or {}), over, **more)


def tracks(sweep):
    return [(track.branch, track.points, track.start, track.carried) for track in sweep.tracks()]


# --- points


def test_the_first_parameter_of_a_grid_runs_fastest():
    points = plan({"a": A, "b": B}).points
    assert points.tolist() == [[a, b] for b in B for a in A]


def test_a_list_of_points_is_taken_as_it_is():
    assert plan({"a": [1.0, 2.0], "b": B}, paired=True).points.tolist() == [[1.0, 0.3], [2.0, -0.3]]


def test_the_map_of_a_point_has_its_values():
    sweep = plan({"a": A, "b": B})
    assert len(sweep.points) == len(A) * len(B)
    for point, (a, b) in enumerate(sweep.points):
        assert sweep.map_at(point).orbit([1.0, 0.0], 1).states[0] == pytest.approx([1.0 - a, b])


# --- tracks and branches


def test_without_carrying_a_branch_is_one_track():
    assert tracks(plan({"a": A, "b": B})) == [(0, (0, 1, 2, 3, 4, 5), 0, False)]
    assert plan({"a": A}).branches == [""]


def test_states_are_carried_in_rising_or_falling_order_whatever_the_order_of_the_values():
    values = {"a": [0.2, 0.3, 0.1]}
    assert tracks(plan(values, carry="forward")) == [(0, (2, 0, 1), 0, True)]
    assert tracks(plan(values, carry="backward")) == [(0, (1, 0, 2), 0, True)]
    assert tracks(plan(values, carry="both")) == [(0, (2, 0, 1), 0, True), (1, (1, 0, 2), 0, True)]


def test_each_value_of_the_second_parameter_is_a_chain_of_its_own():
    assert tracks(plan({"a": A, "b": B}, carry="backward")) == [(0, (2, 1, 0), 0, True), (0, (5, 4, 3), 0, True)]


def test_branches_are_named_for_direction_and_start():
    starts = [{}, {"body.velocity": 0.1}]
    assert plan({"a": A}, carry="both").branches == ["forward", "backward"]
    assert plan({"a": A}, starts=starts).branches == ["start 1", "start 2"]
    both = plan({"a": A}, carry="both", starts=starts)
    assert both.branches == ["forward, start 1", "backward, start 1", "forward, start 2", "backward, start 2"]
    assert [track.start for track in both.tracks()] == [0, 0, 1, 1]


# --- Latin hypercube


def test_every_stretch_of_every_window_has_one_point():
    windows = {"a": Window(0.1, 0.3), "b": Window(0.01, 1.0, "log")}
    drawn = latin_hypercube(windows, 50, seed=3)
    for name, window in windows.items():
        stretches = [math.floor(50 * window.position(value)) for value in drawn[name]]
        assert sorted(stretches) == list(range(50))


def test_the_seed_draws_the_points():
    windows = {"a": Window(0.1, 0.3), "b": Window(0.0, 1.0)}
    drawn = [latin_hypercube(windows, 8, seed)["a"].tolist() for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]


# --- components


def test_a_component_of_a_law_that_is_at_its_null_somewhere_is_known():
    sweep = plan({"lag": [0.0, 1.0]}, effects=[MEMORY], starts=[{"memory.0": 0.5}])
    assert sweep.components() == {"body.displacement": "m", "body.velocity": "m/s", "memory.0": "1"}


# --- what is refused


@pytest.mark.parametrize(
    ("over", "more", "said"),
    [
        ({}, {}, "one or two parameters, got 0"),
        ({"a": A, "b": A, "push": A}, {}, "one or two parameters, got 3: a, b, push"),
        ({"aa": A}, {}, r"'aa' cannot vary \(did you mean 'a'\?\)"),
        ({"a": []}, {}, "list of numbers"),
        ({"a": [[0.1]]}, {}, "list of numbers"),
        ({"a": [0.1, math.inf]}, {}, "got inf"),
        ({"a": [0.1, 0.2, 0.1]}, {}, r"must differ, got \[0.1, 0.2, 0.1\]"),
        ({"b": [0.5, 1.1]}, {}, r"'b' in \[-1, 1\] 1, got 1.1"),
        ({"a": A, "b": B}, {"paired": True}, "as many values of each parameter, got {'a': 3, 'b': 2}"),
        ({"a": A}, {"carry": "forwards"}, r"carry is one of .* \(did you mean 'forward'\?\)"),
        ({"a": B, "b": B}, {"carry": "both", "paired": True}, "a list of points has no order"),
        ({"a": A}, {"settle": -1}, "settle >= 0"),
        ({"a": A}, {"cycles": 95}, "at least 96 cycles"),
        ({"a": A}, {"starts": []}, "a state to start from"),
        ({"a": A}, {"starts": [{}, {"body.velocty": 0.0}]}, r"'body.velocty' \(did you mean 'body.velocity'\?\)"),
        ({"gain": A}, {"simulator": Echo()}, "simulator 'echo' offers no period map"),
        ({"gain": A}, {"values": {"aa": 1.0}}, r"unknown parameter 'aa'.*did you mean 'a'\?"),
    ],
)
def test_a_sweep_without_sense_is_refused_and_says_why(over, more, said):
    with pytest.raises(CalibError, match=said):
        plan(over, **more)


def test_a_list_of_points_may_repeat_a_value():
    assert len(plan({"a": [0.1, 0.1], "b": B}, paired=True).points) == 2


# --- definition


@pytest.mark.parametrize(
    "changed",
    [
        plan({"a": [0.1, 0.2, 0.4]}),
        plan({"b": A}),
        plan({"a": A}, carry="forward"),
        plan({"a": A}, starts=[{"body.velocity": 0.0}]),
        plan({"a": A}, settle=999),
        plan({"a": A}, cycles=101),
        plan({"a": A}, values={"b": 0.31}),
        plan({"a": A}, effects=[MEMORY]),
        plan({"a": A}, simulator=Mapped("bistable")),
    ],
)
def test_the_definition_tells_sweeps_apart(changed):
    assert plan({"a": np.array(A)}).definition() == plan({"a": A}).definition()
    assert changed.definition() != plan({"a": A}).definition()
