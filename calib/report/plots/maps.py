"""Kind map: kind of motion and largest Lyapunov exponent over the two parameters of a sweep."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import CenteredNorm, Colormap
from matplotlib.figure import Figure

from calib.errors import CalibError
from calib.report.plots.style import LINE, STYLE, Look
from calib.report.plots.sweeps import (
    FAILED,
    UNCERTAIN,
    WIDE_FIGURE_WIDTH,
    SweptParameter,
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

BELOW: Look = {"loc": "outside lower center", "columnspacing": 1.4, "handletextpad": 0.5, "handlelength": 1.2}


class Panels(NamedTuple):
    """What the panels of a kind map share: parameters along both axes, kinds of motion, and limit of the exponents."""

    plane: tuple[SweptParameter, SweptParameter]
    kinds: list[str]
    half_range: float
    scattered: bool

    @property
    def norm(self) -> CenteredNorm:
        """Scale of the colours of exponents, zero in its middle."""
        return CenteredNorm(halfrange=self.half_range)


def kind_map(sweep: xr.Dataset) -> Figure:
    """Kind of motion and largest Lyapunov exponent over two parameters, a row for each branch.

    A grid is drawn as cells, a Latin hypercube as dots. Failed simulations are black in both panels. A dot marks a kind
    of motion that rounding errors could change.

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
    shared = Panels(plane, in_order(binned_kind(sweep.kind).ravel()), _half_range(sweep.exponent.values), scattered)
    parts = branches(ordered)
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 3.4 * len(parts) + 1.0), layout="constrained")
        grid = figure.subplots(len(parts), 2, squeeze=False, sharex=True, sharey=True)
        for row, (name, part) in zip(grid, parts, strict=True):
            row[0].set_title(f"{name}: kind of motion" if name else "kind of motion")
            row[1].set_title(f"{name}: largest Lyapunov exponent" if name else "largest Lyapunov exponent")
            draw = _as_dots if scattered else _as_cells
            colours = draw(row, shared, binned_kind(part.kind), part.exponent.values)
            _mark_uncertain(row[0], shared, uncertain(part))
        for axes in grid.flat:
            for axis, over in zip((axes.xaxis, axes.yaxis), plane, strict=True):
                low, high = over.surroundings() if scattered else over.edges()[[0, -1]]
                over.set_axis(axes, axis, low, high)
            axes.label_outer()
        bar = figure.colorbar(colours, ax=list(grid[:, 1]), extend="min", aspect=30)
        bar.set_label("Largest Lyapunov exponent [1/period]")
        handles = [_entry(kind, scattered) for kind in shared.kinds]
        if uncertain(sweep).any():
            handles.append(dot(UNCERTAIN, "uncertain kind", size=3.0))
        _legend(figure, handles)
        figure.suptitle(title(sweep), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure


def _plane(sweep: xr.Dataset) -> tuple[SweptParameter, SweptParameter]:
    """Return the two parameters, the first along the horizontal axis."""
    names = parameters(sweep)
    if len(names) != 2:
        raise CalibError(f"a kind map has two parameters, but this sweep has {len(names)}: {', '.join(names)}")
    scattered = "point" in sweep.kind.dims
    first, second = (swept(sweep[name] if scattered else sweep[name].sortby(name)) for name in names)
    return first, second


def _half_range(exponent: np.ndarray) -> float:
    """Half the range of the colours; strongly negative exponents are cut off so that positive ones remain visible."""
    finite = exponent[np.isfinite(exponent)]
    if not finite.size:
        return 1.0
    return max(float(finite.max()), -0.25 * float(np.percentile(finite, 5.0))) or 1.0


def _as_cells(row: Sequence[Axes], shared: Panels, kinds: np.ndarray, exponent: np.ndarray) -> ScalarMappable:
    """Draw the cells of a grid; `kinds` and `exponent` over (second, first)."""
    x, y = (over.edges() for over in shared.plane)
    codes = np.array([shared.kinds.index(kind) for kind in kinds.ravel()]).reshape(kinds.shape)
    cells(row[0], x, y, codes, [kind_colour(kind) for kind in shared.kinds])
    values = np.ma.masked_invalid(np.maximum(exponent, -shared.half_range))
    return row[1].pcolormesh(x, y, values, cmap=_diverging(), norm=shared.norm, rasterized=True)


def _as_dots(row: Sequence[Axes], shared: Panels, kinds: np.ndarray, exponent: np.ndarray) -> ScalarMappable:
    """Draw the dots of a Latin hypercube; `kinds` and `exponent` over (point,)."""
    x, y = (over.places for over in shared.plane)
    good = kinds != FAILED
    look: Look = {
        "s": float(np.clip(2e4 / x.size, 8.0, 40.0)),
        "linewidths": 0.3,
        "edgecolors": LINE,
        "rasterized": True,
    }
    row[0].scatter(x[good], y[good], c=[kind_colour(kind) for kind in kinds[good]], **look)
    for axes in row:
        axes.plot(x[~good], y[~good], "x", color=kind_colour(FAILED), markersize=3.5, markeredgewidth=0.8)
    values = np.maximum(exponent[good], -shared.half_range)
    return row[1].scatter(x[good], y[good], c=values, cmap=_diverging(), norm=shared.norm, **look)


def _mark_uncertain(axes: Axes, shared: Panels, doubtful: np.ndarray) -> None:
    """Draw dots on uncertain kinds of motion: over (second, first), or (point,)."""
    x, y = (over.places for over in shared.plane)
    if not shared.scattered:
        x, y = np.meshgrid(x, y)
    axes.plot(x[doubtful], y[doubtful], "o", color=UNCERTAIN, markersize=2.5, markeredgewidth=0)


def _diverging() -> Colormap:
    """Colours that diverge at zero: positive exponents red, negative blue, failed black."""
    return mpl.colormaps["RdBu_r"].with_extremes(bad=kind_colour(FAILED))


def _entry(kind: str, scattered: bool) -> Artist:
    colour = kind_colour(kind)
    return patch(colour, kind) if not scattered else dot(colour, kind, "x" if kind == FAILED else "o")


def _legend(figure: Figure, handles: Sequence[Artist]) -> None:
    columns = math.ceil(len(handles) / math.ceil(len(handles) / 6))
    figure.legend(handles=handles, ncols=columns, **BELOW)
