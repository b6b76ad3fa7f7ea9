"""Figures of motion: measured and simulated phase curves and time histories."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from calib.errors import CalibError
from calib.objective import Objective
from calib.records import STATE, channels, is_response, prescribed, stated_period
from calib.report.plots.measured_response import response_over_frequency
from calib.report.plots.records import (
    aligned_simulation,
    channel_axis,
    channel_pairs,
    compared_channels,
    has_channels,
    impact_times,
    is_drawable,
    time_axis,
    two_periods,
)
from calib.report.plots.style import (
    DPI,
    LINE,
    MARK,
    MAX_LINE_SAMPLES,
    MEASURED,
    STYLE,
    TEXT_WIDTH,
    band,
    base_line,
    dots,
    legend,
    line,
    mark_impacts,
    png,
)
from calib.store import Trial

MIN_INTERVAL_SAMPLES = 200  # of the interval of worst fit
MAX_LOOP_SAMPLES = 4 * MAX_LINE_SAMPLES  # samples of a record that are drawn as a phase curve


def phase_curves(measured: xr.Dataset, simulated: xr.Dataset | None, base: xr.Dataset | None = None) -> Figure | None:
    """Velocity over displacement, one panel for each body; None where a channel is missing or all are prescribed.

    All records hold displacement (body, time) [m] and velocity (body, time) [m/s] on one time base; `base` is of the
    model without its extension.
    """
    if not _has_phase_curves(measured, simulated):
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=_phase_curves_size(measured), layout="constrained")
        _phase_curves_on(figure, measured, simulated, base)
    return figure


def _has_phase_curves(measured: xr.Dataset, simulated: xr.Dataset | None) -> bool:
    """Whether a record has both channels of a phase curve, and one of them is compared."""
    if not set(STATE) <= set(channels(measured)):
        return False
    return simulated is None or any(channel in STATE for _, channel in compared_channels(measured, simulated))


def _phase_curves_size(measured: xr.Dataset) -> tuple[float, float]:
    """Width and height of the phase curves of a record [in]."""
    count = measured.body.size
    return TEXT_WIDTH if count > 1 else 0.62 * TEXT_WIDTH, 3.5 * math.ceil(count / 2)


def _phase_curves_on(
    figure: Figure | SubFigure, measured: xr.Dataset, simulated: xr.Dataset | None, base: xr.Dataset | None = None
) -> None:
    bodies = [str(b) for b in measured.body.values]
    columns = min(len(bodies), 2)
    grid = figure.subplots(math.ceil(len(bodies) / columns), columns, squeeze=False)
    for body, axes in zip(bodies, grid.flat, strict=False):
        _loop(axes, measured, simulated, body, base=base)
        axes.set_title(_title(body, simulated, STATE))
    for axes in grid.flat[len(bodies) :]:
        axes.set_visible(False)
    legend(figure, simulated is not None, base is not None)


def _loop(
    axes: Axes,
    measured: xr.Dataset,
    simulated: xr.Dataset | None,
    body: str,
    impacts: bool = True,
    base: xr.Dataset | None = None,
) -> None:
    label, scale, unit = channel_axis(measured, body, "displacement")
    one = measured.sel(body=body)
    dots(axes, scale * one.displacement.values, one.velocity.values)
    if base is not None and has_channels(base, body, *STATE):
        one = base.sel(body=body)
        base_line(axes, scale * one.displacement.values[:MAX_LOOP_SAMPLES], one.velocity.values[:MAX_LOOP_SAMPLES])
    if simulated is not None and has_channels(simulated, body, *STATE):
        one = simulated.sel(body=body)
        line(axes, scale * one.displacement.values[:MAX_LOOP_SAMPLES], one.velocity.values[:MAX_LOOP_SAMPLES])
        if impacts:
            _impacts_on_loop(axes, one, scale)
    axes.margins(0.08)
    axes.set_xlabel(f"{label} [{unit}]")
    axes.set_ylabel("Velocity [m/s]")
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.7, zorder=1)
    _uncertainty_cross(axes, measured, body, scale)


def _impacts_on_loop(axes: Axes, one: xr.Dataset, scale: float) -> None:
    """Draw triangles at the impacts of one body's record; `scale` is the factor of the displacement axis."""
    times = impact_times(one)
    times = times[(times >= float(one.time[0])) & (times <= float(one.time[-1]))]
    if times.size:
        x, v = (np.interp(times, one.time.values, one[c].values) for c in STATE)
        axes.plot(scale * x, v, "v", color=MARK, markersize=4, zorder=4)


def _uncertainty_cross(axes: Axes, measured: xr.Dataset, body: str, scale: float) -> None:
    """Draw two standard uncertainties of both channels as a cross in the lower left corner."""
    if {f"{c}_sigma" for c in STATE} <= set(measured.data_vars):
        dx, dv = (2.0 * float(measured[f"{c}_sigma"].sel(body=body).mean()) for c in STATE)
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        x, y = left + 0.04 * (right - left), low + 0.04 * (high - low)
        axes.errorbar(x, y, yerr=dv, xerr=dx * scale, color=LINE, linewidth=0.9, zorder=5)
        axes.annotate("±2 s.u.", (x, y), (7, 0), textcoords="offset points", fontsize=7, color=LINE, va="center")


def histories(measured: xr.Dataset, simulated: xr.Dataset | None, base: xr.Dataset | None = None) -> Figure:
    """Channels over time: two periods of a periodic record; else the whole record beside the interval of worst fit.

    All records hold their channels over (body, time) on one time base [s]; `base` is of the model without its
    extension. A periodic record has one row for each body and one column for each channel; of an aperiodic record only
    the compared channels are shown, one row each. There is no interval of worst fit without a simulation, nor in a
    record that is hardly longer than it.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=_histories_size(measured, simulated), layout="constrained")
        _histories_on(figure, measured, simulated, base)
    return figure


def _histories_grid(measured: xr.Dataset, simulated: xr.Dataset | None) -> tuple[list[tuple[str, str]], int, int]:
    """(body, channel) pairs that are drawn over time; rows and columns of their panels."""
    if stated_period(measured):
        return channel_pairs(measured), measured.body.size, len(channels(measured))
    pairs = channel_pairs(measured) if simulated is None else compared_channels(measured, simulated)
    is_whole = simulated is None or measured.time.size <= 2 * MIN_INTERVAL_SAMPLES
    return pairs, max(1, len(pairs)), 1 if is_whole else 2


def _histories_size(measured: xr.Dataset, simulated: xr.Dataset | None) -> tuple[float, float]:
    """Width and height of the time histories of a record [in]."""
    return TEXT_WIDTH, 1.75 * _histories_grid(measured, simulated)[1] + 0.45


def _histories_on(
    figure: Figure | SubFigure, measured: xr.Dataset, simulated: xr.Dataset | None, base: xr.Dataset | None = None
) -> None:
    period = stated_period(measured)
    pairs, rows, columns = _histories_grid(measured, simulated)
    grid = figure.subplots(rows, columns, squeeze=False, sharex="all" if period else "none")
    if period:
        for (body, channel), axes in zip(pairs, grid.flat, strict=True):
            _history(axes, measured, simulated, body, channel, two_periods(measured, period), base)
            axes.set_title(_title(body, simulated, (channel,)))
    else:
        for (body, channel), row in zip(pairs, grid, strict=False):
            panels = [(slice(None), body)]
            if columns > 1:
                panels.append((_worst_interval(measured, simulated, body, channel), "largest residual"))
            for axes, (span, title) in zip(row, panels, strict=True):
                _history(axes, measured, simulated, body, channel, span, base)
                axes.set_title(title)
    for axes in grid[-1]:
        axes.set_xlabel(f"Time [{time_axis(measured)[1]}]")
    legend(figure, simulated is not None, base is not None)


def motions_of_records(motions: Mapping[str, tuple[xr.Dataset, xr.Dataset]]) -> Figure:
    """Phase curves of each record, or time histories of one that has none; several stand below each other, named.

    motions : name -> measured record and simulated one on the same time base
    """
    responses = [name for name, (measured, _) in motions.items() if is_response(measured)]
    if responses:
        raise CalibError(
            f"record {responses[0]!r} is a frequency response, which the report draws; name another record"
        )
    loops = {name: _has_phase_curves(*pair) for name, pair in motions.items()}
    sizes = [
        _phase_curves_size(measured) if loops[name] else _histories_size(measured, simulated)
        for name, (measured, simulated) in motions.items()
    ]
    size = max(width for width, _ in sizes), sum(height for _, height in sizes)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        parts = figure.subfigures(len(sizes), 1, squeeze=False, height_ratios=[height for _, height in sizes])
        for part, (name, pair) in zip(parts[:, 0], motions.items(), strict=True):
            (_phase_curves_on if loops[name] else _histories_on)(part, *pair)
            if len(motions) > 1:
                part.suptitle(name, x=0.02, horizontalalignment="left")
    return figure


def _history(
    axes: Axes,
    measured: xr.Dataset,
    simulated: xr.Dataset | None,
    body: str,
    channel: str,
    span: slice,
    base: xr.Dataset | None = None,
) -> None:
    label, scale, unit = channel_axis(measured, body, channel)
    factor = time_axis(measured)[0]
    start = float(measured.time[0])
    one = measured.sel(body=body).isel(time=span)
    times = factor * (one.time.values - start)
    crowded = times.size > MAX_LOOP_SAMPLES
    if crowded:
        band(axes, times, scale * one[channel].values, MEASURED, 0.9)
    else:
        dots(axes, times, scale * one[channel].values)
    if base is not None and has_channels(base, body, channel):
        base_line(axes, times, scale * base[channel].sel(body=body).values[span])
    if simulated is not None and has_channels(simulated, body, channel):
        one = simulated.sel(body=body).isel(time=span)
        line(axes, times, scale * one[channel].values)
        hits = factor * (impact_times(one) - start)
        mark_impacts(axes, hits[(hits >= times[0]) & (hits <= times[-1])] if not crowded else np.empty(0))
    axes.set_ylabel(f"{label} [{unit}]")
    axes.margins(x=0.01)


def trial_picture(trial: Trial, records: Mapping[str, xr.Dataset], objective: Objective) -> bytes:
    """PNG (480 x 360) of the measured and the simulated phase curve of one body of the first calibration record.

    The body is the last whose motion the excitation does not prescribe; a record without both channels gives a time
    history instead.

    Parameters
    ----------
    trial : its number, cost and kind of motion are the title
    records : name -> simulated record
    """
    scored = [n for n, r in objective.references.items() if r.use == "calibrate" and n in records]
    name = (scored or list(records))[0]
    measured, simulated = objective.references[name].record, records[name]
    if is_response(measured):
        return png(response_over_frequency(measured, simulated if is_drawable(simulated) else None))
    aligned = aligned_simulation(objective, name, simulated) if is_drawable(simulated) else None
    pairs = compared_channels(measured, aligned) if aligned is not None else channel_pairs(measured)
    body, channel = (pairs or channel_pairs(measured))[-1]
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(4.8, 3.6), dpi=100)
        axes = figure.add_axes((0.15, 0.14, 0.82, 0.75))
        if set(STATE) <= set(channels(measured)) and channel in STATE:
            _loop(axes, measured, aligned, body, impacts=False)
        else:
            _history(axes, measured, aligned, body, channel, _worst_interval(measured, aligned, body, channel))
            axes.set_xlabel(f"Time [{time_axis(measured)[1]}]")
        score = f"{trial.cost:.4g}" if trial.scored else trial.status
        axes.set_title(f"trial {trial.number}: {score}, {trial.kind or trial.status} ({name}, {body})")
        return png(figure)


def simulation_picture(record: xr.Dataset, path: str | Path) -> None:
    """Draw a simulated record to a file (PNG, SVG or PDF by its suffix): phase curves and time histories.

    record : channels (body, time) in SI, status ok
    """
    bodies, shown = [str(b) for b in record.body.values], channels(record)
    loops = set(STATE) <= set(shown)
    factor, unit_of_time = time_axis(record)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH * 1.2, 2.3 * len(bodies)), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(bodies), len(shown) + loops, squeeze=False)
        times = factor * (record.time.values - float(record.time[0]))
        for body, row in zip(bodies, grid, strict=True):
            one = record.sel(body=body)
            for channel, axes in zip(shown, row[loops:], strict=True):
                label, scale, unit = channel_axis(record, body, channel)
                line(axes, times, scale * one[channel].values)
                axes.set_xlabel(f"Time [{unit_of_time}]")
                axes.set_ylabel(f"{label} [{unit}]")
            if loops:
                _, scale, unit = channel_axis(record, body, "displacement")
                line(row[0], scale * one.displacement.values[:MAX_LOOP_SAMPLES], one.velocity.values[:MAX_LOOP_SAMPLES])
                _impacts_on_loop(row[0], one, scale)
                row[0].set_xlabel(f"Displacement [{unit}]")
                row[0].set_ylabel("Velocity [m/s]")
            row[0].set_title(body)
        figure.savefig(path)


def _title(body: str, simulated: xr.Dataset | None, shown: Sequence[str]) -> str:
    given = simulated is not None and all((body, c) in prescribed(simulated) for c in shown)
    return f"{body} (prescribed by the excitation)" if given else body


def _worst_interval(measured: xr.Dataset, simulated: xr.Dataset | None, body: str, channel: str) -> slice:
    """Samples of the fortieth of the record, at least MIN_INTERVAL_SAMPLES, where the residual is largest."""
    size = measured.time.size
    length = min(size, max(MIN_INTERVAL_SAMPLES, size // 40))
    values = measured[channel].sel(body=body).values
    if simulated is not None and has_channels(simulated, body, channel):
        values = values - simulated[channel].sel(body=body).values
    summed = np.concatenate([[0.0], np.cumsum(values**2)])
    start = int(np.argmax(summed[length:] - summed[: size - length + 1]))
    return slice(start, start + length)
