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
from calib.objective import gross_errors
from calib.records.held_response import is_held
from calib.records.response import (
    complex_harmonics,
    harmonic_orders,
    harmonic_tolerances,
    has_phase,
    parts_of_order,
    stated_sigma,
    sweeps,
    tolerances,
)
from calib.records.sweep_names import sweep_names
from calib.report.plots.style import DPI, LINE, MARK, STYLE, TEXT_WIDTH, Look, fitted_legend, png
from calib.units import shown_unit

SWEEPS = mpl.colormaps["viridis"]  # colours of the sweeps, by rising level
LIGHTEST_SWEEP = 0.82  # of the colour map: the yellow beyond it is too light on white  [1]
MAX_LEGEND_SWEEPS = 12  # count: six levels up and down
MAX_LEGEND_COLUMNS = 5  # count
BAR_SIGMAS = 2.0  # standard uncertainties on either side of a point
MIN_PHASE_SHARE = 1e-6  # of the largest first harmonic: a smaller one, of a simulation, has the phase of rounding  [1]
UP, DOWN = "^", "v"  # markers of points of a sweep up and down
NO_POINTS = np.zeros(0, dtype=int)
RING: Look = {
    "color": MARK, "marker": "o", "markersize": 9.0, "markerfacecolor": "none", "linestyle": "none",
}  # fmt: skip
FIRST_HEIGHT = 4.4  # of amplitude and phase of the first harmonic of a body  [inch]
HIGHER_HEIGHT = 3.4  # the same of a higher one  [inch]


def response_over_frequency(
    measured: xr.Dataset, simulated: xr.Dataset | None, gross: np.ndarray = NO_POINTS
) -> Figure:
    """Amplitude and phase of each harmonic of each body: measured points, and the stable stretches of its sweeps.

    Triangles point in the direction of the sweep; bars are 2 standard uncertainties, where the record states them. What
    is no larger than its bar has no phase, nor has a simulated harmonic that is rounding.

    Parameters
    ----------
    measured : frequency response
    simulated : the response that was simulated, see `calib.dynamics.swept_response`; None: there is none
    gross : indices of the points that are gross errors, which are ringed
    """
    rows = [(str(body), order) for body in measured.body.values for order in harmonic_orders(measured)]
    heights = [FIRST_HEIGHT if order == 1 else HIGHER_HEIGHT for _, order in rows]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH * 1.1, sum(heights)), dpi=DPI, layout="constrained")
        ratios = [share * height for height in heights for share in (3.0, 2.0)]
        grid = figure.subplots(2 * len(rows), 1, sharex=True, height_ratios=ratios)
        colours = _colours(measured)
        for (body, order), (upper, lower) in zip(rows, grid.reshape(-1, 2), strict=True):
            scale, unit = _points(upper, lower, measured, body, order, colours)
            own = scale * np.abs(_harmonic(measured, body, order))
            upper.plot(measured["frequency"].values[gross], own[gross], **RING)
            if simulated is not None and body in simulated.body.values:
                _curves(upper, lower, simulated, body, order, colours, scale)
            at = " at one level" if is_held(measured) else ""
            what = "amplitude" if order == 1 else f"harmonic {order}"
            upper.set_ylabel(f"{body}: {what}{at} [{unit}]")
            upper.set_ylim(0.0, None)
            lower.set_ylabel("Phase [deg]")
        grid[-1].set_xlabel("Frequency of the excitation [Hz]")
        label = "simulated" if is_held(measured) else "simulated, stable"
        stable = Line2D([], [], color=LINE, linewidth=1.1, label=label)
        ringed = Line2D([], [], **RING, label="read in a jump, or in error")
        sweep_legend(figure, measured, *([] if simulated is None else [stable]), *([ringed] if gross.size else []))
    return figure


def response_residual(measured: xr.Dataset, aligned: xr.Dataset) -> Figure:
    """Distance of each measured point from the curve over frequency, in standard uncertainties; gross errors left out.

    Parameters
    ----------
    aligned : the nearest points of the simulated curves, as `Objective.aligned` returns them
    """
    bodies, orders = [str(body) for body in measured.body.values], harmonic_orders(measured)
    of_frequency, of_parts = tolerances(measured)[0], harmonic_tolerances(measured)
    left = np.abs(complex_harmonics(aligned.sel(body=bodies)) - complex_harmonics(measured)) / of_parts
    rows = [(body, order) for body in range(len(bodies)) for order in range(len(orders))]
    in_frequency = (aligned["frequency"].values - measured["frequency"].values) / of_frequency
    gross = gross_errors(aligned["trust"].values)
    left[..., gross], in_frequency[gross] = np.nan, np.nan
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH * 1.1, 1.7 * (len(rows) + 1)), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(rows) + 1, 1, sharex=True)
        drawn = [*(left[order, body] for body, order in rows), in_frequency]
        for points, look in sweep_look(measured):
            for axes, values in zip(grid, drawn, strict=True):
                axes.plot(measured["frequency"].values[points], values[points], markersize=3.5, linewidth=0.6, **look)
        for axes, (body, order) in zip(grid, rows, strict=False):
            index = "" if order == 0 else f"_{orders[order]}"
            axes.set_ylabel(f"{bodies[body]}:\n|dH{index}| / sigma")
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
    colours, markers, names = _colours(measured), _markers(measured), list(sweep_names(measured).items())
    return [
        Line2D([], [], color=colours[sweep], marker=markers[sweep], linestyle="none", label=name)
        for sweep, name in names[:MAX_LEGEND_SWEEPS]
    ]


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
    upper: Axes, lower: Axes, measured: xr.Dataset, body: str, order: int,
    colours: dict[float, tuple[float, float, float, float]],
) -> tuple[float, str]:  # fmt: skip
    own, frequency = _harmonic(measured, body, order), measured["frequency"].values
    scale, unit = shown_unit("m", float(np.abs(own).max()))
    markers = _markers(measured)
    stated = stated_sigma(measured, parts_of_order(order)[0])
    sigma = None if stated is None else measured[stated].sel(body=body).values
    for sweep, points in sweeps(measured):
        look: dict[str, Any] = {
            "color": colours[sweep], "marker": markers[sweep], "markersize": 3.5, "linestyle": "none",
        }  # fmt: skip
        half = None if sigma is None else BAR_SIGMAS * scale * sigma[points]
        upper.errorbar(frequency[points], scale * np.abs(own[points]), half, elinewidth=0.6, **look)
        if has_phase(measured):
            known = True if half is None else scale * np.abs(own[points]) > half
            lower.plot(frequency[points], np.where(known, _phase(own[points], order), np.nan), **look)
    return scale, unit


def _curves(
    upper: Axes, lower: Axes, simulated: xr.Dataset, body: str, order: int,
    colours: dict[float, tuple[float, float, float, float]], scale: float,
) -> None:  # fmt: skip
    own, frequency = _harmonic(simulated, body, order), simulated["frequency"].values
    least = MIN_PHASE_SHARE * float(np.abs(_harmonic(simulated, body, 1)).max())
    for piece in np.unique(simulated["piece"].values):
        at = np.flatnonzero(simulated["piece"].values == piece)
        colour = colours[float(simulated["sweep"].values[at[0]])]
        upper.plot(frequency[at], scale * np.abs(own[at]), color=colour, linewidth=1.1)
        phase = _phase(own[at], order)
        wraps = np.abs(np.diff(phase, prepend=phase[0])) > 180.0
        hidden = wraps | (np.abs(own[at]) < least)
        lower.plot(frequency[at], np.where(hidden, np.nan, phase), color=colour, linewidth=1.1)


def _harmonic(response: xr.Dataset, body: str, order: int) -> np.ndarray:
    """Complex amplitude (point,) of a harmonic of a body  [m]."""
    return np.asarray(complex_harmonics(response.sel(body=[body]))[harmonic_orders(response).index(order), 0])


def _phase(amplitude: np.ndarray, order: int) -> np.ndarray:
    """Phase [deg] between -270 and 90: a first harmonic lags its excitation; of a higher one between -180 and 180."""
    degrees = np.degrees(np.angle(amplitude))
    return np.where(degrees > 90.0, degrees - 360.0, degrees) if order == 1 else degrees
