"""The style of figures: colours, sizes, units of axes, output as SVG and PNG.

Colours are Okabe and Ito's (2008), which colour-blind readers can distinguish; measured data are always grey dots,
simulated ones a blue line. Figures are made without pyplot, so they can be drawn in any thread or process.
"""

import io
import math
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import Formatter, LogFormatterMathtext, LogLocator, MaxNLocator, NullFormatter

from calib.report.formatting import number, raised

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

Look = dict[str, Any]  # keyword arguments of matplotlib for the look of a line, a patch or a text

MEASURED, SIMULATED, MARK, LINE = "#8a8a8a", "#0072B2", "#D55E00", "#333333"
EXTENDED = "#009E73"  # the extended model: the calibrated one with the effects that the diagnosis added
KINDS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442")
FAILED, OTHER = "#000000", "#999999"
BASE_LOOK: Look = {"color": "#E69F00", "linewidth": 1.0, "linestyle": (0, (4, 1.5))}  # of a model without its extension
DPI = 150  # dots per inch of figures in files of their own
SVG_DPI = 160  # of images within an SVG element
TEXT_WIDTH = 7.4  # inch: the text width of an A4 page
MAX_LEGEND_WIDTH = 0.97  # of a legend over that of its figure, which leaves the margins free  [1]
MIN_DECADES = 0.3  # of a logarithmic axis with its ticks at steps of the decade  [1]
NARROW_TICKS = 3  # intervals, at most, between ticks of an axis of fewer decades
MAX_SAMPLE_DOTS = 700  # measured samples drawn as dots in one panel
MAX_LINE_SAMPLES = 1500  # points of a drawn line
STYLE: "dict[RcKeyType, Any]" = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica"],
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": LINE,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "xtick.color": LINE,
    "ytick.color": LINE,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "svg.fonttype": "none",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "text.parse_math": False,  # a name may hold dollars; texts that calib writes in LaTeX say parse_math=True
}


class PowerLabels(LogFormatterMathtext):
    """Labels of a logarithmic axis: raised powers at the decades, numbers between; matplotlib's own are in LaTeX."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Write the label of a tick; "" where matplotlib leaves it out."""
        if not super().__call__(x, pos):
            return ""
        power = round(math.log10(abs(x))) if x else 0
        if math.isclose(abs(x), 10.0**power):
            return f"{'-' if x < 0.0 else ''}{raised(f'10^{power}')}"
        return number(float(x))


class NumberLabels(Formatter):
    """Labels with numbers as the report writes them. A class, since figures are handed to the processes that draw."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Write the label of a tick."""
        return number(float(x))


def dots(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw measured samples as grey dots, at most MAX_SAMPLE_DOTS of them."""
    keep = thin(x.size, MAX_SAMPLE_DOTS)
    look: Look = {"color": MEASURED, "markersize": spot(keep.size, 5.0), "markeredgewidth": 0, "alpha": 0.7}
    axes.plot(x[keep], y[keep], ".", zorder=2, **look)


def spot(count: int, small: float = 2.0) -> float:
    """Size of each of `count` dots [points]: `small` for many dots, larger for few."""
    return float(np.clip(small * math.sqrt(300.0 / max(1, count)), small, 8.0))


def line(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str = SIMULATED, width: float = 1.0) -> None:
    """Draw y over x, or the band between its extremes where there are far more samples than pixels."""
    if x.size <= 4 * MAX_LINE_SAMPLES:
        keep = thin(x.size, 2 * MAX_LINE_SAMPLES)
        axes.plot(x[keep], y[keep], color=colour, linewidth=width, solid_joinstyle="round", zorder=3)
    else:
        band(axes, x, y, colour, 0.75)


def band(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, alpha: float) -> None:
    """Draw the band between the extremes of y in 500 intervals of x."""
    starts = np.linspace(0, x.size, 501).astype(int)[:-1]
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    axes.fill_between(x[starts], low, high, color=colour, alpha=alpha, linewidth=0.7, zorder=3)


def mark_impacts(axes: Axes, times: np.ndarray) -> None:
    """Draw a vertical dashed line at each impact; `times` (n,) are in the unit of the axis."""
    for time in times:
        axes.axvline(time, color=MARK, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)


def label_powers(axis: Axis) -> None:
    """Label the ticks of a logarithmic axis without LaTeX; those between the decades where there are few decades."""
    axis.set_major_formatter(PowerLabels())
    axis.set_minor_formatter(PowerLabels(labelOnlyBase=False))


def logarithmic(axis: Axis, low: float, high: float) -> None:
    """Set ticks of a logarithmic axis whose labels do not overlap: decades, or steps within few decades."""
    axis.set_major_formatter(PowerLabels())
    decades = math.log10(high / low)
    if decades < 2.5:
        steps: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
        if decades > 0.75:
            steps = (1.0, 3.0) if decades > 1.2 else (1.0, 2.0, 5.0)
        locator = LogLocator(subs=steps)
        between = [tick for tick in locator.tick_values(low, high) if low <= tick <= high]
        axis.set_major_locator(locator if len(between) > 1 and decades > MIN_DECADES else MaxNLocator(NARROW_TICKS))
        axis.set_major_formatter(NumberLabels())
    axis.set_minor_formatter(NullFormatter())


def thin(size: int, max_count: int) -> np.ndarray:
    """At most `max_count` indices below `size`, unevenly spaced so that they do not alias with a period."""
    return np.unique(np.linspace(0, size - 1, min(size, max_count)).round().astype(int))


def base_line(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw the curve of the model without its extension."""
    keep = thin(x.size, 2 * MAX_LINE_SAMPLES)
    axes.plot(x[keep], y[keep], zorder=2.5, **BASE_LOOK)


def legend(figure: Figure | SubFigure, simulated: bool, base: bool = False) -> None:
    """Draw the legend of measured and simulated data above the panels, and of a model without its extension."""
    handles = [Line2D([], [], color=MEASURED, marker=".", markersize=6, linestyle="none", label="measured")]
    if simulated:
        handles.append(Line2D([], [], color=SIMULATED, linewidth=1.5, label="simulated"))
    if base:
        handles.append(Line2D([], [], label="without the extension", **BASE_LOOK))
    figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.2, handletextpad=0.5)


def fitted_legend(
    figure: Figure, handles: list[Artist], most: int, room: float = MAX_LEGEND_WIDTH, **look: Any
) -> Legend:
    """Draw a legend above the panels, of as many columns as the width of the figure has room for.

    Parameters
    ----------
    most : columns
    room : for the legend, over the width of the figure  [1]
    look : keyword arguments of `Figure.legend`
    """
    renderer = FigureCanvasAgg(figure).get_renderer()
    for columns in range(min(most, len(handles)), 1, -1):
        drawn = figure.legend(handles=handles, ncols=columns, **look)
        if drawn.get_window_extent(renderer).width <= room * figure.bbox.width:
            return drawn
        drawn.remove()
    return figure.legend(handles=handles, ncols=1, **look)


def svg(figure: Figure, name: str, outlines: bool = False) -> str:
    """Return the figure as an SVG element for a page; `name` keeps the ids of several figures apart.

    outlines : whether letters are drawn as outlines, which need no font and keep their places
    """
    with mpl.rc_context({**STYLE, "svg.hashsalt": name, "svg.fonttype": "path" if outlines else "none"}):
        text = io.StringIO()
        figure.set_dpi(SVG_DPI)
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})  # savefig would draw twice
    whole = text.getvalue()
    return whole[whole.index("<svg") :].strip()


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG at its own resolution; compression favours speed over size."""
    FigureCanvasAgg(figure)
    data = io.BytesIO()
    figure.savefig(data, format="png", pil_kwargs={"compress_level": 3})
    return data.getvalue()
