"""What is drawn and said of a free decay."""

import re

import numpy as np
import pytest
from decays import linear, noisy, record
from matplotlib.image import imread

from calib.errors import CalibError
from calib.records.decay import body_decays
from calib.report.plots.decay import decay_curves
from calib.report.plots.reference import reference_picture
from calib.report.record_description import record_description

TIME = np.arange(0.0, 40.0, 0.021)  # s
BENCH = record(TIME, noisy(linear(TIME, 1.5, 0.01), 0.01, 1))


def drawn(axes):
    """Ordinates of the lines on the axes, by colour."""
    return {line.get_color(): np.asarray(line.get_ydata()) for line in axes.get_lines()}


def test_measured_periods_the_smoother_and_the_simulation_are_drawn():
    figure = decay_curves(BENCH, record(TIME, linear(TIME, 1.52, 0.012)))
    left, right = figure.get_axes()
    for axes, measured, simulated in ((left, 1.5, 1.52), (right, 1.0, 1.2)):
        dots, smooth, blue = drawn(axes).values()
        assert dots.size > 40
        assert np.median(dots) == pytest.approx(measured, rel=0.05)
        assert np.median(smooth) == pytest.approx(measured, rel=0.05)
        assert blue == pytest.approx(np.full(blue.size, simulated), rel=2e-3)
        low, high = axes.get_ylim()
        assert low < min(measured, simulated) < max(measured, simulated) < high
    assert left.get_xscale() == "log"


def test_a_simulation_that_does_not_oscillate_is_left_out():
    figure = decay_curves(BENCH, record(TIME, 0.0 * TIME))
    assert [len(axes.get_lines()) for axes in figure.get_axes()] == [2, 2]


def test_a_record_too_short_has_no_figure_and_says_why():
    short = BENCH.isel(time=slice(0, 60))
    assert decay_curves(short, None) is None
    (why,) = body_decays(short)
    assert isinstance(why, CalibError)
    assert any(
        "no frequency and damping over amplitude: displacement of mass: " in text for text in record_description(short)
    )


def test_the_picture_of_a_decay_has_two_panels_more(tmp_path):
    reference_picture(BENCH, tmp_path / "decay.png")
    reference_picture(BENCH.assign_attrs(quantity="force"), tmp_path / "force.png")
    wide, plain = (imread(tmp_path / f"{name}.png").shape[1] for name in ("decay", "force"))
    assert wide == pytest.approx(3 * plain, rel=0.01)


def test_what_a_decay_says_is_told_with_its_uncertainty_and_what_is_left_out():
    time = np.arange(0.0, 100.0, 0.021)
    values = linear(time, 1.5, 0.01) + 0.2 * linear(time, 2.6, 0.01)
    values[700] += 5.0
    told = list(record_description(record(time, noisy(values, 0.02, 2))))
    largest = next(text for text in told if text.startswith("mass at an amplitude of"))
    assert "Hz, damping ratio" in largest
    assert largest.endswith("(two standard uncertainties)")
    assert any("left out of the decay: what follows" in text and "and 1 outliers" in text for text in told)
    assert any(re.search(r"dominant mode of mass, at 1.5\d* Hz; others are at 2.[56]\d* Hz", text) for text in told), (
        told
    )
