"""Figure of a window: slices through the calibrated point, projections, and what bounds the window where."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from calib.confidence.window.document import ParameterTolerance, WindowResult
from calib.confidence.window.words import percent
from calib.report.plots.continuation import SPECIAL, stability_line
from calib.report.plots.style import FAILED, LINE, MARK, STYLE, Look, fitted_legend, label_powers
from calib.units import count, shown_unit

WINDOW_PANEL = 1.45  # inch, side of a panel
LEAST_WIDTH = 4.2  # inch, of the figure: that of the longest entry of the legend
PANEL_LABELS, LEFT_LABELS = 0.5, 0.74  # inch, below the panels and on their left
LEGEND_GAP = 0.12  # inch, between legend and panels
TITLE_HEIGHT = 0.42  # inch
LEGEND_COLUMNS = 3  # at most
LEGEND_ROOM = 0.96  # right end of the legend over the width of the figure; letters of a browser may be wider  [1]
PROJECTION_CELLS = 20  # along each side of a projection
INSIDE_COLOUR = "#0072B2"
CAUSE_COLOURS = ("#E69F00", "#CC79A7", "#009E73", "#F0E442", "#56B4E9", "#999999")  # of what bounds the window
PALENESS = 0.45  # of a cause's colour, towards white  [1]
WRONG_COLOUR = "#777777"  # of points of another kind


def window_figure(result: WindowResult, dataset: xr.Dataset) -> Figure:
    """Matrix over the parameters: slices below the diagonal, projections above it, what each may vary alone on it.

    Parameters
    ----------
    dataset : of window.nc
    """
    names = list(map(str, dataset.parameter.values))
    dim, causes = len(names), list(map(str, dataset.slice_mechanism_label.values))
    with mpl.rc_context({**STYLE, "axes.grid": False, "axes.spines.top": True, "axes.spines.right": True}):
        width, height = max(WINDOW_PANEL * dim + 1.6, LEAST_WIDTH), (WINDOW_PANEL + 0.12) * dim
        figure = Figure(figsize=(width, height))
        panels = figure.subplots(dim, dim, squeeze=False)
        for row in range(dim):
            for column in range(dim):
                axes = panels[row, column]
                if row == column:
                    _draw_line(axes, result, dataset, row)
                elif row > column:
                    _draw_slice(axes, result, dataset, (column, row), causes)
                else:
                    _draw_projection(axes, result, dataset, (column, row))
                _label(axes, result, dataset, row, column)
        _head(figure, result, [*_legend(causes), *_exact_legend(dataset)], height)
    return figure


def _head(figure: Figure, result: WindowResult, handles: list[Artist], height: float) -> None:
    """Write title and legend above the panels, for which the figure grows; these take `height`  [inch]."""
    left = LEFT_LABELS / figure.get_figwidth()
    legend = fitted_legend(
        figure, handles, LEGEND_COLUMNS, LEGEND_ROOM - left, loc="upper left", fontsize=7.5, borderpad=0.0,
        handlelength=1.4, columnspacing=1.2,
    )  # fmt: skip
    top = TITLE_HEIGHT + legend.get_window_extent().height / figure.dpi + LEGEND_GAP
    whole = PANEL_LABELS + height + top
    figure.set_figheight(whole)
    legend.set_bbox_to_anchor((left, 1.0 - TITLE_HEIGHT / whole))
    figure.subplots_adjust(
        left=left, right=0.985, bottom=PANEL_LABELS / whole, top=1.0 - top / whole, wspace=0.12, hspace=0.12
    )
    title = f"{result.name}: {percent(result.share)} of the box is admissible"
    interval = f"95 % interval {percent(result.share_low)} to {percent(result.share_high)}"
    text = f"{title}\n{interval} ({count(result.points, 'point')})"
    figure.suptitle(text, x=left, y=1.0 - 0.08 / whole, ha="left", va="top", fontsize=9)


def _legend(causes: list[str]) -> list[Artist]:
    handles: list[Artist] = [Patch(color=INSIDE_COLOUR, label="admissible (below: slice, above: volume of the others)")]
    handles += [Patch(color=_pale(k), label=f"outside: {cause}") for k, cause in enumerate(causes)]
    handles += [
        Line2D([], [], color=LINE, linewidth=1.2, label="boundary (dotted: 5 and 95 %)"),
        Line2D([], [], color=MARK, marker="+", linestyle="", markersize=8, markeredgewidth=1.6, label="calibrated"),
        Line2D([], [], color=MARK, linewidth=1.0, linestyle="--", label="largest box inside"),
        Line2D([], [], color=LINE, marker=".", linestyle="", markersize=4, label="evaluated, admissible"),
        Line2D(
            [], [], color=WRONG_COLOUR, marker="x", linestyle="", markersize=3.5, label="evaluated, of another kind"
        ),
    ]
    return handles


def _exact_legend(dataset: xr.Dataset) -> list[Artist]:
    kinds = sorted({kind for kind, _ in _exact_kinds(dataset)})
    return [Line2D([], [], color=SPECIAL[kind][1], linewidth=1.5, label=f"{kind}, by continuation") for kind in kinds]


def _pale(cause: int) -> tuple[float, float, float]:
    red, green, blue = to_rgb(CAUSE_COLOURS[cause % len(CAUSE_COLOURS)])
    return 1.0 - PALENESS * (1.0 - red), 1.0 - PALENESS * (1.0 - green), 1.0 - PALENESS * (1.0 - blue)


def _scaled(result: WindowResult, dataset: xr.Dataset, axis: int) -> tuple[np.ndarray, float, str]:
    """Nodes of a parameter in the unit in which it is shown, the factor from SI, and that unit."""
    nodes = dataset.node_value.values[axis]
    factor, unit = shown_unit(result.parameters[axis].unit, float(np.abs(nodes).max()))
    return factor * nodes, factor, unit


def _draw_slice(
    axes: Axes, result: WindowResult, dataset: xr.Dataset, pair: tuple[int, int], causes: list[str]
) -> None:
    i, j = pair
    [k] = [
        k
        for k, (a, b) in enumerate(zip(dataset.pair_first.values, dataset.pair_second.values, strict=True))
        if (a, b) == (dataset.parameter.values[i], dataset.parameter.values[j])
    ]
    (x, fx, _), (y, fy, _) = _scaled(result, dataset, i), _scaled(result, dataset, j)
    probability, mechanism = dataset.slice_probability.values[k], dataset.slice_mechanism.values[k]
    outside = np.array([_pale(cause) for cause in range(len(causes))])[mechanism]
    colours = probability[..., None] * np.array(to_rgb(INSIDE_COLOUR)) + (1.0 - probability[..., None]) * outside
    axes.pcolormesh(x, y, colours, shading="nearest", rasterized=True)
    _draw_exact(axes, result, dataset, pair, k)
    if probability.min() < 0.5 < probability.max():
        axes.contour(x, y, probability, levels=[0.5], colors=LINE, linewidths=1.2)
    if probability.min() < 0.05 and probability.max() > 0.95:
        axes.contour(x, y, probability, levels=[0.05, 0.95], colors=LINE, linewidths=0.6, linestyles="dotted")
    one, other = result.parameters[i], result.parameters[j]
    if None not in (one.together_low, one.together_high, other.together_low, other.together_high):
        _draw_box(axes, one, other, fx, fy)
    axes.plot(fx * one.value, fy * other.value, "+", color=MARK, markersize=8, markeredgewidth=1.6)


def _draw_exact(axes: Axes, result: WindowResult, dataset: xr.Dataset, pair: tuple[int, int], k: int) -> None:
    """Curves that continuation has followed over the slice, dashed where they bound no stable motion."""
    for kind, curve in _exact_kinds(dataset):
        if dataset.exact_pair.values[curve] != k:
            continue
        mine = dataset.exact_curve_of_step.values == curve
        nodes, scaled = dataset.node_u.values, [_scaled(result, dataset, axis)[0] for axis in pair]
        u = dataset.exact_u.values[mine]
        x, y = (np.interp(u[:, side], nodes[axis], scaled[side]) for side, axis in enumerate(pair))
        stability_line(axes, x, y, dataset.exact_bounding.values.astype(bool)[mine], SPECIAL[kind][1])


def _exact_kinds(dataset: xr.Dataset) -> list[tuple[str, int]]:
    """Kind and number of each curve; none where they were not asked for."""
    return [] if "exact_kind" not in dataset else [(str(kind), k) for k, kind in enumerate(dataset.exact_kind.values)]


def _draw_box(axes: Axes, one: ParameterTolerance, other: ParameterTolerance, fx: float, fy: float) -> None:
    low = fx * (one.together_low or 0.0), fy * (other.together_low or 0.0)
    high = fx * (one.together_high or 0.0), fy * (other.together_high or 0.0)
    axes.add_patch(
        Rectangle(low, high[0] - low[0], high[1] - low[1], fill=False, edgecolor=MARK, linewidth=1.0, linestyle="--")
    )


def _draw_projection(axes: Axes, result: WindowResult, dataset: xr.Dataset, pair: tuple[int, int]) -> None:
    """Admissible volume over two parameters, relative to where it is largest, and the evaluated points."""
    i, j = pair
    nodes = dataset.node_u.values
    edges = [np.linspace(nodes[axis, 0], nodes[axis, -1], PROJECTION_CELLS + 1) for axis in (i, j)]
    u, probability = dataset.sample_u.values, dataset.sample_probability.values
    volume, _, _ = np.histogram2d(u[:, i], u[:, j], bins=edges, weights=probability)
    value, factors = [], []
    for edge, axis in zip(edges, (i, j), strict=True):
        scaled, factor, _ = _scaled(result, dataset, axis)
        value.append(np.interp(edge, nodes[axis], scaled))
        factors.append(factor)
    look: Look = {"cmap": "Blues", "vmin": 0.0, "vmax": max(float(volume.max()), 1e-9), "rasterized": True}
    axes.pcolormesh(*value, volume.T, **look)
    points, right = dataset.value.values[:, [i, j]] * factors, dataset.of_measured_kind.values
    admissible = dataset.admissible.values
    axes.plot(*points[~right].T, "x", color=WRONG_COLOUR, markersize=2.0, markeredgewidth=0.5)
    axes.plot(*points[admissible].T, ".", color=FAILED, markersize=1.6, alpha=0.7)


def _draw_line(axes: Axes, result: WindowResult, dataset: xr.Dataset, axis: int) -> None:
    """Admissible volume over a parameter, and what it may vary alone and in the largest box."""
    own, (scaled, factor, _) = result.parameters[axis], _scaled(result, dataset, axis)
    nodes, u = dataset.node_u.values[axis], dataset.sample_u.values[:, axis]
    edges = np.linspace(nodes[0], nodes[-1], PROJECTION_CELLS + 1)
    volume, _ = np.histogram(u, bins=edges, weights=dataset.sample_probability.values)
    values = np.interp(edges, nodes, scaled)
    axes.stairs(volume / max(float(volume.max()), 1e-12), values, fill=True, color=INSIDE_COLOUR, alpha=0.35)
    axes.axvspan(factor * own.alone_low, factor * own.alone_high, ymin=0.93, ymax=1.0, color=INSIDE_COLOUR, linewidth=0)
    if own.together_low is not None and own.together_high is not None:
        low, high = factor * own.together_low, factor * own.together_high
        axes.axvspan(low, high, ymin=0.84, ymax=0.91, color=MARK, linewidth=0)
    axes.axvline(factor * own.value, color=MARK, linewidth=1.0)
    axes.set_ylim(0.0, 1.2)
    axes.set_yticks([])


def _label(axes: Axes, result: WindowResult, dataset: xr.Dataset, row: int, column: int) -> None:
    """Scales, limits and names of a panel."""
    names = list(map(str, dataset.parameter.values))
    (x, _, x_unit), (y, _, y_unit) = _scaled(result, dataset, column), _scaled(result, dataset, row)
    axes.set_xlim(x[0], x[-1])
    if result.windows[names[column]].scale == "log":
        axes.set_xscale("log")
        label_powers(axes.xaxis)
    else:  # without a label at the right edge, which would run into that of the next panel
        axes.xaxis.set_major_locator(MaxNLocator(4, prune="upper"))
    if row != column:
        axes.set_ylim(y[0], y[-1])
        if result.windows[names[row]].scale == "log":
            axes.set_yscale("log")
            label_powers(axes.yaxis)
    axes.tick_params(which="both", labelsize=6.5, length=2)
    axes.tick_params(which="minor", labelbottom=False, labelleft=False, length=1)
    if row == len(names) - 1:
        axes.set_xlabel(f"{names[column]} [{x_unit}]", fontsize=8)
    else:
        axes.tick_params(labelbottom=False)
    if column == 0 and row:
        axes.set_ylabel(f"{names[row]} [{y_unit}]", fontsize=8)
    else:
        axes.tick_params(labelleft=False)
