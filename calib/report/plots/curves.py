"""Curves of folds, flips and grazings over the plane of two parameters."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from calib.report.plots.continuation import DASHED, SPECIAL, stability_line
from calib.report.plots.style import LINE, MARK, STYLE, Look
from calib.report.plots.sweeps import BESIDE, WIDE_FIGURE_WIDTH, SweptParameter, swept

MIN_LABEL_DISTANCE = 0.03  # of the axes: points of codimension two that are closer share a label


def curve_map(curves: xr.Dataset, study: tuple[float, float] | None = None) -> Figure:
    """Curves coloured by what happens at them, solid where they bound stable motion, and their special points.

    Parameters
    ----------
    curves : dataset of `calib.dynamics.curve_dataset.curves_dataset`
    study : values (SI) of both parameters in the study, marked where they are in the plane
    """
    along = [_axis(curves, name) for name in "ab"]
    kinds = curves.curve_kind.values.astype(str)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 4.6), layout="constrained")
        axes = figure.subplots()
        for index, kind in enumerate(kinds):
            mine = curves.curve_of_step.values == index
            a, b = (parameter.places[mine] for parameter in along)
            stability_line(axes, a, b, curves.bounding.values.astype(bool)[mine], SPECIAL[kind][1])
        handles = [
            Line2D([], [], color=SPECIAL[kind][1], linewidth=1.5, label=kind) for kind in SPECIAL if kind in kinds
        ]
        if not curves.bounding.all():
            handles.append(Line2D([], [], color=LINE, linewidth=1.1, linestyle=DASHED, label="of unstable motion"))
        if curves.sizes["special"]:
            handles.append(Line2D([], [], color=LINE, label="codimension two", **SPOT))
        for parameter, name, axis in zip(along, "ab", (axes.xaxis, axes.yaxis), strict=True):
            low, high = parameter.scale * curves[f"{name}_window"].values
            parameter.set_axis(axes, axis, low, high)
        _labels(axes, curves, along)
        if study is not None:
            star: Look = {"color": MARK, "marker": "*", "markersize": 11, "linestyle": "none", "zorder": 6}
            place = [value * parameter.scale for value, parameter in zip(study, along, strict=True)]
            handles += axes.plot([place[0]], [place[1]], label="the study", **star)
        axes.legend(handles=handles, **BESIDE)
        figure.suptitle(str(curves.attrs.get("model", "")), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


SPOT: Look = {
    "marker": "o", "markersize": 5.5, "markerfacecolor": "white", "markeredgewidth": 1.2, "linestyle": "none",
    "zorder": 5,
}  # fmt: skip


def _axis(curves: xr.Dataset, name: str) -> SweptParameter:
    """Return a parameter in the unit of its axis, which is that of the ends of its window."""
    ends = swept(curves[f"{name}_window"])
    own = curves[name]
    return ends._replace(name=str(own.attrs["name"]), places=ends.scale * own.values, ratio=False)


def _labels(axes: Axes, curves: xr.Dataset, along: list[SweptParameter]) -> None:
    """Mark and name the points of codimension two; close ones share a name."""
    places = np.column_stack(
        [own.scale * curves[f"special_{name}"].values for own, name in zip(along, "ab", strict=True)]
    )
    widths = np.array(
        [own.scale * np.ptp(curves[f"{name}_window"].values) for own, name in zip(along, "ab", strict=True)]
    )
    axes.plot(places[:, 0], places[:, 1], color=LINE, **SPOT)
    left = list(range(len(places)))
    while left:
        near = [i for i in left if np.linalg.norm((places[i] - places[left[0]]) / widths) < MIN_LABEL_DISTANCE]
        names = ", ".join(dict.fromkeys(str(curves.special_kind.values[i]) for i in near))
        x, y = places[near[0]]
        left_of = x > np.mean(axes.get_xlim())  # so that no name leaves the axes
        axes.annotate(
            names, (x, y), xytext=(-6 if left_of else 6, 6), textcoords="offset points", fontsize=7.5, color=LINE,
            horizontalalignment="right" if left_of else "left", zorder=6,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.75},
        )  # fmt: skip
        left = [i for i in left if i not in near]
