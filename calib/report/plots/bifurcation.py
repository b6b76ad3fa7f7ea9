"""Figures of a sweep over one parameter: the bifurcation diagram and the impact diagram."""

from collections.abc import Iterator, Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from calib.report.plots.style import LINE, OTHER, STYLE, Look
from calib.report.plots.sweeps import (
    BESIDE,
    COEXISTING,
    FAILED,
    UNCERTAIN,
    WIDE_FIGURE_WIDTH,
    SweptParameter,
    along_one,
    branch_colour,
    branch_entries,
    branch_size,
    branches,
    channel_scale,
    coexisting,
    dot,
    in_order,
    kind_colour,
    known_bodies,
    limits,
    patch,
    plain_kind,
    points,
    title,
    uncertain,
    with_coexisting,
)

GAP = "#e2e2e2"  # where simulations failed
ROW_SPACING = 9.0  # pt: of the rows of period labels
LETTER_WIDTH = 0.065  # inch: of a period label
PANEL_WIDTH = WIDE_FIGURE_WIDTH - 2.3  # inch, about
MIN_EXPONENT_AXIS = 0.3  # 1/period: least positive end of the axis from which its negative end is derived


def bifurcation_diagram(sweep: xr.Dataset, bodies: Sequence[str] | None = None) -> Figure:
    """Stroboscopic section of each body over the parameter, and beneath it the largest Lyapunov exponent.

    Labels above name the motion of each wide interval of one periodic motion: impacts / excitation periods per period
    of the motion, or the excitation periods alone where impacts are not counted. Values at which the simulation of any
    branch failed are grey; coexisting motions are light grey; triangles at the bottom mark values at which rounding
    errors could change the kind of motion.

    Parameters
    ----------
    sweep : of one parameter, with displacement (branch, body, cycle, parameter) [m], and over (branch, parameter) kind,
        period [1], impacts [1] and exponent [1/period]; branch is optional, and so are certain (branch, parameter) and
        the other_ variables with the dimension other
    bodies : which to draw; None draws all

    Raises
    ------
    CalibError : another number of parameters, or an unknown body
    """
    ordered, over = along_one(sweep, "a bifurcation diagram")
    shown = known_bodies(sweep, bodies)
    height = (3.4, 2.7, 2.2)[min(len(shown), 3) - 1]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, height * len(shown) + 2.0), layout="constrained")
        rows = figure.subplots(len(shown) + 1, 1, sharex=True, height_ratios=[height] * len(shown) + [1.4])
        for body, axes in zip(shown, rows, strict=False):
            values = ordered.displacement.sel(body=body)
            scale, unit = channel_scale(values)
            _draw_coexisting(axes, ordered.sel(body=body), "displacement", over, scale)
            _draw_points(axes, scale * values, over)
            ends = limits(scale * with_coexisting(ordered.sel(body=body), "displacement"))
            axes.set(ylabel=f"{body}\ndisplacement [{unit}]", ylim=ends)
        _period_labels(figure, rows[0], ordered, over)
        _exponents(rows[-1], ordered, over)
        _finish(figure, rows, ordered, over)
    return figure


def impact_diagram(sweep: xr.Dataset) -> Figure | None:
    """Phase and closing speed of the impacts over the parameter; None where there are no impacts.

    Parameters
    ----------
    sweep : of one parameter, with impact_phase [1, in periods] and impact_speed [m/s] (branch, impact, parameter), NaN
        where there is none; branch is optional

    Raises
    ------
    CalibError : another number of parameters
    """
    ordered, over = along_one(sweep, "an impact diagram")
    if not np.isfinite(sweep.impact_phase.values).any():
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 5.4), layout="constrained")
        rows = figure.subplots(2, 1, sharex=True)
        _draw_coexisting(rows[0], ordered, "impact_phase", over)
        _draw_points(rows[0], ordered.impact_phase, over)
        rows[0].set(ylabel="Impact phase [periods]", ylim=(0.0, 1.0))
        _draw_coexisting(rows[1], ordered, "impact_speed", over)
        _draw_points(rows[1], ordered.impact_speed, over)
        fastest = float(np.nanmax(with_coexisting(sweep, "impact_speed")))
        rows[1].set(ylabel="Closing speed [m/s]", ylim=(0.0, 1.05 * fastest or 1.0))
        if (sweep.kind == FAILED).any():
            rows[1].legend(handles=[_kind_entry(FAILED)], **BESIDE)
        _finish(figure, rows, ordered, over)
    return figure


def _draw_points(axes: Axes, values: xr.DataArray, over: SweptParameter) -> None:
    """Draw the finite ones among `values` ((branch,) n, parameter) as dots in the colour of their branch."""
    parts = [values.isel(branch=i) for i in range(values.sizes["branch"])] if "branch" in values.dims else [values]
    clouds = [points(part, over) for part in parts]
    largest = float(np.clip(450.0 / over.places.size, 1.4, 1.8)) * (1.3 if len(parts) > 1 else 1.0)
    for i, (x, y) in enumerate(clouds):
        look: Look = {"color": branch_colour(i), "markersize": largest * branch_size(i, len(parts))}
        axes.plot(x, y, "o", markeredgewidth=0, rasterized=True, zorder=2 + 0.01 * i, **look)


def _draw_coexisting(axes: Axes, sweep: xr.Dataset, name: str, over: SweptParameter, scale: float = 1.0) -> None:
    """Draw the same of the coexisting motions as smaller dots underneath."""
    others = coexisting(sweep, name)
    if others is not None:
        look: Look = {"color": COEXISTING, "markersize": float(np.clip(450.0 / over.places.size, 1.0, 1.4))}
        axes.plot(*points(scale * others, over), "o", markeredgewidth=0, rasterized=True, zorder=1.5, **look)


def _finish(figure: Figure, rows: Sequence[Axes], sweep: xr.Dataset, over: SweptParameter) -> None:
    """Mark failed simulations and uncertain kinds; add the legend, the axis of the parameter and the title."""
    failed = (sweep.kind == FAILED).any([d for d in sweep.kind.dims if d != over.dim]).values
    edges = over.edges()
    spans = [(edges[first], edges[last + 1]) for _, first, last in _intervals([FAILED if x else "" for x in failed])]
    for axes in rows:
        for span in spans:
            axes.axvspan(*span, facecolor=GAP, edgecolor=OTHER, linewidth=0.6, zorder=1)
    handles: list[Artist] = [*branch_entries(sweep)]
    if coexisting(sweep, "kind") is not None:
        handles.append(dot(COEXISTING, "coexisting motion", size=3.5))
    doubtful = uncertain(sweep).reshape(-1, over.places.size).any(axis=0)
    if doubtful.any():
        at = rows[0].get_xaxis_transform()
        look: Look = {"color": UNCERTAIN, "markersize": 4.5, "markeredgewidth": 0, "clip_on": False, "zorder": 4}
        rows[0].plot(over.places[doubtful], np.zeros(doubtful.sum()), "^", transform=at, **look)
        handles.append(dot(UNCERTAIN, "uncertain kind", "^"))
    if handles and rows[0].get_legend() is None:
        rows[0].legend(handles=handles, **BESIDE)
    over.set_axis(rows[-1], rows[-1].xaxis, edges[0], edges[-1])
    figure.align_ylabels(rows)
    figure.suptitle(title(sweep), x=0.01, horizontalalignment="left", fontsize=9.5)


def _exponents(axes: Axes, sweep: xr.Dataset, over: SweptParameter) -> None:
    """Draw the largest Lyapunov exponent, coloured by kind of motion; values below the axis are marked at its end."""
    low, high = _exponent_limits(sweep.exponent.values)
    axes.axhline(0.0, color=LINE, linewidth=0.8, zorder=1.5)
    parts, kinds = branches(sweep), plain_kind(sweep.kind)
    for i, (_, part) in enumerate(parts):
        exponent, kind = part.exponent.values, plain_kind(part.kind)
        axes.plot(over.places, np.maximum(exponent, low), color=branch_colour(i), linewidth=0.4, alpha=0.45, zorder=2)
        others = coexisting(part, "exponent")
        if others is not None:
            x, y = points(others, over)
            axes.plot(x, np.maximum(y, low), "o", color=COEXISTING, markersize=2.2, markeredgewidth=0, zorder=1.8)
        for name in in_order(kind[kind != FAILED]):
            look: Look = {"color": kind_colour(name), "markeredgewidth": 0, "linestyle": "none", "zorder": 3}
            mine = (kind == name) & (exponent >= low)
            size = 3.4 * branch_size(i, len(parts))
            axes.plot(over.places[mine], exponent[mine], "o", markersize=size, rasterized=True, **look)
            mine = (kind == name) & (exponent < low)
            if mine.any():  # an empty line that is not clipped would still take room beside the panel
                axes.plot(over.places[mine], np.full(mine.sum(), low), "v", markersize=3.4, clip_on=False, **look)
    axes.set(ylim=(low, high), ylabel="Largest Lyapunov\nexponent [1/period]")
    below = [dot(OTHER, "below the axis", "v")] if (sweep.exponent < low).any() else []
    axes.legend(handles=[_kind_entry(name) for name in in_order(kinds.ravel())] + below, **BESIDE)


def _exponent_limits(exponent: np.ndarray) -> tuple[float, float]:
    """Ends of the axis of exponents; strongly negative ones are cut off so that positive ones remain visible."""
    finite = exponent[np.isfinite(exponent)]
    top = finite.max(initial=0.0)
    low = max(finite.min(initial=0.0), -3.0 * max(MIN_EXPONENT_AXIS, top))
    span = (top - low) or 1.0
    return low - 0.06 * span, top + 0.12 * span


def _kind_entry(kind: str) -> Artist:
    return patch(GAP, kind) if kind == FAILED else dot(kind_colour(kind), kind)


def _period_labels(figure: Figure, axes: Axes, sweep: xr.Dataset, over: SweptParameter) -> None:
    """Label periodic motions above the panel: a row for each branch, a bracket for each wide interval."""
    bounds = np.log(over.edges()) if over.ratio else over.edges()
    share = (bounds - bounds[0]) / (bounds[-1] - bounds[0])
    parts = branches(sweep)
    for i, (_, part) in enumerate(parts):
        lift = (3.0 + ROW_SPACING * (len(parts) - 1 - i)) / 72.0
        above = axes.transAxes + ScaledTranslation(0.0, lift, figure.dpi_scale_trans)
        look: Look = {"color": branch_colour(i) if len(parts) > 1 else LINE, "transform": above}
        for text, first, last in _intervals(_motion_labels(part)):
            start, end = share[first] + 0.003, share[last + 1] - 0.003  # apart from its neighbours
            if (end - start) * PANEL_WIDTH > LETTER_WIDTH * (len(text) + 1):
                axes.plot([start, end], [1.0, 1.0], linewidth=0.8, clip_on=False, **look)
                axes.text(0.5 * (start + end), 1.0, text, fontsize=6.5, ha="center", va="bottom", **look)
    if axes.texts:
        counted = "impacts/periods" if (sweep.impacts >= 0).any() else "periods"
        look = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "bottom"}
        axes.annotate(f"{counted}\nof the motion", (1.0, 1.0), (8.0, 3.0), fontsize=6.5, color=LINE, **look)


def _motion_labels(part: xr.Dataset) -> list[str]:
    """Label of the motion at each value: impacts / excitation periods of one period, "" where it is not periodic."""
    pairs = zip(part.period.values.astype(int), part.impacts.values.astype(int), strict=True)
    return ["" if n <= 0 else f"{p}/{n}" if p >= 0 else f"{n}" for n, p in pairs]


def _intervals(labels: Sequence[str]) -> Iterator[tuple[str, int, int]]:
    """(label, first, last) of the intervals over which a label that is not empty is constant."""
    starts = [0, *(i for i in range(1, len(labels)) if labels[i] != labels[i - 1])]
    ends = [*starts[1:], len(labels)]
    return ((labels[a], a, b - 1) for a, b in zip(starts, ends, strict=True) if labels[a])
