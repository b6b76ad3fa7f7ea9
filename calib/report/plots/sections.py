"""Figures in a plane of states: stroboscopic sections of motions, and basins of attraction."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.plots.style import LINE, OTHER, STYLE, Look
from calib.report.plots.sweeps import (
    COEXISTING,
    FAILED,
    WIDE_FIGURE_WIDTH,
    SweptParameter,
    branch_colour,
    branch_entries,
    branch_size,
    branches,
    cells,
    channel_scale,
    coexisting,
    dot,
    kind_colour,
    limits,
    parameters,
    patch,
    swept,
    title,
)
from calib.units import plain_number

PANELS_PER_ROW = 3  # panels side by side
BASIN_COLOURS = (
    "#9ecae8",
    "#f6c667",
    "#8fd3bd",
    "#e6b8d3",
    "#f2ee9a",
    "#e0a07f",
    "#b9b9e0",
)  # pale, because dots lie on top
MAX_LARGE_DOTS = 64  # distinct points of a section up to which they are drawn as large dots


class Limits(NamedTuple):
    """Ends of both axes of a panel; None where there is nothing to show."""

    x: tuple[float, float] | None
    y: tuple[float, float] | None


def sections(sweep: xr.Dataset, max_panels: int = 6) -> Figure | None:
    """Section of each body in its plane of displacement and velocity, a panel for each value; None beyond `max_panels`.

    Parameters
    ----------
    sweep : displacement [m] and velocity [m/s] over (branch, body, cycle, *parameters), kind (branch, *parameters);
        branch is optional, and so are other_displacement and other_velocity, with the dimension other
    max_panels : largest number of values, or combinations of values of several parameters, that are drawn
    """
    dims = [str(d) for d in sweep.kind.dims if d != "branch"]
    count = math.prod(sweep.sizes[d] for d in dims)
    if count > max_panels:
        return None
    names = parameters(sweep)
    wanted = ("displacement", "velocity", "kind", "other_displacement", "other_velocity")
    drawn = sweep[[name for name in wanted if name in sweep and sweep[name].size]]  # empty arrays cannot be stacked
    runs = drawn.sortby([d for d in dims if d != "point"]).stack(run=dims, create_index=False)
    bodies = [str(body) for body in sweep.body.values]
    columns, blocks = min(count, PANELS_PER_ROW), math.ceil(count / PANELS_PER_ROW)
    with mpl.rc_context(STYLE):
        size = (WIDE_FIGURE_WIDTH if columns > 1 else 0.62 * WIDE_FIGURE_WIDTH, 2.3 * blocks * len(bodies) + 0.5)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(blocks * len(bodies), columns, squeeze=False)
        for b, body in enumerate(bodies):
            panels = grid[b :: len(bodies)].ravel()
            _panels(list(panels), runs.sel(body=body), body)
            for k in range(count):
                panels[k].set_title(_heading(runs.isel(run=k), names), fontsize=8)
        handles = branch_entries(sweep)
        if coexisting(sweep, "kind") is not None:
            handles.append(dot(COEXISTING, "coexisting motion", size=3.5))
        if handles:
            figure.legend(handles=handles, loc="outside lower center", ncols=6, handletextpad=0.3)
        figure.suptitle(title(sweep), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _panels(panels: Sequence[Axes], runs: xr.Dataset, body: str) -> None:
    """Fill the panels of one body, all with the same limits; unused ones are hidden."""
    scale, unit = channel_scale(runs.displacement)
    ends = Limits(limits(scale * runs.displacement.values), limits(runs.velocity.values))
    parts = branches(runs)
    for k, axes in enumerate(panels):
        if k >= runs.sizes["run"]:
            axes.set_visible(False)
            continue
        for _, part in parts:
            others = [coexisting(part, name) for name in ("displacement", "velocity")]
            known = [values for values in others if values is not None]
            if len(known) == 2:
                x, v = (values.isel(run=k).values.ravel() for values in known)
                look: Look = {"markersize": 1.6, "markeredgewidth": 0, "rasterized": True, "zorder": 1.5}
                axes.plot(scale * x, v, "o", color=COEXISTING, **look)
        for i, (_, part) in enumerate(parts):
            x, v = scale * part.displacement.isel(run=k).values, part.velocity.isel(run=k).values
            finite = np.isfinite(x) & np.isfinite(v)
            size = _size(x[finite], v[finite], ends) * branch_size(i, len(parts))
            look = {"markersize": size, "markeredgewidth": 0, "rasterized": True, "zorder": 2 + 0.01 * i}
            axes.plot(x[finite], v[finite], "o", color=branch_colour(i), **look)
        axes.set(xlabel=f"Displacement of {body} [{unit}]", xlim=ends.x, ylim=ends.y)
        if k % PANELS_PER_ROW == 0:
            axes.set_ylabel("Velocity [m/s]")


def _size(x: np.ndarray, y: np.ndarray, ends: Limits) -> float:
    """Size of dots [pt]: large for few distinct points, small for a curve or a cloud."""
    if not x.size or ends.x is None or ends.y is None:
        return 0.0
    share = [(values - low) / (high - low) for values, (low, high) in ((x, ends.x), (y, ends.y))]
    return 5.0 if np.unique(np.round(share, 3), axis=1).shape[1] <= MAX_LARGE_DOTS else 2.0


def _heading(run: xr.Dataset, names: Sequence[str]) -> str:
    """Values of the parameters, and on a second line the kinds of motion of the branches."""
    shown = [swept(run[name].expand_dims("run")) for name in names]
    values = ", ".join(f"{s.name} = {plain_number(s.places[0])} {s.unit}".removesuffix(" 1") for s in shown)
    return f"{values}\n{' | '.join(dict.fromkeys(np.atleast_1d(run.kind.values).astype(str)))}"


def basin_map(basins: xr.Dataset) -> Figure:
    """Attractor that each initial state in a plane leads to, with the sections of the attractors on top.

    Parameters
    ----------
    basins : attractor (y, x), a number from 0 on, or -1 where the simulation failed. The dimensions are components of
        the state such as "q3.displacement", and their coordinates have attributes units. attractor_kind (attractor,);
        optional are section_x and section_y (attractor, cycle), NaN padded: the attractors' sections in that plane
    """
    vertical, horizontal = basins.attractor.dims
    ordered = basins.sortby([horizontal, vertical])
    x, y = (swept(ordered[name])._replace(ratio=False) for name in (horizontal, vertical))
    kinds = basins.attractor_kind.values.astype(str)
    codes = np.where(ordered.attractor.values < 0, kinds.size, ordered.attractor.values)
    labels = [*(f"{k}: {kind}" for k, kind in enumerate(kinds)), FAILED]
    colours = [*(BASIN_COLOURS[k] if k < len(BASIN_COLOURS) else OTHER for k in range(kinds.size)), kind_colour(FAILED)]
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 5.6), layout="constrained")
        axes = figure.subplots()
        cells(axes, x.edges(), y.edges(), codes, colours)
        shares = [float(np.mean(codes == k)) for k in range(len(labels))]
        handles: list[Artist] = [
            patch(colours[k], f"{labels[k]} ({100.0 * shares[k]:.1f} %)") for k in range(len(labels)) if shares[k]
        ]
        for axis, over in ((axes.xaxis, x), (axes.yaxis, y)):
            over.set_axis(axes, axis, *over.edges()[[0, -1]])
        if "section_x" in basins:
            handles += _attractors(axes, basins, (x, y))
        figure.legend(
            handles=handles, loc="outside right upper", title="attractor (share of initial states)", alignment="left"
        )
        figure.suptitle(title(basins), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _attractors(axes: Axes, basins: xr.Dataset, plane: tuple[SweptParameter, SweptParameter]) -> list[Artist]:
    """Draw the sections of the attractors, each with its number at one of its points."""
    ends = Limits(axes.get_xlim(), axes.get_ylim())
    for k in range(basins.sizes["attractor"]):
        u, v = (s.scale * basins[f"section_{c}"].isel(attractor=k).values for c, s in zip("xy", plane, strict=True))
        finite = np.isfinite(u) & np.isfinite(v)
        size = _size(u[finite], v[finite], ends)
        edge: Look = {"markeredgecolor": "white", "markeredgewidth": 0.7 if size > 2.0 else 0.0}
        axes.plot(u[finite], v[finite], "o", color=LINE, markersize=size, rasterized=True, **edge)
        if finite.any():
            place = (u[finite][0], v[finite][0])
            axes.annotate(
                str(k),
                place,
                (4.0, 3.0),
                textcoords="offset points",
                annotation_clip=True,
                color=LINE,
                fontweight="bold",
            )
    axes.set(xlim=ends.x, ylim=ends.y)
    return [dot(LINE, "stroboscopic section")]
