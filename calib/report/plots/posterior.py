"""Figure of a posterior distribution: the marginal of each parameter, and of each two of them."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.confidence.document import MarginalResult, PosteriorResult
from calib.report.formatting import raised
from calib.report.plots.style import DPI, LINE, MARK, SIMULATED, STYLE, TEXT_WIDTH, logarithmic, spot
from calib.units import shown_unit

BINS = 30  # of a histogram  [count]
MIN_PANEL, MAX_PANEL = 1.1, 2.4  # side of a panel  [inch]
SAMPLE_MARGIN = 0.05  # of the range of the sample, on both sides  [1]


def posterior_figure(result: PosteriorResult, values: Mapping[str, np.ndarray], best: Mapping[str, float]) -> Figure:
    """Draw the marginals on the diagonal, with their intervals, and the sample over each two parameters below.

    Parameters
    ----------
    values : (n,) of each parameter in the sample, in SI
    best : point of the greatest likelihood, in SI
    """
    own = result.parameters
    side = float(np.clip(TEXT_WIDTH / len(own), MIN_PANEL, MAX_PANEL))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(side * len(own) + 0.6, side * len(own) + 0.4), layout="constrained", dpi=DPI)
        grid = figure.subplots(len(own), len(own), squeeze=False)
        for i, below in enumerate(own):
            for j, across in enumerate(own):
                axes = grid[i, j]
                if j > i:
                    axes.set_axis_off()
                elif i == j:
                    _marginal(axes, across, values[across.name], best[across.name])
                else:
                    _pair(axes, across, below, values)
                if i < len(own) - 1:
                    axes.tick_params(labelbottom=False)
                else:
                    axes.set_xlabel(_label(across, values[across.name]))
                if j > 0 or i == 0:
                    axes.tick_params(labelleft=False)
                else:
                    axes.set_ylabel(_label(below, values[below.name]))
        figure.align_labels()
    return figure


def _unit(marginal: MarginalResult, values: np.ndarray) -> tuple[float, str]:
    return shown_unit(marginal.unit, float(np.abs(values).max()))


def _label(marginal: MarginalResult, values: np.ndarray) -> str:
    return f"{marginal.name} [{raised(_unit(marginal, values)[1])}]"


def _marginal(axes: Axes, marginal: MarginalResult, values: np.ndarray, best: float) -> None:
    factor, _ = _unit(marginal, values)
    shown = factor * values
    edges = np.linspace(shown.min(), shown.max(), BINS + 1)
    if marginal.scale == "log":
        edges = np.geomspace(shown.min(), shown.max(), BINS + 1)
    axes.hist(shown, bins=list(edges), color=SIMULATED, alpha=0.6, linewidth=0)
    for end in (marginal.low, marginal.high):
        axes.axvline(factor * end, color=MARK, linewidth=0.9)
    axes.axvline(factor * best, color=LINE, linewidth=0.7, linestyle=(0, (2, 2)))
    axes.set_yticks([])
    _limit(axes, "x", marginal, shown)


def _pair(axes: Axes, across: MarginalResult, below: MarginalResult, values: Mapping[str, np.ndarray]) -> None:
    x, y = (_unit(one, values[one.name])[0] * values[one.name] for one in (across, below))
    axes.plot(x, y, ".", color=SIMULATED, markersize=spot(x.size, 5.0), markeredgewidth=0, alpha=0.5, rasterized=True)
    _limit(axes, "x", across, x)
    _limit(axes, "y", below, y)


def _limit(axes: Axes, which: str, marginal: MarginalResult, values: np.ndarray) -> None:
    low, high = float(values.min()), float(values.max())
    if marginal.scale == "log" and high > 2.0 * low > 0.0:
        room = (high / low) ** SAMPLE_MARGIN
        axes.set(**{f"{which}scale": "log"})
        logarithmic(getattr(axes, f"{which}axis"), low, high)
        axes.set(**{f"{which}lim": (low / room, high * room)})
    else:
        room = SAMPLE_MARGIN * (high - low)
        axes.set(**{f"{which}lim": (low - room, high + room)})
