"""Claims about the pictures: they show what is there and leave out what is not."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.category import StrCategoryFormatter

from calib.records import make
from calib.report.plots.motion import histories, phase_curves, simulation_picture, trial_picture
from calib.report.plots.records import aligned_simulation, compared_channels
from calib.report.plots.residuals import correlations, over_phase, residual_over_phase, residual_structure
from calib.report.plots.search import kind_colours, kinds_of_motion, score_history
from calib.report.plots.style import svg, thin


def labels(figure):
    """Label of every axis whose ticks have numbers at them."""
    shown = [axes for f in (figure, *figure.subfigs) for axes in f.axes if axes.get_visible()]
    sides = [(axes.xaxis, "labelbottom") for axes in shown] + [(axes.yaxis, "labelleft") for axes in shown]
    numbered = [axis for axis, side in sides if axis.get_tick_params().get(side, True) and not named(axis)]
    return [axis.get_label().get_text() for axis in numbered]


def named(axis):
    return isinstance(axis.get_major_formatter(), StrCategoryFormatter)


def measured(scene):
    name = next(iter(scene.study.objective.references))
    return scene.study.objective.references[name].record, scene.records[name]


@pytest.fixture
def everything(periodic, recorded):
    best = min(periodic.trials, key=lambda t: t.cost)
    space, parameters = periodic.study.space, periodic.study.model.parameters
    return [
        phase_curves(*measured(periodic)),
        histories(*measured(periodic)),
        residual_over_phase(*measured(periodic)),
        histories(*measured(recorded)),
        residual_structure(*measured(recorded), "mass", "force"),
        score_history(periodic.trials),
        kinds_of_motion(periodic.trials, space, parameters, best),
    ]


def test_every_axis_has_a_quantity_and_a_unit(everything):
    for figure in everything:
        shown = labels(figure)
        assert shown
        assert all(label.endswith("]") and "[" in label for label in shown)


def test_a_drawing_is_an_element_for_a_page(everything):
    for figure in everything:
        text = svg(figure, "name")
        assert text.startswith("<svg")
        assert text.endswith("</svg>")
        assert len(text) < 600_000


def test_the_same_figure_is_drawn_to_the_same_bytes(periodic):
    first, second = (svg(phase_curves(*measured(periodic)), "loop") for _ in range(2))
    assert first == second


def test_a_failed_simulation_leaves_the_measured_curve(periodic):
    record, _ = measured(periodic)
    figure = phase_curves(record, None)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["measured"]


def test_a_record_without_velocity_has_no_phase_curve():
    record = make(np.arange(5.0), ["mass"], {"displacement": np.zeros((1, 5))})
    assert phase_curves(record, None) is None


def test_what_the_excitation_prescribes_is_not_judged(recorded):
    assert compared_channels(*measured(recorded)) == [("mass", "force")]
    assert phase_curves(*measured(recorded)) is None


def test_a_simulation_that_stands_still_has_a_residual_too(recorded):
    record, simulated = measured(recorded)
    still = simulated.map(np.zeros_like, keep_attrs=True)
    assert len(residual_structure(record[["force"]], still, "mass", "force", still).subfigs[1].axes) == 3


def test_the_thumb_is_a_png(periodic):
    trial, objective = periodic.trials[0], periodic.study.objective
    assert trial_picture(trial, periodic.records, objective).startswith(b"\x89PNG")


def test_the_thumb_of_a_failed_trial_shows_what_was_measured(periodic):
    failed = next(t for t in periodic.trials if t.status != "ok")
    assert trial_picture(failed, {"slower": periodic.records["slower"]}, periodic.study.objective).startswith(
        b"\x89PNG"
    )


def test_coulomb_friction_shows_as_the_sign_of_the_velocity(recorded):
    record, simulated = measured(recorded)
    residual = (record.force - simulated.force).sel(body="mass").values
    motion = {c: record[c].sel(body="mass").values for c in ("displacement", "velocity")}
    found = correlations(residual, motion)
    assert max(found, key=lambda name: abs(found[name])) == "sign v"
    assert found["sign v"] > 0.95
    assert found["v³"] < -0.5  # a negative cubic imitates it


def test_a_motion_that_was_not_measured_is_taken_from_the_simulation(recorded):
    record, simulated = measured(recorded)
    force, aligned = record[["force"]], simulated[["force"]]
    assert len(residual_structure(force, aligned, "mass", "force").subfigs[1].axes) == 1
    shown = labels(residual_structure(force, aligned, "mass", "force", simulated))
    assert "Velocity, prescribed [m/s]" in shown
    assert "Displacement, prescribed [mm]" in shown


@pytest.mark.parametrize("seed", range(3))
def test_in_a_free_fall_noise_is_correlated_with_no_function_of_the_motion(seed):
    """There v^2 is linear in x: of the measured x the noise itself would be left, of the simulated nothing is."""
    time = np.linspace(0.0, 2.8, 43)
    x, v = 46.0 + time - 4.905 * time**2, 1.0 - 9.81 * time
    fallen = make(time, ["ball"], {"displacement": x[None], "velocity": v[None]})
    noise = 0.06 * np.random.default_rng(seed).standard_normal(time.size)
    dropped = make(time, ["ball"], {"displacement": (x + noise)[None]})
    figure = residual_structure(dropped, fallen[["displacement"]], "ball", "displacement", fallen)
    bars = figure.subfigs[1].axes[-1]
    shown = dict(zip([tick.get_text() for tick in bars.get_yticklabels()], bars.patches, strict=True))
    assert "v²" not in shown
    assert max(abs(bar.get_width()) for bar in shown.values()) < 0.6
    assert "Displacement, simulated [m]" in labels(figure)


def test_a_short_record_is_drawn_once(recorded):
    record, simulated = (one.isel(time=slice(0, 150)) for one in measured(recorded))
    assert len(histories(record, simulated).axes) == 1


def test_the_curve_without_the_extension_is_drawn_beside_the_extended_one(periodic):
    record, simulated = measured(periodic)
    for draw in (phase_curves, histories):
        alone, beside = draw(record, simulated), draw(record, simulated, simulated)
        assert len(beside.axes[0].lines) == len(alone.axes[0].lines) + 1
        assert [text.get_text() for text in beside.legends[0].get_texts()][-1] == "without the extension"


def test_what_is_not_simulated_differs_nowhere_most(recorded):
    record, simulated = measured(recorded)
    assert len(histories(record, None).axes) == 3
    assert len(histories(record, simulated).axes) == 2


def test_a_cubic_spring_shows_as_the_cube_of_the_displacement():
    rng = np.random.default_rng(1)
    x = np.sin(np.linspace(0.0, 300.0, 5000)) * np.linspace(0.1, 1.0, 5000)
    found = correlations(0.3 * x + x**3 + 0.05 * rng.standard_normal(x.size), {"displacement": x})
    assert max((n for n in found if n != "x"), key=lambda name: abs(found[name])) == "x³"


def test_a_residual_that_repeats_stands_out_over_the_phase(periodic):
    record, _ = measured(periodic)
    shifted = record.copy(deep=True)
    shifted["velocity"] = record.velocity - 0.05
    _, mean, error = over_phase(record, shifted, "q3", "velocity", 0.04)
    np.testing.assert_allclose(mean, 0.05)
    np.testing.assert_allclose(error, 0.0, atol=1e-8)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_simulation_is_drawn_to_a_file(periodic, tmp_path, suffix):
    simulation_picture(periodic.records["clapping"], tmp_path / f"loop{suffix}")
    assert (tmp_path / f"loop{suffix}").stat().st_size > 1000


def test_kinds_are_ordered_from_regular_to_irregular(periodic):
    colours = kind_colours(periodic.trials)
    assert list(colours) == ["period 1", "period 2", "irregular"]
    assert len(set(colours.values())) == 3


@pytest.mark.parametrize("size", [10, 1000, 2400, 80_000])
def test_a_thinned_line_has_no_more_points_than_wanted_and_keeps_its_ends(size):
    keep = thin(size, 700)
    assert keep.size == min(size, 700)
    assert (keep[0], keep[-1]) == (0, size - 1)
    assert (np.diff(keep) > 0).all()


def test_thinned_samples_of_a_periodic_record_are_spread_over_its_phase():
    assert np.unique(thin(2400, 700) % 400).size > 300


def test_measured_is_drawn_as_dots():
    figure = phase_curves(make(np.arange(4.0), ["a"], {c: np.ones((1, 4)) for c in ("displacement", "velocity")}), None)
    drawn = figure.axes[0].lines[0]
    assert (drawn.get_linestyle(), drawn.get_marker()) == ("None", ".")


def test_impacts_are_marked_on_the_time_of_the_reference(periodic):
    record, simulated = measured(periodic)  # impacts at 0.3 of each period of 0.04 s
    simulated = simulated.assign_attrs(prescribed="q2.displacement")
    aligned = simulated.drop_vars("impact_time").assign_attrs(nuisance_trigger=0.02, prescribed="")
    found = aligned_simulation(SimpleNamespace(aligned=lambda *_: aligned), "clapping", simulated)
    np.testing.assert_allclose(found.impact_time.values, 0.04 * (0.8 + np.arange(6)))
    assert ("q2", "displacement") not in compared_channels(record, found)
