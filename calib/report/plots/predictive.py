"""Figures of what a posterior distribution predicts of records: bands beside what was measured."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from calib.confidence.predictive import MIN_PREDICTIVE_TRUST
from calib.records import STATE, is_response
from calib.report.plots.predicted_response import response_height, response_panels
from calib.report.plots.style import DPI, KINDS, LINE, MEASURED, SIMULATED, STYLE, TEXT_WIDTH, Look, dots
from calib.units import shown_unit

BAND_PANEL_HEIGHT = 2.3  # of one body  [inch]
LABEL_HEIGHT = 0.55  # of the legend or a title above the panels  [inch]
WITH_NOISE: tuple[Look, Look] = (
    {"color": SIMULATED, "alpha": 0.15, "linewidth": 0}, {"color": SIMULATED, "alpha": 0.25, "linewidth": 0},
)  # fmt: skip
OF_CURVE: tuple[Look, Look] = (
    {"color": KINDS[1], "alpha": 0.45, "linewidth": 0}, {"color": KINDS[1], "alpha": 0.9, "linewidth": 0},
)  # fmt: skip
TYPICAL_SHARE = 0.99  # of the values, that a panel of deviations shows  [1]: those beside a jump are far larger
BAND_MARGIN = 1.15  # half height of that panel over the largest of these  [1]
PERIOD_MARGIN = 1e-6  # of a period, by which its last sample may be late  [1]


def predictive_figure(bands: Mapping[str, xr.Dataset]) -> Figure:
    """Draw the bands of all records, one below the other; see `predictive_of_record`.

    bands : by name of the record, see `calib.confidence.bands.predicted_bands`
    """
    heights = [_height(one) for one in bands.values()] or [BAND_PANEL_HEIGHT]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, sum(heights) + LABEL_HEIGHT), layout="constrained", dpi=DPI)
        if not bands:
            figure.text(0.5, 0.5, "No record could be predicted.", ha="center")
            return figure
        parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
        for (name, one), part in zip(bands.items(), parts, strict=True):
            _panels(part, one)
            part.suptitle(name, x=0.02, horizontalalignment="left")
        over_time = [part for one, part in zip(bands.values(), parts, strict=True) if not is_response(one)]
        for part in over_time[:1]:
            _band_legend(part)
    return figure


def predictive_of_record(bands: xr.Dataset) -> Figure:
    """Draw the bands of one record: each body's phase curve, and its channels less their medians over time.

    Of a periodic motion one period is shown. Beside an impact there is no band of the velocity. Of a frequency response
    see `response_panels`.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, _height(bands)), layout="constrained")
        _panels(figure, bands)
        if not is_response(bands):
            _band_legend(figure)
    return figure


def _bodies(bands: xr.Dataset) -> list[str]:
    return list(dict.fromkeys(str(body) for body in bands["body"].values))


def _height(bands: xr.Dataset) -> float:
    if is_response(bands):
        return LABEL_HEIGHT + response_height(bands)
    return LABEL_HEIGHT + BAND_PANEL_HEIGHT * len(_bodies(bands))


def _panels(figure: Figure | SubFigure, bands: xr.Dataset) -> None:
    if is_response(bands):
        response_panels(figure, bands)
        return
    bodies = _bodies(bands)
    rows = {body: [k for k, own in enumerate(bands["body"].values) if str(own) == body] for body in bodies}
    loops = [str(body) for body in bands["loop_body"].values] if "loop_body" in bands else []
    columns = max(len(own) + (body in loops) for body, own in rows.items())
    grid = figure.subplots(len(bodies), columns, squeeze=False)
    for body, line in zip(bodies, grid, strict=True):
        panels = list(line)
        if body in loops:
            _loop_bands(panels.pop(0), bands, body, loops.index(body))
        for axes, row in zip(panels, rows[body], strict=False):
            _deviation(axes, bands, row)
        for axes in panels[len(rows[body]) :]:
            axes.set_axis_off()


def _shown(bands: xr.Dataset) -> slice:
    """Samples of the first period, or all."""
    time, period = bands["time"].values, bands.attrs.get("period")
    if period is None:
        return slice(None)
    return slice(0, int(np.searchsorted(time, time[0] + period * (1.0 + PERIOD_MARGIN))))


def _row(bands: xr.Dataset, body: str, channel: str) -> int:
    own = zip(bands["body"].values, bands["channel"].values, strict=True)
    return next(k for k, (b, c) in enumerate(own) if (str(b), str(c)) == (body, channel))


def _loop_bands(axes: Axes, bands: xr.Dataset, body: str, loop: int) -> None:
    rows, span = [_row(bands, body, channel) for channel in STATE], _shown(bands)
    measured = bands["measured"].values[rows]
    factor, unit = shown_unit("m", float(np.abs(measured[0]).max()))
    scale = np.array([factor, 1.0])[:, None]
    for name, looks in (("loop_sample", WITH_NOISE), ("loop_curve", OF_CURVE)):
        ends = bands[name].values[:, :, loop, span] * scale
        if "period" in bands.attrs:
            ends = np.concatenate([ends, ends[..., :1]], axis=-1)
        for look, (low, high) in zip(looks, ((0, -1), (1, -2)), strict=True):
            around = np.concatenate([ends[low], ends[high][:, ::-1]], axis=1)
            axes.fill(*around, zorder=2.5, **look)
    dots(axes, *(scale * measured))
    median = bands["median"].values[rows][:, span] * scale
    axes.plot(*median, color=LINE, linewidth=0.6, zorder=3)
    axes.set(xlabel=f"Displacement [{unit}]", ylabel="Velocity [m/s]", title=body)
    axes.margins(0.08)


def _deviation(axes: Axes, bands: xr.Dataset, row: int) -> None:
    """Draw a channel less its median over time."""
    span, channel = _shown(bands), str(bands["channel"].values[row])
    time = bands["time"].values[span] - float(bands["time"].values[0])
    middle = bands["median"].values[row, span]
    usable = (channel != "velocity") | (bands["trust"].values[span] >= MIN_PREDICTIVE_TRUST)
    measured = np.where(usable, bands["measured"].values[row, span] - middle, np.nan)
    sample = bands["sample"].values[:, row, span] - middle
    largest = max(float(np.nanmax(np.abs(own[..., usable]), initial=0.0)) for own in (measured, sample))
    factor, unit = shown_unit(str(bands["unit"].values[row]), largest)
    seconds, unit_of_time = shown_unit("s", float(time[-1]))
    for name, looks in (("sample", WITH_NOISE), ("curve", OF_CURVE)):
        ends = factor * np.where(usable, bands[name].values[:, row, span] - middle, np.nan)
        for look, (low, high) in zip(looks, ((0, -1), (1, -2)), strict=True):
            axes.fill_between(seconds * time, ends[low], ends[high], **look)
    dots(axes, seconds * time, factor * measured)
    axes.axhline(0.0, color=LINE, linewidth=0.6)
    axes.set(xlabel=f"Time [{unit_of_time}]", title=f"{channel} - median [{unit}]")
    axes.margins(x=0.01)
    reach = BAND_MARGIN * factor * max(_typical(measured), _typical(np.where(usable, sample, np.nan)))
    axes.set_ylim(-reach, reach)


def _typical(values: np.ndarray) -> float:
    """Size that `TYPICAL_SHARE` of the values do not exceed; NaN does not count."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.quantile(known, TYPICAL_SHARE)) if known.size and known.any() else 1.0


def _band_legend(figure: Figure | SubFigure) -> None:
    handles: Sequence[Line2D | Patch] = [
        Line2D([], [], color=MEASURED, marker=".", markersize=6, linestyle="none", label="measured"),
        Line2D([], [], color=LINE, linewidth=0.8, label="median"),
        Patch(label="curve, 50 %", **OF_CURVE[1]),
        Patch(label="95 %", **OF_CURVE[0]),
        Patch(label="with noise, 50 %", **WITH_NOISE[1]),
        Patch(label="95 %", **WITH_NOISE[0]),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=6, columnspacing=1.2, handletextpad=0.5)
