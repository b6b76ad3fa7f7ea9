"""A digitised figure: what was traced, drawn over the picture, to check by eye."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from calib.digitise.reading import Figure as Read
from calib.execution.files import whole
from calib.report.drawing import DPI, KINDS, MARK, STYLE, png

LARGEST = 2400  # pixels of the longer side of the picture as it is drawn


def overlay(read: Read, path: str | Path) -> None:
    """Draw the traces of a picture over it, faded, with the axis points, to a PNG file.

    Gaps that were bridged are drawn dotted; a ring is an axis point as it was given, a cross where the calibration puts
    it.
    """
    light = read.light
    rows, columns = light.shape[:2]
    thin = max(1, int(np.ceil(max(rows, columns) / LARGEST)))
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(columns / thin / DPI, rows / thin / DPI), dpi=2 * DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        faded = 1.0 - 0.45 * (1.0 - light[::thin, ::thin])
        axes.imshow(faded, extent=(-0.5, columns - 0.5, rows - 0.5, -0.5), interpolation="nearest")
        for number, shown in enumerate(read.shown):
            colour = KINDS[(number + 1) % len(KINDS)] if number else MARK
            closed = shown.kind == "phase curve"
            for seen, style in ((True, "-"), (False, ":")):
                path_, hidden = shown.trace.path, shown.trace.inked != seen
                if closed:
                    path_, hidden = np.vstack([path_, path_[:1]]), np.append(hidden, hidden[:1])
                drawn = np.where(hidden[:, None], np.nan, path_)
                label = f"{shown.body}, {shown.kind}" if seen else None
                axes.plot(drawn[:, 0], drawn[:, 1], style, color=colour, linewidth=0.8, label=label)
            axes.plot(*shown.points.T, "o", color=colour, markersize=7, markerfacecolor="none", markeredgewidth=0.8)
            axes.plot(*_put(shown).T, "+", color=colour, markersize=7, markeredgewidth=0.8)
        axes.set_xlim(-0.5, columns - 0.5)
        axes.set_ylim(rows - 0.5, -0.5)
        axes.set_axis_off()
        axes.legend(loc="upper right", frameon=True, fontsize=6)
        with whole(Path(path)) as temporary:
            temporary.write_bytes(png(figure))


def _put(shown) -> np.ndarray:
    """Pixels (m, 2) at which the calibration has the numbers of the axis points; NaN where a point carries one only."""
    carried = np.array([[np.nan if v is None else v for v in pair] for pair in shown.numbers], dtype=float)
    found = np.full(carried.shape, np.nan)
    both = np.isfinite(carried).all(axis=1)
    if both.any():
        found[both] = shown.calibration.pixels(carried[both])
    return found
