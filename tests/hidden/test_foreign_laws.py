"""Laws that scipy hides: the motions agree with the other integrator, the design is balanced, and a case is found."""

from collections import Counter

import numpy as np
import pytest
from benchmarks import bench_discovery
from hidden import flight
from hidden.foreign_laws import KINDS, SIZES, flown, hidden, system
from hidden.motion import at_rest, repeating

from calib.diagnosis.discovery.outcome import FOUND

NOISES = [0.003, 0.01, 0.03]


@pytest.mark.parametrize(("name", "stop"), [("oscillator", False), ("oscillator", True), ("four_dof", False)])
def test_motions_agree_with_those_of_the_other_integrator(name, stop):
    at, law = system(name, stop), hidden(name, "cubic", 0.03, stop)
    plan, row = at.plans[1], at.measured[law.body]
    plant, laws = at.plant(at.truth, plan), flight.Laws(k3=law.level / law.length**3)
    times = np.linspace(0.0, 3.0 / plan.frequency, 60)
    state, memory = at_rest(plant, laws)
    if name == "four_dof":  # from rest it chatters
        state = repeating(plant, laws, 1.0 / plan.frequency).state
    samples, impacts = np.zeros((times.size, state.size)), np.zeros((flight.IMPACTS, 3))
    _, met = flight.fly(plant, laws, state.copy(), memory, 0.0, times[-1], times, samples, impacts)
    own = flown(plant, law, row, state, times)
    assert len(own.impacts) == met
    assert own.impacts == pytest.approx(impacts[:met, 0], abs=1e-7)
    assert np.abs(own.states - samples).max() < 1e-5 * plant.speed


def test_every_shape_is_of_the_order_of_one():
    x, v = np.meshgrid(np.linspace(-1.0, 1.0, 81), np.linspace(-1.0, 1.0, 81))
    for kind in KINDS:
        largest = np.abs(hidden("oscillator", kind, 1.0).at(10e-3 * x.ravel(), 0.628 * v.ravel())).max()
        assert 0.3 < largest / hidden("oscillator", kind, 1.0).level < 2.5


def test_a_design_is_balanced_and_repeats():
    cases = bench_discovery.cases("oscillator", 75, 4, NOISES, seed=3)
    assert cases == bench_discovery.cases("oscillator", 75, 4, NOISES, seed=3)
    assert len({bench_discovery.key(case) for case in cases}) == 79
    drawn = cases[:75]
    assert set(Counter(case["kind"] for case in drawn).values()) == {3}
    assert set(Counter(case["size"] for case in drawn).values()) == {len(drawn) // len(SIZES)}
    assert set(Counter(case["noise"] for case in drawn).values()) == {len(drawn) // len(NOISES)}
    assert not any(case["kind"] for case in cases[75:])


def test_rates_count_places_arguments_errors_and_silence():
    [one, two, none] = bench_discovery.cases("oscillator", 2, 1, [0.01], seed=3)
    found = {"verdict": FOUND, "body": "mass", "search_seconds": 1.0, "error": 0.05}
    one |= found | {"kind": "drag", "arguments": [["velocity"]], "misfits": {"told": 1.0, "found": 1.1, "null": 9.0}}
    two |= found | {"kind": "valve", "arguments": [["velocity"]], "misfits": {"told": 1.0, "found": 2.0}, "error": 0.5}
    none |= {"verdict": "nothing", "search_seconds": 1.0}
    text = bench_discovery.table([one, two, none])
    for line in ("right place 2/2", "right arguments 1/2", "error below 10% 1/2", "within 1.3 times 1/2", "hidden 1/1"):
        assert line in text


@pytest.mark.slow
def test_a_case_is_played_and_scored():
    [case] = [c for c in bench_discovery.cases("oscillator", 25, 0, [0.01], seed=1) if c["kind"] == "square"]
    row = bench_discovery.played(case)
    assert (row["verdict"], row["body"], row["arguments"]) == (FOUND, "mass", [["displacement"]])
    assert row["error"] < bench_discovery.MAX_ERROR
    assert bench_discovery.ratio(row) < bench_discovery.MAX_MISFIT_RATIO
