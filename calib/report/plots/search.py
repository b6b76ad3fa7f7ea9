"""Figures of a search: the score of its trials in order, and over each parameter."""

import math
from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from calib.modelling.parameter import Parameter, Space, Window
from calib.report.plots.style import FAILED, KINDS, LINE, MARK, OTHER, STYLE, TEXT_WIDTH, Look, logarithmic
from calib.store import Trial
from calib.units import shown_unit

MAX_VECTOR_DOTS = 400  # dots in one panel beyond which they are rasterised
LEGEND: Look = {"loc": "outside upper center", "markerscale": 1.7, "columnspacing": 1.2, "handletextpad": 0.4}


def score_history(trials: Sequence[Trial]) -> Figure:
    """Score of every trial in order by kind of motion, the best so far, and the failed trials."""
    good = [t for t in trials if t.scored]
    failed = [t.number for t in trials if not t.scored]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 2.9), layout="constrained")
        axes = figure.subplots()
        for kind, colour in kind_colours(trials).items():
            mine = [t for t in good if (t.kind or "") == kind]
            _dots(axes, [t.number for t in mine], [t.cost for t in mine], colour, kind or "unknown kind")
        if good:
            best = np.minimum.accumulate([t.cost for t in good])
            axes.step([t.number for t in good], best, where="post", color=LINE, linewidth=1.2, label="best so far")
            _score_axis(axes, good)
        _crosses(axes, failed, "failed")
        screened = [t.number for t in trials if t.phase == "screen"]
        if screened and len(screened) < len(trials):
            span = (min(screened) - 0.5, max(screened) + 0.5)
            axes.axvspan(*span, color="#f1f1f1", zorder=0, label="screening of the windows")
        axes.set(xlabel="Trial [number]", ylabel="Score [1]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.margins(x=0.01)
        figure.legend(ncols=_columns(axes), **LEGEND)
    return figure


def kinds_of_motion(
    trials: Sequence[Trial], space: Space, parameters: Mapping[str, Parameter], best: Trial | None
) -> Figure:
    """Score over each searched parameter, coloured by kind of motion; failed trials on the upper edge."""
    columns = min(3, space.dim)
    rows = math.ceil(space.dim / columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 2.0 * rows + 0.45), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for k, axes in enumerate(grid.flat[: space.dim]):
            name = space.names[k]
            parameter = parameters.get(name.partition("@")[0])
            _strip(axes, k, trials, space.windows[name], best, name, parameter.unit if parameter else "1")
        for row in grid:
            row[0].set_ylabel("Score [1]")
        for axes in grid.flat[space.dim :]:
            axes.set_visible(False)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, ncols=_columns(grid[0, 0]), **LEGEND)
    return figure


def _strip(
    axes: Axes, k: int, trials: Sequence[Trial], window: Window, best: Trial | None, name: str, unit: str
) -> None:
    """Draw the score over the k-th parameter."""
    scale, unit = shown_unit(unit, max(abs(window.low), abs(window.high)))

    def place(t: Trial) -> float:
        return scale * window.value(t.u[k])

    good = [t for t in trials if t.scored]
    for kind, colour in kind_colours(trials).items():
        mine = [t for t in good if (t.kind or "") == kind]
        _dots(axes, [place(t) for t in mine], [t.cost for t in mine], colour, kind or "unknown kind")
    _crosses(axes, [place(t) for t in trials if not t.scored], "failed")
    if best is not None and best.scored:
        look: Look = {"color": MARK, "markersize": 9, "markeredgecolor": "white", "markeredgewidth": 0.6}
        axes.plot(place(best), best.cost, "*", zorder=5, label="best", clip_on=False, **look)
    if good:
        _score_axis(axes, good)
    if window.scale == "log":
        axes.set_xscale("log")
        logarithmic(axes.xaxis, window.low, window.high)
    margin = 0.02
    if window.scale == "log":
        stretch = (window.high / window.low) ** margin
        axes.set_xlim(scale * window.low / stretch, scale * window.high * stretch)
    else:
        stretch = margin * (window.high - window.low)
        axes.set_xlim(scale * (window.low - stretch), scale * (window.high + stretch))
        axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(f"{name} [{unit}]")


def kind_colours(trials: Sequence[Trial]) -> dict[str, str]:
    """Colour of each kind of motion among the scored trials, the most regular first."""
    kinds = sorted({t.kind or "" for t in trials if t.scored}, key=_regularity)
    return {kind: KINDS[i] if kind and i < len(KINDS) else OTHER for i, kind in enumerate(kinds)}


def _regularity(kind: str) -> tuple[int, int, str]:
    digits = "".join(c for c in kind if c.isdigit())
    return (0, int(digits), kind) if digits else (1, 0, kind)


def _dots(axes: Axes, x: Sequence[float], y: Sequence[float], colour: str, label: str) -> None:
    look: Look = {
        "color": colour,
        "markersize": 5,
        "markeredgewidth": 0,
        "alpha": 0.75,
        "rasterized": len(x) > MAX_VECTOR_DOTS,
    }
    axes.plot(x, y, ".", label=label, **look)


def _crosses(axes: Axes, x: Sequence[float], label: str) -> None:
    """Draw failed trials, which have no score, on the upper edge of the panel."""
    if x:
        look: Look = {"color": FAILED, "markersize": 3.5, "markeredgewidth": 0.8, "clip_on": False}
        axes.plot(x, np.full(len(x), 1.02), "x", transform=axes.get_xaxis_transform(), label=label, **look)


def _columns(axes: Axes) -> int:
    """Columns of a legend with at most six entries a row."""
    entries = max(1, len(axes.get_legend_handles_labels()[0]))
    return math.ceil(entries / math.ceil(entries / 6))


def _score_axis(axes: Axes, good: Sequence[Trial]) -> None:
    costs = [t.cost for t in good]
    if min(costs) > 0.0:
        axes.set_yscale("log")
        logarithmic(axes.yaxis, min(costs), max(max(costs), 1.01 * min(costs)))
