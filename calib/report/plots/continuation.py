"""Branch diagram: periodic motions followed over a parameter, with their multipliers."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from calib.errors import CalibError
from calib.report.plots.style import KINDS, LINE, MEASURED, OTHER, SIMULATED, STYLE, Look
from calib.report.plots.sweeps import (
    BESIDE,
    WIDE_FIGURE_WIDTH,
    SweptParameter,
    along_one,
    branches,
    channel_scale,
    dot,
    known_bodies,
    points,
    swept,
    title,
)

Colour = str | tuple[float, float, float, float]
FAINT = "#b5b5b5"  # dots of a sweep behind a branch
DASHED = (0.0, (3.0, 1.5))  # line style: offset, then dash and gap, in line widths
SPECIAL = {  # marker and colour of the bifurcation and grazing points of a branch
    "fold": ("s", KINDS[1]),
    "flip": ("D", KINDS[2]),
    "Neimark-Sacker": ("o", KINDS[3]),
    "grazing": ("X", "#000000"),
    "branching": ("P", KINDS[4]),
}
MAX_MODULUS = 3.0  # upper end of the axis of multipliers, which are unbounded near grazing  [1]


def branch_diagram(followed: Sequence[xr.Dataset], body: str, sweep: xr.Dataset | None = None) -> Figure:
    """Branches of periodic motions of a body over one parameter, their bifurcation points, and their multipliers.

    Parameters
    ----------
    followed : datasets of `calib.dynamics.branch.Branch.dataset`, one or more
    body : to draw
    sweep : over the same parameter; its stroboscopic section is drawn behind

    Raises
    ------
    CalibError : an unknown body, or branches or a sweep over something else
    """
    known_bodies(followed[0], [body])
    parameters = [swept(branch.parameter) for branch in followed]
    widest = max(parameters, key=lambda own: np.abs(own.places).max(initial=0.0) / own.scale)
    parameters = [_in_unit_of(own, widest, "another branch") for own in parameters]
    grid = None
    if sweep is not None:
        known_bodies(sweep, [body])
        grid = _in_unit_of(along_one(sweep, "the background of a branch diagram")[1], widest, "the sweep")
    # the scale of the axis cannot be inferred from the spacing of steps along a branch
    parameters = [own._replace(ratio=grid is not None and grid.ratio) for own in parameters]
    scale, unit = channel_scale(followed[0].displacement.sel(body=body))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 5.6), layout="constrained")
        rows = upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.6, 1.6])
        handles = [
            Line2D([], [], color=SIMULATED, linewidth=1.5, label="stable"),
            Line2D([], [], color=SIMULATED, linewidth=1.1, linestyle=DASHED, label="unstable"),
        ]
        marks: dict[str, Line2D] = {}
        for branch, over in zip(followed, parameters, strict=True):
            heights = scale * branch.displacement.sel(body=body).values
            for height in heights:
                stability_line(upper, over.places, height, branch.stable.values.astype(bool), SIMULATED)
            marks |= _special_points(rows, branch, over, heights)
            _multipliers(lower, branch, over)
        handles += marks.values()
        if sweep is not None and grid is not None:
            handles += _behind(upper, sweep, body, grid, scale)
        upper.set_ylabel(f"{body}\ndisplacement [{unit}]")
        upper.legend(handles=handles, **BESIDE)
        top = max(np.nanmax(np.append(branch.multiplier_modulus.values, 1.0)) for branch in followed)
        lower.axhline(1.0, color=LINE, linewidth=0.8, zorder=1.5)
        lower.set(ylim=(0.0, min(MAX_MODULUS, 1.15 * top)), ylabel="Modulus of\nmultipliers [1]")
        ends = np.array([s.surroundings() for s in (*parameters, grid) if s is not None and s.places.size])
        parameters[0].set_axis(lower, lower.xaxis, ends.min(), ends.max())
        figure.align_ylabels(rows)
        figure.suptitle(title(followed[0]), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _in_unit_of(own: SweptParameter, other: SweptParameter, what: str) -> SweptParameter:
    """Return the parameter `own` in the unit of `other`; `what` names its source in an error."""
    if own.name != other.name:
        raise CalibError(f"the branch follows {other.name!r}, but {what} is over {own.name!r}; choose its own")
    return own._replace(places=own.places * (other.scale / own.scale), scale=other.scale, unit=other.unit)


def stability_line(axes: Axes, x: np.ndarray, y: np.ndarray, stable: np.ndarray, colour: Colour) -> None:
    """Draw a curve (m,) solid where it is stable and dashed elsewhere; the step between belongs to the dashed part."""
    beside = ~stable
    beside[1:] |= ~stable[:-1]
    beside[:-1] |= ~stable[1:]
    axes.plot(x, np.where(stable, y, np.nan), color=colour, linewidth=1.5, zorder=3)
    axes.plot(x, np.where(beside, y, np.nan), color=colour, linewidth=1.1, linestyle=DASHED, zorder=3)


def _special_points(
    rows: tuple[Axes, Axes], branch: xr.Dataset, over: SweptParameter, heights: np.ndarray
) -> dict[str, Line2D]:
    """Mark bifurcation and grazing points; return an entry of the legend by kind."""
    upper, _ = rows
    kinds = branch.special_kind.values.astype(str)
    places = over.scale * branch.special_parameter.values
    for axes in rows:
        axes.vlines(
            places, 0.0, 1.0, transform=axes.get_xaxis_transform(),
            color=MEASURED, linewidth=0.6, linestyle=(0, (1, 2)), zorder=1,
        )  # fmt: skip
    handles = {}
    for kind in dict.fromkeys(kinds):
        marker, colour = SPECIAL.get(kind, ("P", OTHER))
        look: Look = {"color": colour, "marker": marker, "linestyle": "none", "markeredgecolor": "white"}
        mine = kinds == kind
        index = branch.special_index.values[mine].astype(int)
        for height in heights:
            upper.plot(places[mine], height[index], markersize=7, markeredgewidth=0.7, zorder=5, **look)
        handles[kind] = Line2D([], [], markersize=6.5, markeredgewidth=0.5, label=kind, **look)
    return handles


def _behind(axes: Axes, sweep: xr.Dataset, body: str, grid: SweptParameter, scale: float) -> list[Line2D]:
    """Draw the stroboscopic section of the sweep as faint dots; return its entry of the legend."""
    ordered = sweep.sortby(grid.dim)
    for _, part in branches(ordered):
        x, y = points(scale * part.displacement.sel(body=body), grid)
        axes.plot(x, y, "o", color=FAINT, markersize=1.3, markeredgewidth=0, rasterized=True, zorder=1.5)
    return [dot(FAINT, "sweep", size=3.5)]


def _multipliers(axes: Axes, branch: xr.Dataset, over: SweptParameter) -> None:
    modulus = branch.multiplier_modulus.transpose("step", "multiplier").values
    axes.plot(over.places, modulus, color=SIMULATED, linewidth=0.9, zorder=3)
