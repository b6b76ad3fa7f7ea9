"""Pictures in a plane of states: sections of motions, and the basins that lead to them."""

import math

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from calib.report.drawing import LINE, OTHER, STYLE
from calib.report.sweeps import (
    COEXISTING,
    FAILED,
    WIDE,
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

COLUMNS = 3  # panels side by side
BASINS = ("#9ecae8", "#f6c667", "#8fd3bd", "#e6b8d3", "#f2ee9a", "#e0a07f", "#b9b9e0")  # pale: dots lie on top
FEW = 64  # places of a section that are drawn as large dots


def sections(sweep: xr.Dataset, most: int = 6) -> Figure | None:
    """Section of each body in its plane of displacement and velocity, a panel a value; None for more than `most`.

    Parameters
    ----------
    sweep : displacement [m] and velocity [m/s] over (branch, body, cycle, *parameters), kind (branch, *parameters);
        branch is optional, and so are other_displacement and other_velocity, with the dimension other
    most : values, or combinations of values of several parameters, that are still drawn
    """
    dims = [d for d in sweep.kind.dims if d != "branch"]
    count = math.prod(sweep.sizes[d] for d in dims)
    if count > most:
        return None
    names = parameters(sweep)
    wanted = ("displacement", "velocity", "kind", "other_displacement", "other_velocity")
    drawn = sweep[[name for name in wanted if name in sweep and sweep[name].size]]  # what is empty cannot be stacked
    runs = drawn.sortby([d for d in dims if d != "point"]).stack(run=dims, create_index=False)
    bodies = [str(body) for body in sweep.body.values]
    columns, blocks = min(count, COLUMNS), math.ceil(count / COLUMNS)
    with mpl.rc_context(STYLE):
        size = (WIDE if columns > 1 else 0.62 * WIDE, 2.3 * blocks * len(bodies) + 0.5)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(blocks * len(bodies), columns, squeeze=False)
        for b, body in enumerate(bodies):
            panels = grid[b :: len(bodies)].ravel()
            _panels(panels, runs.sel(body=body), body)
            for k in range(count):
                panels[k].set_title(_heading(runs.isel(run=k), names), fontsize=8)
        handles = branch_entries(sweep)
        if coexisting(sweep, "kind") is not None:
            handles.append(dot(COEXISTING, "coexisting motion", size=3.5))
        if handles:
            figure.legend(handles=handles, loc="outside lower center", ncols=6, handletextpad=0.3)
        figure.suptitle(title(sweep), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _panels(panels, runs, body):
    """Fill the panels of one body, all on the same axes; what is left over is hidden."""
    scale, unit = channel_scale(runs.displacement)
    ends = {"xlim": limits(scale * runs.displacement.values), "ylim": limits(runs.velocity.values)}
    parts = branches(runs)
    for k, axes in enumerate(panels):
        if k >= runs.sizes["run"]:
            axes.set_visible(False)
            continue
        for _, part in parts:
            others = [coexisting(part, name) for name in ("displacement", "velocity")]
            if others[0] is not None:
                x, v = (values.isel(run=k).values.ravel() for values in others)
                look = {"markersize": 1.6, "markeredgewidth": 0, "rasterized": True, "zorder": 1.5}
                axes.plot(scale * x, v, "o", color=COEXISTING, **look)
        for i, (_, part) in enumerate(parts):
            x, v = scale * part.displacement.isel(run=k).values, part.velocity.isel(run=k).values
            finite = np.isfinite(x) & np.isfinite(v)
            size = _size(x[finite], v[finite], ends) * branch_size(i, len(parts))
            look = {"markersize": size, "markeredgewidth": 0, "rasterized": True, "zorder": 2 + 0.01 * i}
            axes.plot(x[finite], v[finite], "o", color=branch_colour(i), **look)
        axes.set(xlabel=f"{body} displacement [{unit}]", **ends)
        if k % COLUMNS == 0:
            axes.set_ylabel("velocity [m/s]")


def _size(x, y, ends):
    """Size of dots [pt]: large where they fall on few places, small where they draw a curve or a cloud."""
    if not x.size:
        return 0.0
    share = [(values - low) / (high - low) for values, (low, high) in ((x, ends["xlim"]), (y, ends["ylim"]))]
    return 5.0 if np.unique(np.round(share, 3), axis=1).shape[1] <= FEW else 2.0


def _heading(run, names):
    """Values of the parameters, and on a second line the kinds of motion of the branches."""
    shown = [swept(run[name].expand_dims("run")) for name in names]
    values = ", ".join(f"{s.name} = {s.places[0]:.4g} {s.unit}".removesuffix(" 1") for s in shown)
    return f"{values}\n{' | '.join(dict.fromkeys(np.atleast_1d(run.kind.values).astype(str)))}"


def basin_map(basins: xr.Dataset) -> Figure:
    """Which motion each start in a plane of states ends on, with the sections of those motions on top.

    Parameters
    ----------
    basins : attractor (y, x), a number from 0 on, or -1 where the run failed. The dimensions are components of the
        state such as "q3.displacement", and their coordinates have attributes units. attractor_kind (attractor,);
        optional are section_x and section_y (attractor, cycle), NaN padded: the attractors' sections in that plane
    """
    vertical, horizontal = basins.attractor.dims
    ordered = basins.sortby([horizontal, vertical])
    x, y = plane = [swept(ordered[name])._replace(ratio=False) for name in (horizontal, vertical)]
    kinds = basins.attractor_kind.values.astype(str)
    codes = np.where(ordered.attractor.values < 0, kinds.size, ordered.attractor.values)
    labels = [*(f"{k}: {kind}" for k, kind in enumerate(kinds)), FAILED]
    colours = [*(BASINS[k] if k < len(BASINS) else OTHER for k in range(kinds.size)), kind_colour(FAILED)]
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(WIDE, 5.6), layout="constrained")
        axes = figure.subplots()
        cells(axes, x.edges(), y.edges(), codes, colours)
        shares = [float(np.mean(codes == k)) for k in range(len(labels))]
        handles = [
            patch(colours[k], f"{labels[k]} ({100.0 * shares[k]:.1f} %)") for k in range(len(labels)) if shares[k]
        ]
        for axis, over in zip((axes.xaxis, axes.yaxis), plane, strict=True):
            over.lay(axis, *over.edges()[[0, -1]])
        if "section_x" in basins:
            handles += _attractors(axes, basins, plane)
        figure.legend(handles=handles, loc="outside right upper", title="ends on (share of starts)", alignment="left")
        figure.suptitle(title(basins), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _attractors(axes, basins, plane):
    """Sections of the attractors, each with its number at one of its places."""
    ends = {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
    for k in range(basins.sizes["attractor"]):
        u, v = (s.scale * basins[f"section_{c}"].isel(attractor=k).values for c, s in zip("xy", plane, strict=True))
        finite = np.isfinite(u) & np.isfinite(v)
        size = _size(u[finite], v[finite], ends)
        edge = {"markeredgecolor": "white", "markeredgewidth": 0.7 if size > 2.0 else 0.0}
        axes.plot(u[finite], v[finite], "o", color=LINE, markersize=size, rasterized=True, **edge)
        if finite.any():
            place, look = (u[finite][0], v[finite][0]), {"textcoords": "offset points", "annotation_clip": True}
            axes.annotate(str(k), place, (4.0, 3.0), color=LINE, fontweight="bold", **look)
    axes.set(**ends)
    return [dot(LINE, "section of the motion")]
