"""Picture of a sweep over its two parameters: kind of motion and largest exponent."""

import math

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.colors import CenteredNorm
from matplotlib.figure import Figure

from calib.errors import CalibError
from calib.report.drawing import LINE, STYLE
from calib.report.sweeps import (
    FAILED,
    UNCERTAIN,
    WIDE,
    binned_kind,
    branches,
    cells,
    dot,
    in_order,
    kind_colour,
    parameters,
    patch,
    swept,
    title,
    uncertain,
)

BELOW = {"loc": "outside lower center", "columnspacing": 1.4, "handletextpad": 0.5, "handlelength": 1.2}


def kind_map(sweep: xr.Dataset) -> Figure:
    """Kind of motion and largest exponent over two parameters, a row for each branch.

    A grid is drawn as cells, a Latin hypercube as dots. What failed is black, in both panels. A dot marks a kind that
    another rounding could have changed.

    Parameters
    ----------
    sweep : of two parameters, with kind and exponent [1/period] over (branch, first, second) or (branch, point);
        branch is optional

    Raises
    ------
    CalibError : another number of parameters
    """
    plane = _plane(sweep)
    scattered = plane[0].dim == "point"
    ordered = sweep if scattered else sweep.sortby([x.dim for x in plane]).transpose(..., *(x.dim for x in plane[::-1]))
    present = in_order(binned_kind(sweep.kind).ravel())
    norm = CenteredNorm(halfrange=_half_range(sweep.exponent.values))
    parts = branches(ordered)
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(WIDE, 3.4 * len(parts) + 1.0), layout="constrained")
        grid = figure.subplots(len(parts), 2, squeeze=False, sharex=True, sharey=True)
        for row, (name, part) in zip(grid, parts, strict=True):
            row[0].set_title(f"{name}: kind of motion" if name else "kind of motion")
            row[1].set_title(f"{name}: largest exponent" if name else "largest exponent")
            draw = _as_dots if scattered else _as_cells
            colours = draw(row, plane, binned_kind(part.kind), part.exponent.values, present, norm)
            _mark(row[0], plane, uncertain(part), scattered)
        for axes in grid.flat:
            for axis, over in zip((axes.xaxis, axes.yaxis), plane, strict=True):
                over.lay(axis, *(over.surroundings() if scattered else over.edges()[[0, -1]]))
            axes.label_outer()
        figure.colorbar(colours, ax=list(grid[:, 1]), label="Largest exponent [1/period]", extend="min", aspect=30)
        doubt = [dot(UNCERTAIN, "uncertain", size=3.0)] if uncertain(sweep).any() else []
        _legend(figure, [_entry(kind, scattered) for kind in present] + doubt)
        figure.suptitle(title(sweep), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _plane(sweep):
    """Return the two parameters, the first along the horizontal axis."""
    names = parameters(sweep)
    if len(names) != 2:
        raise CalibError(f"a kind map has two parameters, but this sweep has {len(names)}: {', '.join(names)}")
    scattered = "point" in sweep.kind.dims
    return [swept(sweep[name] if scattered else sweep[name].sortby(name)) for name in names]


def _half_range(exponent):
    """Half the range of the colours: chaos is to be seen, however strongly periodic motions attract."""
    finite = exponent[np.isfinite(exponent)]
    if not finite.size:
        return 1.0
    return max(float(finite.max()), -0.25 * float(np.percentile(finite, 5.0))) or 1.0


def _as_cells(row, plane, kinds, exponent, present, norm):
    """Cells of a grid; `kinds` and `exponent` over (second, first)."""
    edges = [over.edges() for over in plane]
    codes = np.array([present.index(kind) for kind in kinds.ravel()]).reshape(kinds.shape)
    cells(row[0], *edges, codes, [kind_colour(kind) for kind in present])
    values = np.ma.masked_invalid(np.maximum(exponent, -norm.halfrange))
    return row[1].pcolormesh(*edges, values, cmap=_signed(), norm=norm, rasterized=True)


def _as_dots(row, plane, kinds, exponent, present, norm):
    """Dots of a Latin hypercube; `kinds` and `exponent` over (point,)."""
    x, y = (over.places for over in plane)
    good = kinds != FAILED
    look = {"s": float(np.clip(2e4 / x.size, 8.0, 40.0)), "linewidths": 0.3, "edgecolors": LINE, "rasterized": True}
    row[0].scatter(x[good], y[good], c=[kind_colour(kind) for kind in kinds[good]], **look)
    for axes in row:
        axes.plot(x[~good], y[~good], "x", color=kind_colour(FAILED), markersize=3.5, markeredgewidth=0.8)
    values = np.maximum(exponent[good], -norm.halfrange)
    return row[1].scatter(x[good], y[good], c=values, cmap=_signed(), norm=norm, **look)


def _mark(axes, plane, doubtful, scattered):
    """Dots on what is uncertain: over (second, first), or (point,)."""
    x, y = (over.places for over in plane) if scattered else np.meshgrid(*(over.places for over in plane))
    axes.plot(x[doubtful], y[doubtful], "o", color=UNCERTAIN, markersize=2.5, markeredgewidth=0)


def _signed():
    """Colours that part at zero: growth red, decay blue, failed black."""
    return mpl.colormaps["RdBu_r"].with_extremes(bad=kind_colour(FAILED))


def _entry(kind, scattered):
    colour = kind_colour(kind)
    return patch(colour, kind) if not scattered else dot(colour, kind, "x" if kind == FAILED else "o")


def _legend(figure, handles):
    columns = math.ceil(len(handles) / math.ceil(len(handles) / 6))
    figure.legend(handles=handles, ncols=columns, **BELOW)
