"""How pictures look: colours, sizes, units, and their way to SVG and PNG.

Colours are Okabe and Ito's (2008), told apart by colour-blind readers; measured is always grey dots, simulated always a
blue line. Figures are made without pyplot, so they can be drawn in any thread or process.
"""

import io
import math

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from calib.units import MICRO, MICRO_BELOW, MILLI

MEASURED, SIMULATED, MARK, LINE = "#8a8a8a", "#0072B2", "#D55E00", "#333333"
KINDS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442")
FAILED, OTHER = "#000000", "#999999"
DPI = 150  # of pictures on their own
WIDTH = 7.4  # inch: the text width of an A4 page
DOTS = 700  # measured samples drawn as dots in one panel
SAMPLES = 1500  # points of a drawn line
STYLE = {
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
}


def shown_unit(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit for a reader: mm, ms, g where nothing exceeds half an m, s, kg; um, us, mg where all is tiny."""
    if unit == "kg" and abs(largest) <= 5e-4:
        return 1e6, "mg"
    if unit in MICRO and 0.0 < abs(largest) < MICRO_BELOW:
        return MICRO[unit]
    small = {**MILLI, "kg": (1e3, "g")}
    return small[unit] if unit in small and abs(largest) <= 0.5 else (1.0, unit or "1")


def dots(axes, x: np.ndarray, y: np.ndarray) -> None:
    """Measured samples: at most DOTS grey dots."""
    keep = thin(x.size, DOTS)
    look = {"color": MEASURED, "markersize": spot(keep.size, 5.0), "markeredgewidth": 0, "alpha": 0.7}
    axes.plot(x[keep], y[keep], ".", zorder=2, **look)


def spot(count: int, small: float = 2.0) -> float:
    """Size of `count` dots [points]: `small` where there are many, larger where so few would hardly be seen."""
    return float(np.clip(small * math.sqrt(300.0 / max(1, count)), small, 8.0))


def line(axes, x: np.ndarray, y: np.ndarray, colour: str = SIMULATED, width: float = 1.0) -> None:
    """Draw y over x, or where there are far more samples than pixels the band between its extremes."""
    if x.size <= 4 * SAMPLES:
        keep = thin(x.size, 2 * SAMPLES)
        axes.plot(x[keep], y[keep], color=colour, linewidth=width, solid_joinstyle="round", zorder=3)
    else:
        band(axes, x, y, colour, 0.75)


def band(axes, x: np.ndarray, y: np.ndarray, colour: str, alpha: float) -> None:
    """Band between the extremes of y in 500 stretches of x."""
    starts = np.linspace(0, x.size, 501).astype(int)[:-1]
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    axes.fill_between(x[starts], low, high, color=colour, alpha=alpha, linewidth=0.7, zorder=3)


def marks(axes, places: np.ndarray) -> None:
    """Vertical dashed lines where impacts are."""
    for place in places:
        axes.axvline(place, color=MARK, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)


def logarithmic(axis, low: float, high: float) -> None:
    """Ticks of a logarithmic axis that do not run into one another: decades, or parts of them where there are few."""
    decades = math.log10(high / low)
    if decades < 2.5:
        steps = (1.0, 3.0) if decades > 1.2 else (1.0, 2.0, 5.0) if decades > 0.75 else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def thin(size: int, most: int) -> np.ndarray:
    """At most `most` indices over `size`, in steps of unequal length, so that they do not lock to a period."""
    return np.unique(np.linspace(0, size - 1, min(size, most)).round().astype(int))


def legend(figure: Figure, simulated: bool) -> None:
    """Legend of measured and simulated above the panels."""
    handles = [mpl.lines.Line2D([], [], color=MEASURED, marker=".", markersize=6, linestyle="none", label="measured")]
    if simulated:
        handles.append(mpl.lines.Line2D([], [], color=SIMULATED, linewidth=1.5, label="simulated"))
    figure.legend(handles=handles, loc="outside upper right", ncols=2, columnspacing=1.2, handletextpad=0.5)


def svg(figure: Figure, name: str) -> str:
    """Return the figure as an SVG element for a page; `name` keeps the ids of several figures apart."""
    with mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        text = io.StringIO()
        figure.savefig(text, format="svg", dpi=160, metadata={"Date": None, "Creator": None})
    whole = text.getvalue()
    return whole[whole.index("<svg") :].strip()


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG at its own resolution, quickly rather than small."""
    FigureCanvasAgg(figure)
    data = io.BytesIO()
    figure.savefig(data, format="png", pil_kwargs={"compress_level": 3})
    return data.getvalue()
