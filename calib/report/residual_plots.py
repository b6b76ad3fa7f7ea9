"""Pictures of what a calibrated model leaves of the records, in units of their noise.

A motion is a Dataset over (row, time) with measured, calibrated and, where a cause was found, extended, each row in its
unit; weight in [0, 1], 0 where a sample is not compared; over row sigma, body, channel, unit; memory (row, lag) and
innovation (row) of the noise, an autoregression; time [s]; attributes cycle [periods of the excitation] and, where
there is one, period [s].
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.signal import lfilter

from calib.records import STATE
from calib.records.cycles import harmonics, mean_cycle
from calib.report.drawing import (
    LINE,
    MARK,
    MEASURED,
    OTHER,
    SIMULATED,
    STYLE,
    WIDTH,
    line,
    shown_unit,
    spot,
    thin,
)

EXTENDED = "#009E73"  # the model with what was found
NOISE, MEANS = "#e4e4e4", "#c2c2c2"  # bands of the noise of a sample, and of the mean of the cycles
CLOUD = 1500  # samples drawn as dots in one panel
ORDERS = 12  # harmonics drawn
MEMORY = 1024  # samples after which noise has forgotten
LARGEST = 8.0  # noise levels at which the colour of a loop is darkest, at most
SHADES = mpl.colors.LinearSegmentedColormap.from_list("misfit", ["#d9d9d9", "#F0C44B", "#D55E00", "#7a1f00"])


class CycleLoop(NamedTuple):
    """A row of a motion, brought to one cycle.

    Attributes
    ----------
    at : (n,) place in the cycle [periods], or time where there is no period [s]
    measured, calibrated : (n,) means of the cycles
    extended : the same, None where there is none
    weight : (n,) of the cycle's samples
    sigma : of the means
    response : (k,) what white noise of unit variance goes through to become the noise of the means
    cycles : number of them
    """

    at: np.ndarray
    measured: np.ndarray
    calibrated: np.ndarray
    extended: np.ndarray | None
    weight: np.ndarray
    sigma: float
    response: np.ndarray
    cycles: float


def loop(motion: xr.Dataset, row: int) -> CycleLoop:
    """Mean cycle of a row; of a record without a period the whole of it."""
    names = [name for name in ("measured", "calibrated", "extended", "weight") if name in motion]
    rows = np.array([motion[name].values[row] for name in names])
    at, count = motion.time.values - float(motion.time[0]), 1
    if "period" in motion.attrs:
        period, length = float(motion.attrs["period"]), int(motion.attrs["cycle"])
        weight = np.array([np.ones(at.size) if name == "weight" else motion.weight.values[row] for name in names])
        mean = mean_cycle(motion.time.values, rows, period, length, weight=weight)
        at, rows, count = mean.phase, mean.loop, mean.cycles
        rows[names.index("weight")] = np.clip(rows[names.index("weight")], 0.0, 1.0)
    means = dict(zip(names, rows, strict=True))
    views = means["measured"], means["calibrated"], means.get("extended"), means["weight"]
    sigma, response = float(motion.sigma[row]) / math.sqrt(count), _response(motion, row) / math.sqrt(count)
    return CycleLoop(at, *views, sigma, response, count)


def _response(motion, row):
    """Impulse response (MEMORY,) of the autoregression that the noise of a row is."""
    impulse = np.eye(1, MEMORY)[0]
    feedback = np.concatenate([[1.0], -motion.memory.values[row]])
    return float(motion.innovation[row]) * lfilter([1.0], feedback, impulse)


def rows(motion: xr.Dataset) -> list[tuple[int, str, str, str]]:
    """Number, body, channel and unit of the rows that are compared."""
    kinds = zip(motion.body.values, motion.channel.values, motion.unit.values, strict=True)
    return [(k, *map(str, kind)) for k, kind in enumerate(kinds) if motion.weight.values[k].any()]


def pairs(motion: xr.Dataset) -> dict[str, tuple[int, int]]:
    """Rows of displacement and velocity of each body that has both, one of them compared."""
    named = zip(motion.body.values, motion.channel.values, strict=True)
    known = {(str(body), str(channel)): k for k, (body, channel) in enumerate(named)}
    bodies = dict.fromkeys(body for body, _ in known)
    found = {b: tuple(known[b, c] for c in STATE) for b in bodies if all((b, c) in known for c in STATE)}
    return {b: two for b, two in found.items() if motion.weight.values[list(two)].any()}


def strength(motion: xr.Dataset) -> float:
    """By how much the mean cycles differ beyond their noise: root mean square over all rows that are compared  [1]."""
    found = [(own.weight * ((own.measured - own.calibrated) / own.sigma) ** 2, own.weight) for own in _loops(motion)]
    return math.sqrt(sum(s.sum() for s, _ in found) / max(1.0, sum(w.sum() for _, w in found)))


def _loops(motion):
    return [loop(motion, row) for row, *_ in rows(motion)]


# --- over the cycle and in harmonics ---------------------------------------------------------------------------------


def residuals(motion: xr.Dataset, label: str = "") -> Figure | None:
    """Residual of each channel over the cycle or time within the band of its noise; beside it its harmonics.

    label : of the extended model, whose residual is drawn too where there is one
    """
    compared = rows(motion)
    if not compared:
        return None
    periodic = "period" in motion.attrs
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 1.55 * len(compared) + 0.75), layout="constrained")
        ratios = {"width_ratios": (1.9, 1.0)} if periodic else {}
        grid = figure.subplots(len(compared), 1 + periodic, squeeze=False, sharex="col", gridspec_kw=ratios)
        for (row, body, channel, unit), panels in zip(compared, grid, strict=True):
            own = loop(motion, row)
            largest = np.abs(motion.measured.values[row] - motion.calibrated.values[row]).max()
            factor, name = _fine(unit, max(largest, float(motion.sigma[row])))
            _residual(panels[0], motion, row, own, factor)
            panels[0].set_title(f"{body}: {channel}, measured less simulated")
            panels[0].set_ylabel(f"[{name}]")
            if periodic:
                _orders(panels[1], own, factor, name, float(motion.attrs["cycle"]))
        _place(grid[-1, 0], motion)
        if periodic:
            grid[0, 1].set_title("amplitude of its harmonics")
            grid[-1, 1].set_xlabel("Order [multiples of the excitation]")
        drawn = _line if periodic else _dot
        handles = [
            _dot(MEASURED, "residual"),
            *([_line(SIMULATED, "mean of the cycles")] if periodic else []),
            *([drawn(EXTENDED, label)] if label and "extended" in motion else []),
            mpl.patches.Patch(color=NOISE, label="noise, ±2 standard deviations"),
            *([mpl.patches.Patch(color=MEANS, label="noise of the mean")] if periodic else []),
        ]
        columns = len(handles) if len(handles) < 5 else 3
        figure.legend(handles=handles, loc="outside upper right", ncols=columns, columnspacing=1.4, handletextpad=0.5)
    return figure


def _residual(axes, motion, row, own, factor):
    sigma = factor * float(motion.sigma[row])
    axes.axhspan(-2.0 * sigma, 2.0 * sigma, color=NOISE, linewidth=0, zorder=0)
    residual = factor * (motion.measured.values[row] - motion.calibrated.values[row])
    counts, time = motion.weight.values[row] > 0.5, motion.time.values - float(motion.time[0])
    if "period" in motion.attrs:
        time = motion.time.values / float(motion.attrs["period"]) % int(motion.attrs["cycle"])
    place, residual = time[counts], residual[counts]
    keep = thin(place.size, CLOUD)
    look = {"markersize": spot(keep.size), "markeredgewidth": 0, "alpha": 0.7, "rasterized": True}
    axes.plot(place[keep], residual[keep], ".", color="#777777", zorder=2, **look)
    if "period" in motion.attrs:
        axes.axhspan(-2.0 * factor * own.sigma, 2.0 * factor * own.sigma, color=MEANS, linewidth=0, zorder=1)
        for simulated, colour in ((own.calibrated, SIMULATED), (own.extended, EXTENDED)):
            if simulated is not None:
                left = np.where(own.weight > 0.5, factor * (own.measured - simulated), np.nan)
                line(axes, own.at, left, colour, width=1.3)
        half = 0.5 / max(1.0, own.at.size / int(motion.attrs["cycle"]))
        for at in own.at[own.weight <= 0.5]:
            axes.axvspan(at - half, at + half, color=MARK, alpha=0.25, linewidth=0, zorder=1)
    elif "extended" in motion:
        left = factor * (motion.measured.values[row] - motion.extended.values[row])
        axes.plot(place[keep], left[counts][keep], ".", color=EXTENDED, zorder=3, **look)
    axes.axhline(0.0, color=LINE, linewidth=0.6, zorder=1)
    axes.margins(x=0.01)
    limit = max(np.quantile(np.abs(residual), 0.998), 3.0 * sigma) * 1.12 if residual.size else 3.0 * sigma
    axes.set_ylim(-limit, limit)


def _place(axes, motion):
    axes.set_xlabel("Phase [periods of the excitation]" if "period" in motion.attrs else "Time [s]")


def _orders(axes, own, factor, unit, cycle):
    """Amplitudes of the residual's harmonics; grey is what noise alone stays below in 95 of 100 cases."""
    residual = (own.measured - own.calibrated) * own.weight
    amplitudes = factor * np.concatenate([[abs(residual.mean())], np.abs(harmonics(residual, int(ORDERS * cycle)))])
    order = np.arange(amplitudes.size) / cycle
    turns = np.exp(-2j * np.pi * np.outer(np.arange(amplitudes.size), np.arange(MEMORY)) / residual.size)
    floor = factor * np.abs(turns @ own.response) * math.sqrt(-4.0 * math.log(0.05) / residual.size)
    axes.bar(order, floor, width=1.0 / cycle, color=NOISE, linewidth=0, zorder=0)
    colours = [SIMULATED if a > f else OTHER for a, f in zip(amplitudes, floor, strict=True)]
    axes.bar(order, amplitudes, width=0.62 / cycle, color=colours, zorder=3)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(f"[{unit}]")
    axes.set_xticks(range(0, ORDERS + 1, 2))
    axes.set_ylim(0.0, 1.12 * max(floor.max(), amplitudes.max()))


# --- on the phase curve ----------------------------------------------------------------------------------------------


def misfit_loops(motions: Mapping[str, xr.Dataset]) -> Figure | None:
    """Measured loops coloured by the local misfit: a panel for each body of each record."""
    panels = _panels(motions)
    if not panels:
        return None
    with mpl.rc_context(STYLE):
        figure, grid, used = _grid(panels)
        levels = [_level(motion, two) for _, _, motion, two in panels]
        top = float(np.clip(max(np.quantile(level, 0.99) for level in levels), 4.0, LARGEST))
        shown = None
        for (name, body, motion, two), level, axes in zip(panels, levels, used, strict=True):
            x, v = (loop(motion, row) for row in two)
            factor, unit = shown_unit(str(motion.unit.values[two[0]]), np.abs(x.measured).max())
            order = np.argsort(level)
            shown = axes.scatter(
                factor * x.measured[order], v.measured[order], c=level[order], s=8.0, cmap=SHADES, vmin=0.0, vmax=top,
                linewidths=0, rasterized=True, zorder=3,
            )  # fmt: skip
            _named(axes, name, body, unit)
        bar = figure.colorbar(shown, ax=grid, shrink=0.75, aspect=28, pad=0.02)
        bar.set_label("Local misfit [standard deviations]")
        bar.outline.set_visible(False)
    return figure


def _level(motion, two):
    """Local misfit (n,): residuals of displacement and velocity, each averaged over a thirtieth of the cycle.

    Root mean square over both, in standard deviations of such an average.
    """
    square = number = 0.0
    for row in two:
        own = loop(motion, row)
        width = 2 * (own.at.size // 60) + 1
        weighted = own.weight * (own.measured - own.calibrated)
        total, counted = (_running(x, width, "period" in motion.attrs) for x in (weighted, own.weight**2))
        here = counted > 0.3 * width
        error = np.linalg.norm(np.convolve(own.response, np.ones(width))) / math.sqrt(width)  # of a sum, over its root
        square = square + np.where(here, total**2 / np.maximum(counted, 1e-9), 0.0) / error**2
        number = number + here
    return np.sqrt(square / np.maximum(number, 1))


def _running(values, width, closed):
    """Sums over `width` neighbours."""
    padded = np.pad(values, width // 2, mode="wrap" if closed else "constant")
    return np.convolve(padded, np.ones(width), mode="valid")


def magnified_loops(motions: Mapping[str, xr.Dataset], label: str) -> Figure | None:
    """Loops of the extended model, and how far from it the calibrated one and the measured lie, magnified."""
    panels = [panel for panel in _panels(motions) if "extended" in panel[2] and "period" in panel[2].attrs]
    if not panels:
        return None
    with mpl.rc_context(STYLE):
        figure, _, used = _grid(panels)
        for (name, body, motion, two), axes in zip(panels, used, strict=True):
            x, v = own = [loop(motion, row) for row in two]
            times = _magnification(own)
            factor, unit = shown_unit(str(motion.unit.values[two[0]]), np.abs(x.measured).max())
            counts = np.minimum(x.weight, v.weight) > 0.5
            seen = [one.extended + times * _smoothed(one) for one in own]
            before = [one.extended + times * (one.calibrated - one.extended) for one in own]
            axes.plot(factor * seen[0][counts], seen[1][counts], ".", color=MEASURED, markersize=3.0, markeredgewidth=0)
            for points, colour in ((before, SIMULATED), ([x.extended, v.extended], EXTENDED)):
                across, up = (np.where(counts, p, np.nan)[np.append(np.arange(counts.size), 0)] for p in points)
                axes.plot(factor * across, up, color=colour, linewidth=1.1, zorder=3)
            _named(axes, name, body, unit)
            axes.set_title(f"{name}, {body}: × {times:g}")
        handles = [_dot(MEASURED, "measured"), _line(SIMULATED, "calibrated"), _line(EXTENDED, label)]
        figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.4, handletextpad=0.5)
    return figure


def _smoothed(own):
    """Measured less extended, averaged over a thirtieth of the cycle (n,)."""
    width = 2 * (own.at.size // 60) + 1
    total, counted = (_running(x, width, True) for x in (own.weight * (own.measured - own.extended), own.weight))
    return total / np.maximum(counted, 1e-9)


def _magnification(own):
    """Round factor by which neither model's nor the measurement's distance exceeds about a seventh of the loop."""
    apart = [
        np.quantile(np.abs(distance), 0.95) / max(np.ptp(one.extended), 1e-300)
        for one in own
        for distance in (one.calibrated - one.extended, _smoothed(one))
    ]
    wanted = max(1.0, 0.15 / max([*apart, 1e-4]))
    return [n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if n <= wanted][-1]


def _panels(motions):
    return [(name, body, motion, two) for name, motion in motions.items() for body, two in pairs(motion).items()]


def _grid(panels):
    """Figure with two panels side by side, or four where each record has two bodies and there are many."""
    columns = min(len(panels), 4 if len(panels) > 4 else 2)
    count = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(WIDTH, (2.0 if columns > 2 else 3.0) * count + 0.4), layout="constrained")
    grid = figure.subplots(count, columns, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    return figure, grid, list(grid.flat[: len(panels)])


def _named(axes, name, body, unit):
    axes.set_title(f"{name}, {body}")
    axes.set_xlabel(f"Displacement [{unit}]")
    axes.set_ylabel("Velocity [m/s]")
    axes.margins(0.07)


# --- looks -----------------------------------------------------------------------------------------------------------


def _fine(unit, largest):
    """Factor and unit of something small: µm and mm/s where that reads better."""
    if unit == "m":
        return (1e6, "µm") if largest < 5e-4 else shown_unit(unit, largest)
    if unit == "m/s":
        return (1e3, "mm/s") if largest < 0.5 else (1.0, unit)
    return shown_unit(unit, largest)


def _dot(colour, label):
    return mpl.lines.Line2D([], [], color=colour, marker=".", markersize=6, linestyle="none", label=label)


def _line(colour, label):
    return mpl.lines.Line2D([], [], color=colour, linewidth=1.5, label=label)
