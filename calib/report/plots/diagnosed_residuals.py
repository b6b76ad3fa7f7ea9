"""Figures of what a diagnosed model leaves of the records, beside the noise; motions as in `diagnosed_cycles`."""

import math

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from calib.records.cycles import harmonics
from calib.report.plots.diagnosed_cycles import IMPULSE_SAMPLES, ComparedCycle, compared_cycle, compared_rows
from calib.report.plots.style import (
    EXTENDED,
    LINE,
    MARK,
    MEASURED,
    OTHER,
    SIMULATED,
    STYLE,
    TEXT_WIDTH,
    Look,
    line,
    spot,
    thin,
)
from calib.units import shown_unit

NOISE, NOISE_OF_MEAN = "#e4e4e4", "#c2c2c2"  # bands of the noise of a sample, and of the mean of the cycles
MAX_RESIDUAL_DOTS = 1500  # samples drawn as dots in one panel
MAX_DRAWN_ORDER = 12  # of the harmonics drawn, in multiples of the excitation frequency
NOISE_PROBABILITY = 0.05  # that the amplitude of a harmonic of noise exceeds the grey bar


def residual_figure(motion: xr.Dataset, label: str = "") -> Figure | None:
    """Residual of each channel over the cycle or time with the band of the noise; beside it its harmonics.

    label : legend of the extended model, whose residual is drawn too where there is one
    """
    compared = compared_rows(motion)
    if not compared:
        return None
    periodic = "period" in motion.attrs
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 1.55 * len(compared) + 0.75), layout="constrained")
        ratios: Look = {"width_ratios": (1.9, 1.0)} if periodic else {}
        grid = figure.subplots(len(compared), 1 + periodic, squeeze=False, sharex="col", gridspec_kw=ratios)
        for (row, body, channel, unit), panels in zip(compared, grid, strict=True):
            cycle = compared_cycle(motion, row)
            largest = np.abs(motion.measured.values[row] - motion.calibrated.values[row]).max()
            factor, name = _fine(unit, max(largest, float(motion.sigma[row])))
            _residual(panels[0], motion, row, cycle, factor)
            panels[0].set_title(f"{body}: {channel}, measured minus simulated")
            panels[0].set_ylabel(f"Residual [{name}]")
            if periodic:
                _orders(panels[1], cycle, factor, name, float(motion.attrs["cycle"]))
        _label_abscissa(grid[-1, 0], motion)
        if periodic:
            grid[0, 1].set_title("harmonics of the residual")
            grid[-1, 1].set_xlabel("Harmonic order [1]")
        drawn = line_entry if periodic else dot_entry
        handles = [
            dot_entry(MEASURED, "residual"),
            *([line_entry(SIMULATED, "mean of the cycles")] if periodic else []),
            *([drawn(EXTENDED, label)] if label and "extended" in motion else []),
            Patch(color=NOISE, label="noise, ±2 standard deviations"),
            *([Patch(color=NOISE_OF_MEAN, label="mean, ±2 standard deviations")] if periodic else []),
        ]
        columns = len(handles) if len(handles) < 5 else 3
        figure.legend(handles=handles, loc="outside upper right", ncols=columns, columnspacing=1.4, handletextpad=0.5)
    return figure


def _residual(axes: Axes, motion: xr.Dataset, row: int, cycle: ComparedCycle, factor: float) -> None:
    """Draw the residual of a row over phase or time; `factor` leads from SI to the shown unit."""
    sigma = factor * float(motion.sigma[row])
    axes.axhspan(-2.0 * sigma, 2.0 * sigma, color=NOISE, linewidth=0, zorder=0)
    residual = factor * (motion.measured.values[row] - motion.calibrated.values[row])
    counts, time = motion.weight.values[row] > 0.5, motion.time.values - float(motion.time[0])
    if "period" in motion.attrs:
        time = motion.time.values / float(motion.attrs["period"]) % int(motion.attrs["cycle"])
    place, residual = time[counts], residual[counts]
    keep = thin(place.size, MAX_RESIDUAL_DOTS)
    look: Look = {"markersize": spot(keep.size), "markeredgewidth": 0, "alpha": 0.7, "rasterized": True}
    axes.plot(place[keep], residual[keep], ".", color="#777777", zorder=2, **look)
    if "period" in motion.attrs:
        axes.axhspan(
            -2.0 * factor * cycle.sigma, 2.0 * factor * cycle.sigma, color=NOISE_OF_MEAN, linewidth=0, zorder=1
        )
        for simulated, colour in ((cycle.calibrated, SIMULATED), (cycle.extended, EXTENDED)):
            if simulated is not None:
                left = np.where(cycle.weight > 0.5, factor * (cycle.measured - simulated), np.nan)
                line(axes, cycle.abscissa, left, colour, width=1.3)
        half = 0.5 / max(1.0, cycle.abscissa.size / int(motion.attrs["cycle"]))
        for phase in cycle.abscissa[cycle.weight <= 0.5]:
            axes.axvspan(phase - half, phase + half, color=MARK, alpha=0.25, linewidth=0, zorder=1)
    elif "extended" in motion:
        left = factor * (motion.measured.values[row] - motion.extended.values[row])
        axes.plot(place[keep], left[counts][keep], ".", color=EXTENDED, zorder=3, **look)
    axes.axhline(0.0, color=LINE, linewidth=0.6, zorder=1)
    axes.margins(x=0.01)
    limit = max(np.quantile(np.abs(residual), 0.998), 3.0 * sigma) * 1.12 if residual.size else 3.0 * sigma
    axes.set_ylim(-limit, limit)


def _label_abscissa(axes: Axes, motion: xr.Dataset) -> None:
    axes.set_xlabel("Phase [periods of the excitation]" if "period" in motion.attrs else "Time [s]")


def _orders(axes: Axes, cycle: ComparedCycle, factor: float, unit: str, periods: float) -> None:
    """Draw the amplitudes of the residual's harmonics; noise alone stays below the grey bars in 95 of 100 cases."""
    residual = (cycle.measured - cycle.calibrated) * cycle.weight
    amplitudes = factor * np.concatenate(
        [[abs(residual.mean())], np.abs(harmonics(residual, int(MAX_DRAWN_ORDER * periods)))]
    )
    order = np.arange(amplitudes.size) / periods
    turns = np.exp(-2j * np.pi * np.outer(np.arange(amplitudes.size), np.arange(IMPULSE_SAMPLES)) / residual.size)
    floor = factor * np.abs(turns @ cycle.response) * math.sqrt(-4.0 * math.log(NOISE_PROBABILITY) / residual.size)
    axes.bar(order, floor, width=1.0 / periods, color=NOISE, linewidth=0, zorder=0)
    colours = [SIMULATED if a > f else OTHER for a, f in zip(amplitudes, floor, strict=True)]
    axes.bar(order, amplitudes, width=0.62 / periods, color=colours, zorder=3)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(f"Amplitude [{unit}]")
    axes.set_xticks(range(0, MAX_DRAWN_ORDER + 1, 2))
    axes.set_ylim(0.0, 1.12 * max(floor.max(), amplitudes.max()))


def _fine(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit of a small residual: µm and mm/s where values are small."""
    if unit == "m":
        return (1e6, "µm") if largest < 5e-4 else shown_unit(unit, largest)
    if unit == "m/s":
        return (1e3, "mm/s") if largest < 0.5 else (1.0, unit)
    return shown_unit(unit, largest)


def dot_entry(colour: str, label: str) -> Line2D:
    """Entry of a legend with a dot."""
    return Line2D([], [], color=colour, marker=".", markersize=6, linestyle="none", label=label)


def line_entry(colour: str, label: str) -> Line2D:
    """Entry of a legend with a line."""
    return Line2D([], [], color=colour, linewidth=1.5, label=label)
