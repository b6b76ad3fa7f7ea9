"""A measured frequency response and its simulation: amplitude, phase and residual over frequency, a colour a sweep."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from calib.execution.files import whole
from calib.records.held_response import is_held
from calib.records.response import complex_amplitude, has_phase, sweeps, tolerances
from calib.report.plots.style import DPI, LINE, STYLE, TEXT_WIDTH, Look, fitted_legend, png
from calib.report.record_description import level_text
from calib.units import shown_unit

SWEEPS = mpl.colormaps["viridis"]  # colours of the sweeps, by rising level
LIGHTEST_SWEEP = 0.82  # of the colour map: the yellow beyond it is too light on white  [1]
MAX_LEGEND_SWEEPS = 12  # count: six levels up and down
MAX_LEGEND_COLUMNS = 5  # count
BAR_SIGMAS = 2.0  # standard uncertainties on either side of a point
UP, DOWN = "^", "v"  # markers of points of a sweep up and down


def response_over_frequency(measured: xr.Dataset, simulated: xr.Dataset | None) -> Figure:
    """Amplitude and phase of each body: measured points, and the stable stretches that its sweeps run through.

    Triangles point in the direction of the sweep; bars are 2 standard uncertainties, where the record states them.

    Parameters
    ----------
    measured : frequency response
    simulated : the response that was simulated, see `calib.dynamics.swept_response`; None: there is none
    """
    bodies = [str(body) for body in measured.body.values]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH * 1.1, 4.4 * len(bodies)), dpi=DPI, layout="constrained")
        grid = figure.subplots(2 * len(bodies), 1, sharex=True, height_ratios=[3.0, 2.0] * len(bodies))
        colours = _colours(measured)
        for row, body in enumerate(bodies):
            upper, lower = grid[2 * row], grid[2 * row + 1]
            scale, unit = _points(upper, lower, measured, body, colours)
            if simulated is not None and body in simulated.body.values:
                _curves(upper, lower, simulated, body, colours, scale)
            at = " at one level" if is_held(measured) else ""
            upper.set_ylabel(f"{body}: amplitude{at} [{unit}]")
            upper.set_ylim(0.0, None)
            lower.set_ylabel("Phase [deg]")
        grid[-1].set_xlabel("Frequency of the excitation [Hz]")
        label = "simulated" if is_held(measured) else "simulated, stable"
        stable = Line2D([], [], color=LINE, linewidth=1.1, label=label)
        sweep_legend(figure, measured, *([] if simulated is None else [stable]))
    return figure


def response_residual(measured: xr.Dataset, aligned: xr.Dataset) -> Figure:
    """Distance of each measured point from the curve over frequency, in standard uncertainties.

    Parameters
    ----------
    aligned : the nearest points of the simulated curves, as `Objective.aligned` returns them
    """
    bodies = [str(body) for body in measured.body.values]
    of_frequency, of_parts = tolerances(measured)
    apart = np.abs(complex_amplitude(aligned.sel(body=bodies)) - complex_amplitude(measured)) / of_parts
    in_frequency = (aligned["frequency"].values - measured["frequency"].values) / of_frequency
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH * 1.1, 1.7 * (len(bodies) + 1)), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(bodies) + 1, 1, sharex=True)
        for points, look in sweep_look(measured):
            for row, axes in enumerate(grid):
                values = apart[row] if row < len(bodies) else in_frequency
                axes.plot(measured["frequency"].values[points], values[points], markersize=3.5, linewidth=0.6, **look)
        for axes, body in zip(grid, bodies, strict=False):
            axes.set_ylabel(f"{body}:\n|dH| / sigma")
            axes.set_ylim(0.0, None)
        grid[-1].set_ylabel("dF / sigma")
        grid[-1].set_xlabel("Frequency of the excitation [Hz]")
    return figure


def response_picture(measured: xr.Dataset, path: str | Path) -> None:
    """Draw a response to a PNG file."""
    with whole(Path(path)) as temporary:
        temporary.write_bytes(png(response_over_frequency(measured, None)))


def sweep_look(measured: xr.Dataset) -> list[tuple[np.ndarray, Look]]:
    """Points of each sweep, and the colour and marker that stand for its level and direction."""
    colours, markers = _colours(measured), _markers(measured)
    return [(points, {"color": colours[sweep], "marker": markers[sweep]}) for sweep, points in sweeps(measured)]


def sweep_legend(figure: Figure, measured: xr.Dataset, *others: Artist) -> None:
    """Add a legend of the sweeps and of what else is drawn above the panels, which keep their size.

    It has as many columns as the width of the figure has room for.
    """
    handles = [*sweep_entries(measured), *others]
    drawn = fitted_legend(figure, handles, MAX_LEGEND_COLUMNS, loc="outside upper right", columnspacing=1.4)
    figure.set_figheight(figure.get_figheight() + drawn.get_window_extent().height / figure.dpi)


def sweep_entries(measured: xr.Dataset) -> list[Artist]:
    """Entries of a legend of the sweeps: level and direction; the first few of many."""
    colours, markers, handles = _colours(measured), _markers(measured), list[Artist]()
    for sweep, points in sweeps(measured)[:MAX_LEGEND_SWEEPS]:
        way = "up" if markers[sweep] == UP else "down"
        label = f"{level_text(measured, points)}, {way}"
        handles.append(Line2D([], [], color=colours[sweep], marker=markers[sweep], linestyle="none", label=label))
    return handles


def _colours(measured: xr.Dataset) -> dict[float, tuple[float, float, float, float]]:
    """Colour of each sweep: sweeps of one level have the same one."""
    levels = {
        sweep: round(float(np.median(measured["level"].values[points])), 12) for sweep, points in sweeps(measured)
    }
    order = sorted(set(levels.values()))
    return {
        sweep: SWEEPS(LIGHTEST_SWEEP * order.index(level) / max(1, len(order) - 1)) for sweep, level in levels.items()
    }


def _markers(measured: xr.Dataset) -> dict[float, str]:
    return {s: UP if measured["direction"].values[points[0]] > 0.0 else DOWN for s, points in sweeps(measured)}


def _points(
    upper: Axes, lower: Axes, measured: xr.Dataset, body: str, colours: dict[float, tuple[float, float, float, float]]
) -> tuple[float, str]:
    own, frequency = complex_amplitude(measured.sel(body=[body]))[0], measured["frequency"].values
    scale, unit = shown_unit("m", float(np.abs(own).max()))
    markers = _markers(measured)
    sigma = measured["response_sigma"].sel(body=body).values if "response_sigma" in measured else None
    for sweep, points in sweeps(measured):
        look: dict[str, Any] = {
            "color": colours[sweep], "marker": markers[sweep], "markersize": 3.5, "linestyle": "none",
        }  # fmt: skip
        half = None if sigma is None else BAR_SIGMAS * scale * sigma[points]
        upper.errorbar(frequency[points], scale * np.abs(own[points]), half, elinewidth=0.6, **look)
        if has_phase(measured):
            lower.plot(frequency[points], _phase(own[points]), **look)
    return scale, unit


def _curves(
    upper: Axes, lower: Axes, simulated: xr.Dataset, body: str, colours: dict[float, tuple[float, float, float, float]],
    scale: float,
) -> None:  # fmt: skip
    own, frequency = complex_amplitude(simulated.sel(body=[body]))[0], simulated["frequency"].values
    for piece in np.unique(simulated["piece"].values):
        at = np.flatnonzero(simulated["piece"].values == piece)
        colour = colours[float(simulated["sweep"].values[at[0]])]
        upper.plot(frequency[at], scale * np.abs(own[at]), color=colour, linewidth=1.1)
        lower.plot(frequency[at], _phase(own[at]), color=colour, linewidth=1.1)


def _phase(amplitude: np.ndarray) -> np.ndarray:
    """Phase between -270 and 90 degrees: a response lags its excitation."""
    degrees = np.degrees(np.angle(amplitude))
    return np.where(degrees > 90.0, degrees - 360.0, degrees)
