"""Hide and seek, a handful of cases; `python -m hidden.table` plays them all."""

import json

import pytest
from hidden.drawn import cases, key, played
from hidden.four_dof import PLANS
from hidden.hider import hide
from hidden.laboratory import DRIFT
from hidden.seeker import seek
from hidden.system import Plan

pytestmark = pytest.mark.slow

CLAPPING = PLANS[:1]
TONE = Plan("tone", "calibrate", "harmonic", 8.0, 3.4)  # its third harmonic is near the resonance


@pytest.mark.parametrize(
    ("simulator", "effect"),
    [
        ("oscillator", "coulomb_friction"),
        ("oscillator", "drive_harmonic_2"),
        ("oscillator", "damping_drift"),
        ("oscillator", "channel_nonlinearity"),
        ("oscillator", "stribeck"),
        ("four_dof", "quadratic_drag"),
        ("four_dof", "gap_offset"),
    ],
)
def test_what_the_records_tell_apart_is_named(simulator, effect, cache, tmp_path):
    hide(simulator, effect, 40.0, 0, folder=tmp_path, cache=cache)
    found = seek(tmp_path)
    assert (found.verdict, found.causes) == ("named", (effect,))
    assert found.gain.proven


@pytest.mark.parametrize(("simulator", "phi"), [("oscillator", 0.8), ("four_dof", 0.0)])
def test_nothing_is_found_where_nothing_is_hidden(simulator, phi, cache, tmp_path):
    hide(simulator, None, None, 5, phi=phi, folder=tmp_path, cache=cache)
    assert seek(tmp_path).verdict == "none"


# free-running clocks of 20 to 400 samples a period, 50 ppm off, coloured noise; the oscillator has a recorded input too
@pytest.mark.parametrize(("simulator", "laboratory"), [("four_dof", 5), ("oscillator", 5)])
def test_nothing_is_found_where_the_clock_knows_nothing_of_the_drive(simulator, laboratory, cache, tmp_path):
    hide(simulator, None, None, laboratory, folder=tmp_path, cache=cache, laboratory=laboratory)
    assert seek(tmp_path).verdict == "none"


def test_two_causes_in_a_laboratory_drawn_by_chance_are_found():
    [case] = cases("oscillator", ["two"], range(610, 611), 40.0, DRIFT, {})
    told = ["channel_lag", "quadratic_drag"]  # plot_shear is like both, but of several sizes
    row = played(case)
    assert key(json.loads(json.dumps(row))) == key(case)
    assert sorted(row["effect"]) == told
    assert told in [sorted(names) for names in row["class"]]


@pytest.mark.parametrize(("simulator", "effect"), [("oscillator", "channel_gain"), ("four_dof", "preload")])
def test_what_is_taken_out_of_the_library_and_like_nothing_in_it_is_not_explained(simulator, effect, cache, tmp_path):
    hide(simulator, effect, 80.0, 0, folder=tmp_path, cache=cache)
    assert seek(tmp_path, without=(effect,)).verdict == "unexplained"


def test_what_several_effects_imitate_is_not_explained_and_they_are_stand_ins(cache, tmp_path):
    hide("oscillator", "plot_shear", 80.0, 0, folder=tmp_path, cache=cache)
    found = seek(tmp_path, without=("plot_shear",))
    assert found.verdict == "unexplained"
    assert len(found.selection.causes) > 1
    assert found.selection.is_explained
    assert found.stand_ins
    assert not found.selection.is_homogeneous


def test_a_solver_that_steps_too_coarsely_is_the_reason_for_no_diagnosis(cache, tmp_path):
    hide("four_dof", None, None, 1, folder=tmp_path, cache=cache, steps=60.37, plans=CLAPPING)
    found = seek(tmp_path)
    assert found.verdict == "not_diagnosable"
    assert "time_step: made 2 times finer" in found.summary


def test_of_one_steady_tone_the_class_is_told_and_what_to_measure_next_gives_the_name(cache, tmp_path):
    one = {"calibrated": ("damping", "stiffness"), "tones": (TONE,)}
    told = hide("oscillator", "coulomb_friction", 15.0, 0, folder=tmp_path / "one", cache=cache, **one)
    found = seek(told.folder, next_measurement=True)
    assert found.verdict == "one_of"
    assert ("coulomb_friction",) in found.classes
    best = next(m for m in found.design.measurements if m.kind == "steady tone")
    assert best.z > 3.0
    assert any(m.kind == "free decay" and m.z > 3.0 for m in found.design.measurements)
    more = Plan("further", "name", "harmonic", best.point.amplitude, best.point.frequency)
    size = told.values["friction"]
    hide(
        "oscillator", "coulomb_friction", None, 1, folder=tmp_path / "two", cache=cache, size=size,
        **{**one, "tones": (TONE, more)},
    )  # fmt: skip
    assert seek(tmp_path / "two").causes == ("coulomb_friction",)


def test_where_no_measurement_of_the_kind_tells_the_alternatives_apart_it_says_so(cache, tmp_path):
    one = {"calibrated": ("damping", "stiffness"), "tones": (TONE,)}
    hidden = hide("oscillator", "preload", 15.0, 0, folder=tmp_path, cache=cache, **one)
    found = seek(hidden.folder, next_measurement=True)
    assert set(found.classes) == {("preload",), ("channel_offset",)}
    assert {m.kind for m in found.design.measurements} == {"steady tone", "sweep", "free decay"}
    assert found.design.measurements[0].prediction.startswith("would not distinguish them")
