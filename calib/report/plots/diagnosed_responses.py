"""Residual of a diagnosed frequency response over frequency and level; responses as in `calib.diagnosis.artifacts`."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from calib.report.plots.diagnosed_cycles import compared_rows
from calib.report.plots.measured_response import sweep_legend, sweep_look
from calib.report.plots.style import LINE, STYLE, TEXT_WIDTH
from calib.report.response_description import part_text

NOISE = "#e4e4e4"  # band of the noise of a point


def response_residual_figure(motion: xr.Dataset, label: str = "") -> Figure | None:
    """Residual of each part of each body over frequency, a colour a level; beside it that of the extended model.

    Gross errors are left out.

    label : name of the extended model, whose residual is drawn too where there is one
    """
    compared = compared_rows(motion)
    if not compared:
        return None
    models = {"calibrated": "calibrated model"}
    if label and "extended" in motion:
        models["extended"] = label
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 1.7 * len(compared) + 0.7), layout="constrained")
        grid = figure.subplots(len(compared), len(models), squeeze=False, sharex=True, sharey="row")
        for panels, (row, body, channel, _) in zip(grid, compared, strict=True):
            for axes, model in zip(panels, models, strict=True):
                _residual(axes, motion, row, motion.measured.values[row] - motion[model].values[row])
            panels[0].set_ylabel(f"residual of {body}:\n{part_text(channel)}\n[standard uncertainties]")
        for axes, title in zip(grid[0], models.values(), strict=True):
            axes.set_title(title)
        for axes in grid[-1]:
            axes.set_xlabel("Frequency of the excitation [Hz]")
        sweep_legend(figure, motion, Patch(color=NOISE, label="noise, ±2 standard deviations"))
    return figure


def _residual(axes: Axes, motion: xr.Dataset, row: int, residual: np.ndarray) -> None:
    sigma = float(motion.sigma[row])
    axes.axhspan(-2.0 * sigma, 2.0 * sigma, color=NOISE, linewidth=0, zorder=0)
    axes.axhline(0.0, color=LINE, linewidth=0.6, zorder=1)
    counts = motion.weight.values[row] > 0.0
    if "gross_error" in motion:
        residual = np.where(motion["gross_error"].values == 0, residual, np.nan)
    for points, look in sweep_look(motion):
        own = points[counts[points]]
        axes.plot(motion.frequency.values[own], residual[own], markersize=3.5, linewidth=0.6, **look)
    axes.margins(x=0.02)
