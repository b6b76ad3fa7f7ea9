"""Axes, branches and colours of the figures of sweeps.

Colours of kinds of motion differ from those of branches, because both stand in one figure. They are Okabe and Ito's
(2008), the wine red of Tol's muted scheme, and shades where more are needed.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from calib.errors import CalibError, nearest
from calib.report.plots.style import LINE, OTHER, TEXT_WIDTH, Look, logarithmic
from calib.units import shown_unit

WIDE_FIGURE_WIDTH = 1.2 * TEXT_WIDTH  # inch: of a figure in a file of its own
FAILED = "failed"
KIND_COLOURS = {  # in the order of a legend: from regular to irregular, then unknown kinds
    "no contact": "#bbbbbb",
    "periodic": "#009E73",
    "period-1": "#009E73",
    "period-2": "#56B4E9",
    "period-3": "#0072B2",
    "period-4": "#c5e6a6",
    "period-5 to 8": "#F0E442",
    "longer period": "#9a7d0a",
    "quasi-periodic": "#E69F00",
    "chaotic": "#882255",
    "undecided": "#777777",
    FAILED: "#000000",
}
BRANCH_COLOURS = ("#0072B2", "#D55E00", "#000000", "#56B4E9", "#009E73", "#CC79A7")
COEXISTING = "#a6a6a6"  # further attractors at a value, beside the one that gives its kind of motion
UNCERTAIN = "#CC79A7"  # values at which rounding errors could change the kind of motion
BESIDE: Look = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0, "handletextpad": 0.5}


class SweptParameter(NamedTuple):
    """A swept parameter as it is drawn.

    Attributes
    ----------
    dim : dimension of the sweep along which it changes
    name : as in the sweep's command
    unit : in which it is shown
    scale : factor from SI to that unit
    places : (n,) values  [unit]
    ratio : whether the axis is logarithmic
    """

    dim: str
    name: str
    unit: str
    scale: float
    places: np.ndarray
    ratio: bool

    @property
    def label(self) -> str:
        """Name and unit for an axis."""
        return f"{self.name} [{self.unit}]"

    def edges(self) -> np.ndarray:
        """Bounds (n + 1,) of the cells around the places of a grid, half-way between neighbours on the axis."""
        centres = np.log(self.places) if self.ratio else self.places
        if centres.size == 1:
            half = 0.05 * abs(centres[0]) or 0.5
            return np.array([centres[0] - half, centres[0] + half])
        middles = 0.5 * (centres[1:] + centres[:-1])
        bounds = np.concatenate([[2.0 * centres[0] - middles[0]], middles, [2.0 * centres[-1] - middles[-1]]])
        return np.exp(bounds) if self.ratio else bounds

    def surroundings(self) -> tuple[float, float]:
        """Ends of an axis for scattered places."""
        centres = np.log(self.places) if self.ratio else self.places
        low, high = float(centres.min()), float(centres.max())
        margin = 0.03 * (high - low) or 0.05 * abs(high) or 0.5
        ends = np.array([low - margin, high + margin])
        low, high = np.exp(ends) if self.ratio else ends
        return float(low), float(high)

    def set_axis(self, axes: Axes, axis: Axis, low: float, high: float) -> None:
        """Give an axis of a panel the parameter's label and scale, and these ends."""
        horizontal = axis is axes.xaxis
        if self.ratio:
            (axes.set_xscale if horizontal else axes.set_yscale)("log")
            logarithmic(axis, low, high)
        (axes.set_xlim if horizontal else axes.set_ylim)(low, high)
        axis.set_label_text(self.label)


def parameters(sweep: xr.Dataset) -> tuple[str, ...]:
    """Names of the coordinates that were swept, in the order of ``--over``."""
    dims = [str(d) for d in sweep.kind.dims if d != "branch"]
    return tuple(str(c) for c in sweep.coords if sweep[c].dims == ("point",)) if dims == ["point"] else tuple(dims)


def along_one(sweep: xr.Dataset, figure: str) -> tuple[xr.Dataset, SweptParameter]:
    """Return the sweep in the order of its one parameter, and that parameter.

    Raises
    ------
    CalibError : the sweep has another number of parameters than `figure`, as in "a bifurcation diagram", has
    """
    names = parameters(sweep)
    if len(names) != 1:
        raise CalibError(
            f"{figure} has one parameter, but this sweep has {len(names)}: {', '.join(names)}; draw its kind map"
        )
    ordered = sweep.sortby(names[0])
    return ordered, swept(ordered[names[0]])


def swept(coordinate: xr.DataArray) -> SweptParameter:
    """Return the parameter of a coordinate (n,) in SI, in the unit of its axis.

    The axis is logarithmic where the values, of a grid or a Latin hypercube, are more evenly spaced on it.
    """
    values = coordinate.values.astype(float)
    scale, unit = shown_unit(coordinate.attrs.get("units", "1"), np.abs(values).max())
    name = str(coordinate.attrs.get("name", coordinate.name))
    ratio = bool(values.min() > 0.0 and values.max() > 3.0 * values.min())
    ratio = ratio and _unevenness(np.log(values)) < _unevenness(values) - 1e-9
    return SweptParameter(str(coordinate.dims[0]), name, unit, scale, scale * values, ratio)


def _unevenness(values: np.ndarray) -> float:
    """Largest distance of the sorted values from evenly spaced ones, as a share of their range."""
    spread = np.sort(values)
    return np.abs(spread - np.linspace(spread[0], spread[-1], spread.size)).max() / (spread[-1] - spread[0])


def branches(sweep: xr.Dataset) -> list[tuple[str, xr.Dataset]]:
    """(name, sweep without dimension branch) of each branch; one with the name "" where there are none."""
    if "branch" not in sweep.dims:
        return [("", sweep)]
    return [(str(name), sweep.isel(branch=i)) for i, name in enumerate(sweep.branch.values)]


def points(values: xr.DataArray, over: SweptParameter) -> tuple[np.ndarray, np.ndarray]:
    """Places and values of the finite ones among `values` (n, parameter), n being cycles or impacts."""
    table = values.transpose(..., over.dim).values
    finite = np.isfinite(table)
    return np.broadcast_to(over.places, table.shape)[finite], table[finite]


def coexisting(sweep: xr.Dataset, name: str) -> xr.DataArray | None:
    """Return `name` of the coexisting motions, with the dimension other; None where there are none."""
    has_some = sweep.sizes.get("other", 0) and f"other_{name}" in sweep
    return sweep[f"other_{name}"] if has_some else None


def with_coexisting(sweep: xr.Dataset, name: str) -> np.ndarray:
    """Values (n,) of `name` of all motions, coexisting ones included, for the limits of an axis."""
    others = coexisting(sweep, name)
    own = sweep[name].values.ravel()
    return own if others is None else np.concatenate([own, others.values.ravel()])


def uncertain(sweep: xr.Dataset) -> np.ndarray:
    """Whether rounding errors could change the kind of motion, in the shape of the kinds."""
    return ~sweep.certain.values.astype(bool) if "certain" in sweep else np.zeros(sweep.kind.shape, dtype=bool)


def branch_colour(index: int) -> str:
    """Colour of a branch; those beyond the palette share a grey."""
    return BRANCH_COLOURS[index] if index < len(BRANCH_COLOURS) else OTHER


def branch_size(index: int, count: int) -> float:
    """Size of a branch's dots as a share of the first one's.

    Later ones are smaller and lie on top, so that where branches coincide each is visible around the next.
    """
    return 1.0 if index == 0 else 1.0 - 0.5 * index / (count - 1)


def branch_entries(sweep: xr.Dataset) -> list[Line2D]:
    """Entries of a legend of branches; none where the sweep has none."""
    names = [name for name, _ in branches(sweep) if name]
    return [dot(branch_colour(i), name, size=5.0 * branch_size(i, len(names))) for i, name in enumerate(names)]


def plain_kind(kinds: xr.DataArray) -> np.ndarray:
    """Kinds of motion without their periods, as an array of texts."""
    return _renamed(kinds, lambda period: "periodic")


def binned_kind(kinds: xr.DataArray) -> np.ndarray:
    """Kinds of motion with long periods taken together, as an array of texts."""
    return _renamed(kinds, lambda n: f"period-{n}" if n <= 4 else "period-5 to 8" if n <= 8 else "longer period")


def _renamed(kinds: xr.DataArray, periodic: Callable[[int], str]) -> np.ndarray:
    """Kinds of motion, those with a period renamed by it."""
    texts, index = np.unique(kinds.values.astype(str), return_inverse=True)
    names = [periodic(int(t.removeprefix("period-"))) if t.startswith("period-") else t for t in texts]
    return np.array(names)[index].reshape(kinds.shape)


def kind_colour(kind: str) -> str:
    """Colour of a plain or binned kind of motion."""
    return KIND_COLOURS.get(kind, OTHER)


def in_order(kinds: Iterable[str]) -> list[str]:
    """Return each kind once, in the order of a legend; unknown ones last."""
    known = list(KIND_COLOURS)
    return sorted(set(kinds), key=lambda kind: (known.index(kind) if kind in known else len(known), kind))


def dot(colour: str, label: str, marker: str = "o", size: float = 4.5) -> Line2D:
    """Entry of a legend with one marker."""
    look: Look = {"markersize": size, "markeredgewidth": 1.0 if marker == "x" else 0.0, "linestyle": "none"}
    return Line2D([], [], color=colour, marker=marker, label=label, **look)


def patch(colour: str, label: str) -> Patch:
    """Entry of a legend with a coloured area."""
    return Patch(facecolor=colour, edgecolor=LINE, linewidth=0.4, label=label)


def cells(axes: Axes, x: np.ndarray, y: np.ndarray, codes: np.ndarray, colours: Sequence[str]) -> None:
    """Draw codes (y, x), indices into `colours`, as cells between the bounds x and y."""
    ends: Look = {"vmin": -0.5, "vmax": len(colours) - 0.5}
    axes.pcolormesh(x, y, codes, cmap=ListedColormap(list(colours)), rasterized=True, **ends)


def channel_scale(values: xr.DataArray) -> tuple[float, str]:
    """Factor and unit in which a channel is drawn."""
    finite = np.abs(values.values[np.isfinite(values.values)])
    return shown_unit(values.attrs.get("units", "1"), finite.max(initial=0.0))


def limits(values: np.ndarray) -> tuple[float, float] | None:
    """Ends of an axis for the finite ones among `values`, None where there are none.

    The axis of a constant value spans a hundredth of it, so that rounding errors are not magnified.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = float(finite.min()), float(finite.max())
    margin = max(0.05 * (high - low), 5e-3 * max(abs(low), abs(high))) or 0.5
    return low - margin, high + margin


def known_bodies(dataset: xr.Dataset, bodies: Sequence[str] | None) -> list[str]:
    """Return the bodies to draw, all where none are given.

    Raises
    ------
    CalibError : an unknown body
    """
    known = [str(body) for body in dataset.body.values]
    for body in bodies or ():
        if body not in known:
            raise CalibError(f"there is no body {body!r} here{nearest(body, known)}; there are {', '.join(known)}")
    return list(bodies or known)


def title(dataset: xr.Dataset) -> str:
    """Name the model, and the phase of the excitation at which the stroboscopic section is taken."""
    parts = [str(dataset.attrs["model"])] if "model" in dataset.attrs else []
    if "phase" in dataset.attrs:
        parts.append(f"stroboscopic section at phase {float(dataset.attrs['phase']):.4g} of the excitation period")
    return ", ".join(parts)
