"""Bands of the amplitudes that a posterior distribution predicts of a frequency response, beside what was measured."""

import math

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch

from calib.records.held_response import is_held
from calib.report.plots.measured_response import sweep_entries, sweep_look
from calib.report.plots.style import LINE
from calib.units import shown_unit

RESPONSE_PANEL_HEIGHT = 2.6  # of one body  [inch]
RESPONSE_LEGEND_COLUMNS, HELD_LEGEND_COLUMNS = 4, 3  # count: labels of a held amplitude are longer
LEGEND_ROW_HEIGHT = 0.19  # [inch]
BAND_SHADES = (("sample", 0.18), ("curve", 0.5))  # opacity of the bands with noise and without  [1]


def response_height(bands: xr.Dataset) -> float:
    """Height of the panels of a response with its legend  [inch]."""
    rows = math.ceil(len(_handles(bands)) / _columns(bands))
    return RESPONSE_PANEL_HEIGHT * bands.sizes["row"] + LEGEND_ROW_HEIGHT * rows


def response_panels(figure: Figure | SubFigure, bands: xr.Dataset) -> None:
    """Draw the amplitude of each body over frequency, and less its median: 95 % bands beside the measured points.

    bands : of a frequency response, see `calib.confidence.bands.predicted_bands`
    """
    grid = figure.subplots(bands.sizes["row"], 2, squeeze=False, sharex=True)
    for row, (left, right) in enumerate(grid):
        median = bands["median"].values[row]
        _amplitudes(left, bands, row, np.zeros(median.shape))
        _amplitudes(right, bands, row, median)
        body, unit = str(bands["body"].values[row]), left.get_ylabel()
        left.set(title=f"{body}: amplitude {unit}", ylabel="")
        right.set(title=f"amplitude - median {right.get_ylabel()}", ylabel="")
        left.set_ylim(0.0, None)
        right.axhline(0.0, color=LINE, linewidth=0.6, zorder=1)
    for axes in grid[-1]:
        axes.set_xlabel("Frequency of the excitation [Hz]")
    handles = _handles(bands)
    figure.legend(handles=handles, loc="outside upper right", ncols=_columns(bands), columnspacing=1.2)


def _amplitudes(axes: Axes, bands: xr.Dataset, row: int, origin: np.ndarray) -> None:
    """Draw bands, median and measured points of a body less an origin (point,)  [m]."""
    frequency, measured = bands["frequency"].values, bands["measured"].values[row] - origin
    factor, unit = shown_unit("m", float(np.nanmax(np.abs(measured), initial=0.0)))
    for points, look in sweep_look(bands):
        along = points[np.argsort(frequency[points], kind="stable")]
        for name, opacity in BAND_SHADES:
            ends = factor * (bands[name].values[[0, -1], row][:, along] - origin[along])
            axes.fill_between(frequency[along], *ends, color=look["color"], alpha=opacity, linewidth=0)
        axes.plot(frequency[along], factor * (bands["median"].values[row] - origin)[along], color=LINE, linewidth=0.6)
        axes.plot(frequency[points], factor * measured[points], markersize=3.0, linestyle="none", zorder=3, **look)
    axes.set_ylabel(f"[{unit}]")
    axes.margins(x=0.02)


def _columns(bands: xr.Dataset) -> int:
    return HELD_LEGEND_COLUMNS if is_held(bands) else RESPONSE_LEGEND_COLUMNS


def _handles(bands: xr.Dataset) -> list[Artist]:
    (_, with_noise), (_, of_curve) = BAND_SHADES
    return [
        *sweep_entries(bands),
        Patch(color=LINE, alpha=of_curve, linewidth=0, label="curve, 95 %"),
        Patch(color=LINE, alpha=with_noise, linewidth=0, label="with noise, 95 %"),
    ]
