"""Pictures of motion: measured against simulated phase curves and time histories."""

import math
from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from calib.records import OK, STATE, channels, prescribed, stated_period
from calib.report.drawing import (
    DPI,
    LINE,
    MARK,
    MEASURED,
    SAMPLES,
    STYLE,
    WIDTH,
    band,
    dots,
    legend,
    line,
    marks,
    png,
    shown_unit,
)
from calib.store import Trial


def phase_curves(measured: xr.Dataset, simulated: xr.Dataset | None) -> Figure | None:
    """Velocity over displacement, one panel a body; None where the record lacks a channel or all is prescribed.

    Both records hold displacement (body, time) [m] and velocity (body, time) [m/s] on one time base.
    """
    if not set(STATE) <= set(channels(measured)):
        return None
    bodies = [str(b) for b in measured.body.values]
    if simulated is not None and not any(channel in STATE for _, channel in judged(measured, simulated)):
        return None
    with mpl.rc_context(STYLE):
        columns = min(len(bodies), 2)
        rows = math.ceil(len(bodies) / columns)
        figure = Figure(figsize=(WIDTH if columns > 1 else 0.62 * WIDTH, 3.5 * rows), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False)
        for body, axes in zip(bodies, grid.flat, strict=False):
            _loop(axes, measured, simulated, body)
            axes.set_title(_title(body, simulated, STATE))
        for axes in grid.flat[len(bodies) :]:
            axes.set_visible(False)
        legend(figure, simulated is not None)
    return figure


def _loop(axes, measured, simulated, body, impacts=True):
    label, scale, unit = quantity(measured, body, "displacement")
    one = measured.sel(body=body)
    dots(axes, scale * one.displacement.values, one.velocity.values)
    if simulated is not None and has(simulated, body, *STATE):
        one = simulated.sel(body=body)
        line(axes, scale * one.displacement.values[: 4 * SAMPLES], one.velocity.values[: 4 * SAMPLES])
        if impacts:
            _impacts_on_loop(axes, one, scale)
    axes.margins(0.08)
    axes.set_xlabel(f"{label} [{unit}]")
    axes.set_ylabel("Velocity [m/s]")
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.7, zorder=1)
    _uncertainty_cross(axes, measured, body, scale)


def _impacts_on_loop(axes, one, scale):
    times = impact_times(one)
    times = times[(times >= float(one.time[0])) & (times <= float(one.time[-1]))]
    if times.size:
        x, v = (np.interp(times, one.time.values, one[c].values) for c in STATE)
        axes.plot(scale * x, v, "v", color=MARK, markersize=4, zorder=4)


def _uncertainty_cross(axes, measured, body, scale):
    """Two standard uncertainties of both channels as a cross in the lower left corner."""
    if {f"{c}_sigma" for c in STATE} <= set(measured.data_vars):
        dx, dv = (2.0 * float(measured[f"{c}_sigma"].sel(body=body).mean()) for c in STATE)
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        x, y = left + 0.04 * (right - left), low + 0.04 * (high - low)
        axes.errorbar(x, y, yerr=dv, xerr=dx * scale, color=LINE, linewidth=0.9, zorder=5)
        axes.annotate("±2 s.u.", (x, y), (7, 0), textcoords="offset points", fontsize=7, color=LINE, va="center")


def histories(measured: xr.Dataset, simulated: xr.Dataset | None) -> Figure:
    """Channels over time: two periods of a periodic record; else the whole of it beside its worst stretch.

    Both records hold their channels over (body, time) on one time base [s]. A periodic record has a row a body and a
    column a channel; of another one only what is judged is shown, a row each. Without a simulation there is no stretch
    where it differs most.
    """
    period = stated_period(measured)
    pairs = judged(measured, simulated) if simulated is not None and not period else _pairs(measured)
    bodies = [str(b) for b in measured.body.values]
    compared = 1 if simulated is None else 2
    rows, columns = (len(bodies), len(channels(measured))) if period else (max(1, len(pairs)), compared)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 1.75 * rows + 0.45), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharex="all" if period else "none")
        if period:
            for (body, channel), axes in zip(pairs, grid.flat, strict=True):
                _history(axes, measured, simulated, body, channel, two_periods(measured, period))
                axes.set_title(_title(body, simulated, (channel,)))
        else:
            for (body, channel), row in zip(pairs, grid, strict=False):
                panels = [(slice(None), body)]
                if simulated is not None:
                    panels.append((_worst(measured, simulated, body, channel), "where it differs most"))
                for axes, (span, title) in zip(row, panels, strict=True):
                    _history(axes, measured, simulated, body, channel, span)
                    axes.set_title(title)
        for axes in grid[-1]:
            axes.set_xlabel(f"Time [{clock(measured)[1]}]")
        legend(figure, simulated is not None)
    return figure


def _history(axes, measured, simulated, body, channel, span):
    label, scale, unit = quantity(measured, body, channel)
    stretch = clock(measured)[0]
    start = float(measured.time[0])
    one = measured.sel(body=body).isel(time=span)
    times = stretch * (one.time.values - start)
    crowded = times.size > 4 * SAMPLES
    if crowded:
        band(axes, times, scale * one[channel].values, MEASURED, 0.9)
    else:
        dots(axes, times, scale * one[channel].values)
    if simulated is not None and has(simulated, body, channel):
        one = simulated.sel(body=body).isel(time=span)
        line(axes, times, scale * one[channel].values)
        hits = stretch * (impact_times(one) - start)
        marks(axes, hits[(hits >= times[0]) & (hits <= times[-1])] if not crowded else [])
    axes.set_ylabel(f"{label} [{unit}]")
    axes.margins(x=0.01)


def picture(trial: Trial, records: Mapping[str, xr.Dataset], objective) -> bytes:
    """PNG (480 x 360) of the measured and the simulated phase curve of one body of the first record that is scored.

    The body is the last whose motion the excitation does not prescribe; a record without both channels gives a time
    history instead.

    Parameters
    ----------
    trial : its number, cost and kind are written above the curve
    records : name -> simulated record
    objective : has references (name -> .record, .use) and aligned(name, record)
    """
    scored = [n for n, r in objective.references.items() if r.use == "calibrate" and n in records]
    name = (scored or list(records))[0]
    measured, simulated = objective.references[name].record, records[name]
    aligned = beside(objective, name, simulated) if usable(simulated) else None
    pairs = judged(measured, aligned) if aligned is not None else _pairs(measured)
    body, channel = (pairs or _pairs(measured))[-1]
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(4.8, 3.6), dpi=100)
        axes = figure.add_axes((0.15, 0.14, 0.82, 0.75))
        if set(STATE) <= set(channels(measured)) and channel in STATE:
            _loop(axes, measured, aligned, body, impacts=False)
        else:
            _history(axes, measured, aligned, body, channel, _worst(measured, aligned, body, channel))
            axes.set_xlabel(f"Time [{clock(measured)[1]}]")
        score = f"{trial.cost:.4g}" if trial.scored else trial.status
        axes.set_title(f"trial {trial.number}: {score}, {trial.kind or trial.status} ({name}, {body})")
        return png(figure)


def simulation_picture(record: xr.Dataset, path: str | Path) -> None:
    """Draw a simulated record to a file (PNG, SVG or PDF by its suffix): phase curves and time histories.

    record : channels (body, time) in SI, status ok
    """
    bodies, shown = [str(b) for b in record.body.values], channels(record)
    loops = set(STATE) <= set(shown)
    stretch, unit_of_time = clock(record)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * 1.2, 2.3 * len(bodies)), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(bodies), len(shown) + loops, squeeze=False)
        times = stretch * (record.time.values - float(record.time[0]))
        for body, row in zip(bodies, grid, strict=True):
            one = record.sel(body=body)
            for channel, axes in zip(shown, row[loops:], strict=True):
                label, scale, unit = quantity(record, body, channel)
                line(axes, times, scale * one[channel].values)
                axes.set_xlabel(f"Time [{unit_of_time}]")
                axes.set_ylabel(f"{label} [{unit}]")
            if loops:
                _, scale, unit = quantity(record, body, "displacement")
                line(row[0], scale * one.displacement.values[: 4 * SAMPLES], one.velocity.values[: 4 * SAMPLES])
                _impacts_on_loop(row[0], one, scale)
                row[0].set_xlabel(f"Displacement [{unit}]")
                row[0].set_ylabel("Velocity [m/s]")
            row[0].set_title(body)
        figure.savefig(path)


# --- reading records -----------------------------------------------------------------------------------------------


def judged(measured: xr.Dataset, simulated: xr.Dataset) -> list[tuple[str, str]]:
    """(body, channel) pairs that both records have and the excitation does not prescribe."""
    given = prescribed(simulated)
    return [(b, c) for b, c in _pairs(measured) if has(simulated, b, c) and (b, c) not in given]


def usable(record: xr.Dataset) -> bool:
    """Whether the simulation succeeded and has samples to draw."""
    return record.attrs.get("status", OK) == OK and record.sizes.get("time", 0) > 1


def has(record: xr.Dataset, body: str, *names: str) -> bool:
    """Whether the record has this body and these channels."""
    return all(name in record and body in record.body.values for name in names)


def impact_times(record: xr.Dataset) -> np.ndarray:
    """Instants of the impacts that the record knows [s]."""
    return np.asarray(record["impact_time"].values, dtype=float) if "impact_time" in record else np.empty(0)


def beside(objective, name: str, simulated: xr.Dataset) -> xr.Dataset:
    """Return a simulated record on the time base of the reference `name`, with its impacts and what was prescribed."""
    aligned = _with_impacts(objective.aligned(name, simulated), simulated)
    return aligned.assign_attrs(prescribed=simulated.attrs.get("prescribed", ""))


def _with_impacts(aligned, simulated):
    """Put the impacts of a simulated record on the time of the reference it was aligned with.

    The trigger, attribute `nuisance_trigger` of `aligned`, is the simulation's time at the reference's time zero [s];
    the simulation repeats itself after its own length.
    """
    times = impact_times(simulated)
    period = stated_period(simulated) or stated_period(aligned)
    if not times.size or not period:
        return aligned
    steps = (float(simulated.time[-1]) - float(simulated.time[0])) / (simulated.sizes["time"] - 1)
    length = period * max(1, round((float(simulated.time[-1]) - float(simulated.time[0]) + steps) / period))
    shifted = times - float(aligned.attrs.get("nuisance_trigger", 0.0))
    start, end = float(aligned.time[0]), float(aligned.time[-1])
    turns = np.arange(np.floor((start - shifted.max()) / length), np.ceil((end - shifted.min()) / length) + 1)
    moved = np.sort((shifted[:, None] + length * turns).ravel())
    return aligned.assign(impact_time=("impact", moved[(moved >= start) & (moved <= end)]))


def quantity(record: xr.Dataset, body: str, channel: str) -> tuple[str, float, str]:
    """Name, factor and unit in which a channel is drawn."""
    values = record[channel].sel(body=body).values
    return channel.capitalize(), *shown_unit(record[channel].attrs.get("units", "1"), np.max(np.abs(values)))


def _pairs(record):
    return [(str(b), c) for b in record.body.values for c in channels(record)]


def _title(body, simulated, shown):
    given = simulated is not None and all((body, c) in prescribed(simulated) for c in shown)
    return f"{body} (prescribed by the excitation)" if given else body


def clock(record: xr.Dataset) -> tuple[float, str]:
    """Factor and unit of time axes: ms where less than 2 s are shown."""
    period = stated_period(record)
    span = 2.0 * period if period else float(record.time[-1] - record.time[0])
    return (1e3, "ms") if span < 2.0 else (1.0, "s")


def two_periods(record: xr.Dataset, period: float) -> slice:
    """Samples of the first two periods [s]."""
    inside = np.flatnonzero(record.time.values <= float(record.time[0]) + 2.0 * period)
    return slice(0, int(inside[-1]) + 1)


def _worst(measured, simulated, body, channel):
    """Samples of the fortieth of the record, at least 200 of them, where the residual is largest."""
    size = measured.time.size
    length = min(size, max(200, size // 40))
    values = measured[channel].sel(body=body).values
    if simulated is not None and has(simulated, body, channel):
        values = values - simulated[channel].sel(body=body).values
    summed = np.concatenate([[0.0], np.cumsum(values**2)])
    start = int(np.argmax(summed[length:] - summed[: size - length + 1]))
    return slice(start, start + length)
