"""Frequency response: amplitude and phase over the frequency of the excitation, a colour a level."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from calib.report.plots.continuation import DASHED, SPECIAL, Colour, stability_line
from calib.report.plots.style import LINE, OTHER, STYLE, Look
from calib.report.plots.sweeps import BESIDE, WIDE_FIGURE_WIDTH, channel_scale, known_bodies
from calib.units import plain_number, shown_unit

LEVELS = mpl.colormaps["viridis"]  # colours of the levels
LIGHTEST = 0.82  # of the colour map: the yellow beyond it is too light on white  [1]


def response_figure(response: xr.Dataset, body: str, harmonic: int = 1) -> Figure:
    """Amplitude and phase of a harmonic of a body's displacement, stable motions solid and unstable ones dashed.

    Parameters
    ----------
    response : of `calib.dynamics.response_dataset.response_dataset`
    body : to draw
    harmonic : of the excitation's frequency

    Raises
    ------
    CalibError : an unknown body
    """
    known_bodies(response, [body])
    own = response.sel(body=body, harmonic=harmonic)
    scale, unit = channel_scale(own.amplitude)
    levels = np.unique(response.branch_level.values)
    colours = {level: LEVELS(LIGHTEST * i / max(1, levels.size - 1)) for i, level in enumerate(levels.tolist())}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 5.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.0, 1.6])
        for index, level in enumerate(response.branch_level.values.tolist()):
            part = own.isel(point=np.flatnonzero(own.branch_of_point.values == index))
            stable = part.stable.values.astype(bool)
            stability_line(upper, part.frequency.values, scale * part.amplitude.values, stable, colours[level])
            stability_line(lower, part.frequency.values, _unwrapped(part.phase.values), stable, colours[level])
        marks = _specials(upper, own, scale)
        marks += _irregular(upper, response, colours)
        _levels(upper, response, colours, marks)
        upper.set(ylim=(0.0, None), ylabel=f"{body}: amplitude of\nharmonic {harmonic} [{unit}]")
        lower.set(
            xlabel="Frequency of the excitation [Hz]", ylabel="Phase [deg]",
            xlim=(response.attrs["lowest_frequency"], response.attrs["highest_frequency"]),
        )  # fmt: skip
        lower.yaxis.set_major_locator(MaxNLocator(6, steps=[1.0, 1.5, 3.0, 4.5, 9.0, 10.0]))
        figure.align_ylabels([upper, lower])
        figure.suptitle(str(response.attrs.get("model", "")), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _unwrapped(phase: np.ndarray) -> np.ndarray:
    """Phase without jumps [deg], the middle of the curve between -360 and 0: a response lags its excitation."""
    whole = np.degrees(np.unwrap(phase))
    return whole - 360.0 * np.ceil(np.median(whole) / 360.0) if whole.size else whole


def _specials(axes: Axes, own: xr.Dataset, scale: float) -> list[Line2D]:
    """Mark the points at which motions change; return an entry of the legend by kind."""
    handles = []
    kinds = own.special_kind.values.astype(str)
    heights = scale * own.amplitude.values[own.special_point.values.astype(int)]
    for kind in dict.fromkeys(kinds.tolist()):
        marker, colour = SPECIAL.get(kind, ("P", OTHER))
        look: Look = {"color": colour, "marker": marker, "linestyle": "none", "markeredgecolor": "white"}
        mine = kinds == kind
        axes.plot(
            own.special_frequency.values[mine], heights[mine], markersize=6, markeredgewidth=0.6, zorder=5, **look
        )
        handles.append(Line2D([], [], markersize=6, markeredgewidth=0.5, label=kind, **look))
    return handles


def _irregular(axes: Axes, response: xr.Dataset, colours: Mapping[float, Colour]) -> list[Line2D]:
    """Mark on the axis of frequency where a sweep meets motions that no branch follows."""
    if not response.sizes["irregular"]:
        return []
    look: Look = {"marker": "|", "linestyle": "none", "markeredgewidth": 1.5}
    at_axis: Look = {"transform": axes.get_xaxis_transform(), "markersize": 9, "clip_on": False, "zorder": 5}
    for level, colour in colours.items():
        for place in response.irregular_frequency.values[response.irregular_level.values == level]:
            axes.plot([place], [0.0], color=colour, **look, **at_axis)
    return [Line2D([], [], label="not followed", color=LINE, markersize=7, **look)]


def _levels(axes: Axes, response: xr.Dataset, colours: Mapping[float, Colour], marks: list[Line2D]) -> None:
    """Say the levels, the highest first as in the picture, and what is marked."""
    unit = response.branch_level.attrs["units"]
    factor, name = shown_unit(unit, max(colours))
    handles = [
        Line2D([], [], color=colour, linewidth=1.5, label=f"{plain_number(factor * level)} {name}")
        for level, colour in sorted(colours.items(), reverse=True)
    ]
    if not response.stable.all():
        handles.append(Line2D([], [], color=LINE, linewidth=1.1, linestyle=DASHED, label="unstable"))
    axes.legend(handles=[*handles, *marks], **BESIDE)
