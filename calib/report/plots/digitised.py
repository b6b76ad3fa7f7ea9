"""Overlay of a digitised figure: the traced curves on the original picture, for a check by eye."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.digitise.reading import Figure as DigitisedFigure
from calib.digitise.reading import PicturedCurve
from calib.errors import CalibError
from calib.execution.files import whole
from calib.report.plots.style import DPI, KINDS, MARK, STYLE, png

MAX_SIDE_PIXELS = 2400  # of the longer side of the picture as it is drawn
FADED_CONTRAST = 0.45  # share of its contrast that the original picture keeps


def overlay(figure: DigitisedFigure, path: str | Path) -> None:
    """Draw the traced curves and the axis points on the faded original picture, to a PNG file.

    Bridged gaps are dotted; rings are the axis points as given, crosses the same points by the axis calibration.

    Raises
    ------
    CalibError : the figure was read from an export, which has no picture
    """
    if figure.light is None:
        raise CalibError(f"a figure of the form {figure.form!r} has no picture to draw on; digitise a picture instead")
    rows, columns = figure.light.shape[:2]
    step = max(1, int(np.ceil(max(rows, columns) / MAX_SIDE_PIXELS)))
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        page = Figure(figsize=(columns / step / DPI, rows / step / DPI), dpi=2 * DPI)
        axes = page.add_axes((0.0, 0.0, 1.0, 1.0))
        faded = 1.0 - FADED_CONTRAST * (1.0 - figure.light[::step, ::step])
        axes.imshow(faded, extent=(-0.5, columns - 0.5, rows - 0.5, -0.5), interpolation="nearest")
        for number, curve in enumerate(figure.shown):
            _draw_curve(axes, curve, KINDS[(number + 1) % len(KINDS)] if number else MARK)
        axes.set_xlim(-0.5, columns - 0.5)
        axes.set_ylim(rows - 0.5, -0.5)
        axes.set_axis_off()
        axes.legend(loc="upper right", frameon=True, fontsize=6)
        with whole(Path(path)) as temporary:
            temporary.write_bytes(png(page))


def _draw_curve(axes: Axes, curve: PicturedCurve, colour: str) -> None:
    """Draw a traced curve with the axis points of its panel."""
    for traced, style in ((True, "-"), (False, ":")):
        trace, hidden = curve.trace.path, curve.trace.inked != traced
        if curve.kind == "phase curve":
            trace, hidden = np.vstack([trace, trace[:1]]), np.append(hidden, hidden[:1])
        drawn = np.where(hidden[:, None], np.nan, trace)
        label = f"{curve.body}, {curve.kind}" if traced else None
        axes.plot(drawn[:, 0], drawn[:, 1], style, color=colour, linewidth=0.8, label=label)
    axes.plot(*curve.points.T, "o", color=colour, markersize=7, markerfacecolor="none", markeredgewidth=0.8)
    axes.plot(*_calibrated_points(curve).T, "+", color=colour, markersize=7, markeredgewidth=0.8)


def _calibrated_points(curve: PicturedCurve) -> np.ndarray:
    """Pixels (m, 2) of the axis points by the calibration; NaN where a point carries only one number."""
    carried = np.array([[np.nan if v is None else v for v in pair] for pair in curve.numbers], dtype=float)
    pixels = np.full(carried.shape, np.nan)
    both = np.isfinite(carried).all(axis=1)
    if both.any():
        pixels[both] = curve.calibration.pixels(carried[both])
    return pixels
