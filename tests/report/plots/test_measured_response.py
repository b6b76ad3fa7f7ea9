"""Pictures of measured frequency responses: their legend covers nothing and is whole."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg

from calib.records.response import PARTS, make_response
from calib.report.plots.diagnosed_responses import response_residual_figure
from calib.report.plots.measured_response import response_over_frequency, response_residual

FREQUENCIES = np.linspace(20.0, 30.0, 9)  # Hz


def sweeps_up_and_down(levels, sag):
    """Sweeps of flat responses, which fill the panel; the level of each falls by `sag` over the frequency  [1]."""
    level = np.concatenate([np.linspace(1.0, 1.0 - sag, 9)[::way] * size for size in levels for way in (1, -1)])
    frequency = np.concatenate([FREQUENCIES[::way] for _ in levels for way in (1, -1)])
    direction = np.tile(np.repeat([1.0, -1.0], 9), len(levels))
    sweep = np.repeat(np.arange(2 * len(levels)), 9)
    return make_response(frequency, ["mass"], 1e-3 * level[None], level, "N", sweep, direction)


def measured_and_simulated(record):
    return response_over_frequency(record, record.assign(piece=("point", record.sweep.values)))


def diagnosed(record, **points):
    over, rows = ("row", "time"), np.ones((2, record.sizes["point"]))
    views = {"measured": rows, "calibrated": rows, "extended": rows, "weight": rows}
    points |= {name: ("time", record[name].values, record[name].attrs) for name in
               ("frequency", "level", "sweep", "direction")}  # fmt: skip
    of_rows = {"body": ["mass", "mass"], "channel": PARTS, "unit": ["1", "1"]}
    return response_residual_figure(
        xr.Dataset(
            {name: (over, view) for name, view in views.items()} | {"sigma": ("row", [1.0, 1.0])},
            coords=points | {name: ("row", list(own)) for name, own in of_rows.items()},
        ),
        "friction",
    )


@pytest.mark.parametrize("draw", [measured_and_simulated, diagnosed])
@pytest.mark.parametrize("sag", [0.0, 0.4])
@pytest.mark.parametrize("count", [1, 3, 6])
def test_the_legend_lies_above_the_panels_and_within_the_picture(count, sag, draw):
    figure = draw(sweeps_up_and_down(0.0123 * np.arange(1, count + 1), sag))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    [legend] = figure.legends
    box = legend.get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width
    assert box.y1 <= figure.bbox.height
    assert all(axes.get_tightbbox(canvas.get_renderer()).y1 <= box.y0 for axes in figure.axes)
    assert all(axes.get_legend() is None for axes in figure.axes)
    assert len(legend.get_texts()) == 2 * count + 1


def test_the_panels_keep_their_size_however_many_sweeps_the_legend_names():
    figures = [measured_and_simulated(sweeps_up_and_down(levels, 0.4)) for levels in ([1.0], np.arange(1.0, 7.0))]
    for figure in figures:
        FigureCanvasAgg(figure).draw()
    one, six = (figure.axes[0].get_window_extent().height for figure in figures)
    assert six == pytest.approx(one, rel=0.03)


def test_each_harmonic_has_panels_of_its_own():
    plain = sweeps_up_and_down([1.0], 0.4)
    size = plain.sizes["point"]
    own = {2: np.full((1, size), 1e-5 + 0.0j), 4: np.full((1, size), 1e-6j)}
    record = make_response(
        plain.frequency.values, ["mass"], plain.in_phase.values, plain.level.values, "N", plain.sweep.values,
        plain.direction.values, sigma=np.full((1, size), 1e-6), higher=own,
    )  # fmt: skip
    labels = [axes.get_ylabel() for axes in measured_and_simulated(record).axes]
    assert labels[::2] == ["mass: amplitude [mm]", "mass: harmonic 2 [mm]", "mass: harmonic 4 [um]"]
    assert labels[1::2] == 3 * ["Phase [deg]"]
    panels = response_residual(record, record.assign(trust=("point", np.where(np.arange(size) == 2, 0.1, 1.0)))).axes
    residuals = [axes.get_ylabel() for axes in panels]
    assert residuals == ["mass:\n|dH| / sigma", "mass:\n|dH_2| / sigma", "mass:\n|dH_4| / sigma", "dF / sigma"]
    for axes in panels:  # a gross error is left out
        assert np.isnan(np.concatenate([line.get_ydata() for line in axes.lines])).sum() == 1


def test_gross_errors_have_no_residual_in_the_picture_of_a_diagnosis():
    record = sweeps_up_and_down([1.0], 0.4)
    gross = np.zeros(record.sizes["point"], dtype=np.int8)
    gross[[3, 12]] = 1
    panel = diagnosed(record, gross_error=("time", gross)).axes[0]
    drawn = [line.get_ydata() for line in panel.lines if line.get_marker() in ("^", "v")]
    assert [np.flatnonzero(np.isnan(own)).tolist() for own in drawn] == [[3], [3]]  # of nine points each


def test_what_is_below_its_bar_or_is_rounding_has_no_phase():
    plain = sweeps_up_and_down([1.0], 0.4)
    size = plain.sizes["point"]
    second = np.where(np.arange(size) < 3, 1e-5 + 0.0j, 1e-6)[None]
    record = make_response(
        plain.frequency.values, ["mass"], plain.in_phase.values, plain.level.values, "N", plain.sweep.values,
        plain.direction.values, sigma=np.full((1, size), 2e-6), higher={2: second},
    )  # fmt: skip
    simulated = record.assign(in_phase_2=1e-17 * record.in_phase_2, piece=record.sweep)
    axes = response_over_frequency(record, simulated).axes[3]
    drawn = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
    points, curves = ([y for line, y in zip(axes.lines, drawn, strict=True) if (line.get_linestyle() == "None") is own]
                      for own in (True, False))  # fmt: skip
    assert sum(np.isfinite(y).sum() for y in points) == 3
    assert curves
    assert not any(np.isfinite(y).any() for y in curves)
