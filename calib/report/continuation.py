"""Picture of branches of periodic motions."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from calib.errors import CalibError
from calib.report.drawing import KINDS, LINE, MEASURED, OTHER, SIMULATED, STYLE
from calib.report.sweeps import (
    BESIDE,
    WIDE,
    along_one,
    branches,
    channel_scale,
    dot,
    known_bodies,
    points,
    swept,
    title,
)

FAINT = "#b5b5b5"  # dots of a sweep behind a branch
DASHED = (0, (3, 1.5))
SPECIAL = {  # marker and colour of the special points of a branch
    "fold": ("s", KINDS[1]),
    "flip": ("D", KINDS[2]),
    "Neimark-Sacker": ("o", KINDS[3]),
    "grazing": ("X", "#000000"),
    "branching": ("P", KINDS[4]),
}
HIGHEST = 3.0  # modulus beyond which multipliers leave the panel: near grazing they have no bound


def branch_diagram(followed: Sequence[xr.Dataset], body: str, sweep: xr.Dataset | None = None) -> Figure:
    """Followed branches of a body over one parameter with their special points, and beneath them the multipliers.

    Parameters
    ----------
    followed : as `calib.dynamics.branch.Branch.dataset` makes them, one or more
    body : which to draw
    sweep : over the same parameter; its section is drawn behind

    Raises
    ------
    CalibError : an unknown body, or branches or a sweep over something else
    """
    known_bodies(followed[0], [body])
    parameters = [swept(branch.parameter) for branch in followed]
    widest = max(parameters, key=lambda own: np.abs(own.places).max(initial=0.0) / own.scale)
    parameters = [_alike(own, widest, "another branch") for own in parameters]
    grid = None
    if sweep is not None:
        known_bodies(sweep, [body])
        grid = _alike(along_one(sweep, "what stands behind a branch")[1], widest, "the sweep")
    # steps along a branch do not tell a scale
    parameters = [own._replace(ratio=grid is not None and grid.ratio) for own in parameters]
    scale, unit = channel_scale(followed[0].displacement.sel(body=body))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE, 5.6), layout="constrained")
        rows = upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.6, 1.6])
        handles = [
            mpl.lines.Line2D([], [], color=SIMULATED, linewidth=1.5, label="stable"),
            mpl.lines.Line2D([], [], color=SIMULATED, linewidth=1.1, linestyle=DASHED, label="unstable"),
        ]
        marks = {}
        for branch, over in zip(followed, parameters, strict=True):
            heights = scale * branch.displacement.sel(body=body).values
            _curve(upper, over.places, heights, branch.stable.values.astype(bool))
            marks |= _special_points(rows, branch, over, heights)
            _multipliers(lower, branch, over)
        handles += marks.values()
        if grid is not None:
            handles += _behind(upper, sweep, body, grid, scale)
        upper.set_ylabel(f"{body}\ndisplacement [{unit}]")
        upper.legend(handles=handles, **BESIDE)
        top = max(np.nanmax(np.append(branch.multiplier_modulus.values, 1.0)) for branch in followed)
        lower.axhline(1.0, color=LINE, linewidth=0.8, zorder=1.5)
        lower.set(ylim=(0.0, min(HIGHEST, 1.15 * top)), ylabel="Modulus of\nmultipliers [1]")
        ends = np.array([s.surroundings() for s in (*parameters, grid) if s is not None and s.places.size])
        parameters[0].lay(lower.xaxis, ends.min(), ends.max())
        figure.align_ylabels(rows)
        figure.suptitle(title(followed[0]), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _alike(own, other, what):
    """The parameter `own` in the unit of `other`."""
    if own.name != other.name:
        raise CalibError(f"the branch follows {other.name!r}, but {what} is over {own.name!r}; choose its own")
    return own._replace(places=own.places * (other.scale / own.scale), scale=other.scale, unit=other.unit)


def _curve(axes, places, heights, stable):
    """Stable parts solid, unstable ones dashed; the step from one to the other belongs to the unstable part."""
    beside = ~stable
    beside[1:] |= ~stable[:-1]
    beside[:-1] |= ~stable[1:]
    for height in heights:
        axes.plot(places, np.where(stable, height, np.nan), color=SIMULATED, linewidth=1.5, zorder=3)
        axes.plot(places, np.where(beside, height, np.nan), color=SIMULATED, linewidth=1.1, linestyle=DASHED, zorder=3)


def _special_points(rows, branch, over, heights):
    """Mark the special points; return an entry of the legend by kind."""
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
        look = {"color": colour, "marker": marker, "linestyle": "none", "markeredgecolor": "white"}
        mine = kinds == kind
        index = branch.special_index.values[mine].astype(int)
        for height in heights:
            upper.plot(places[mine], height[index], markersize=7, markeredgewidth=0.7, zorder=5, **look)
        handles[kind] = mpl.lines.Line2D([], [], markersize=6.5, markeredgewidth=0.5, label=kind, **look)
    return handles


def _behind(axes, sweep, body, grid, scale):
    """Section of the sweep as faint dots."""
    ordered = sweep.sortby(grid.dim)
    for _, part in branches(ordered):
        x, y = points(scale * part.displacement.sel(body=body), grid)
        axes.plot(x, y, "o", color=FAINT, markersize=1.3, markeredgewidth=0, rasterized=True, zorder=1.5)
    return [dot(FAINT, "sweep", size=3.5)]


def _multipliers(axes, branch, over):
    modulus = branch.multiplier_modulus.transpose("step", "multiplier").values
    axes.plot(over.places, modulus, color=SIMULATED, linewidth=0.9, zorder=3)
