"""Figures of the predicted separation of rival models over the settings of a next measurement."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from calib.diagnosis.design_document import (
    DesignPointResult,
    DesignResult,
    MeasurementResult,
    RecordSetting,
    setting_of,
)
from calib.diagnosis.laboratory import FREE_DECAY, RECORDED_INPUT, STEADY_TONE, STEPPED_SINE, SWEEP, WITHOUT_CONTACT
from calib.diagnosis.measurement import FAILED, GRID, IRREGULAR, OK
from calib.report.formatting import number
from calib.report.plots.style import LINE, MARK, MEASURED, SIMULATED, STYLE, TEXT_WIDTH, Look, label_powers, logarithmic
from calib.units import shown_unit

COLOURS = "cividis"  # from least to most separation; suits colour-blind readers
MIN_AXIS_Z = 0.1  # lower end of the scale; smaller values are marked as below it  [standard deviations]
HEADROOM_RATIO = 1.5  # upper end of the scale over the decisive z, where no point reaches that  [1]
EXCLUDED = "#e8e8e8"
STARS = {STEADY_TONE: ("*", 15.0), WITHOUT_CONTACT: ("D", 7.0)}  # marker and size [points] of the best
SETTING = {
    SWEEP: "amplitude",
    STEPPED_SINE: "amplitude",
    RECORDED_INPUT: "amplitude",
    FREE_DECAY: "release",
}  # that a test is searched over
MAX_RATIO_WITH_STEPS = 20.0  # of the ends of the scale, below which it has ticks within decades  [1]
BOUNDS_MARGIN = 0.02  # beyond the bounds of the search, as a share of the logarithmic range  [1]
MAX_NAMED_RECORDS = 6  # records that are named in the map
SETTINGS = ("amplitude", "frequency", "release")


class SearchedSetting(NamedTuple):
    """The one setting over which a test is searched, with the unit shown and the factor from SI to that."""

    name: str
    unit: str
    factor: float


def separation_map(design: DesignResult, measurements: Sequence[MeasurementResult]) -> Figure | None:
    """Predicted separation of steady tones over frequency and amplitude; None where not both were searched.

    Parameters
    ----------
    measurements : the best of each kind of test
    """
    tones = [point for point in design.points if point.test == STEADY_TONE]
    bounds = _bounds(design)
    if not tones or not all(bounds[name][0] < bounds[name][1] for name in ("frequency", "amplitude")):
        return None
    factor, unit = _amplitude_unit(design)
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(TEXT_WIDTH, 4.1), layout="constrained")
        axes = figure.subplots()
        frequencies, amplitudes, z = _on_grid(tones, factor, "z")
        low, high = _z_limits([point.z for point in tones], design.decisive_z)
        norm = LogNorm(low, high)
        edges = _edges(frequencies), _edges(amplitudes)
        values = np.clip(z, low, None)
        cells = axes.pcolormesh(*edges, values, norm=norm, cmap=COLOURS, rasterized=True)
        handles: list[Artist] = _mark_excluded(axes, tones, edges, factor)
        handles += _contours(axes, tones, factor, design.decisive_z)
        _mark_refinement(axes, tones, factor, norm)
        handles += _mark_best(axes, measurements, factor)
        handles += _mark_records(axes, design.known, factor)
        axes.set(xscale="log", yscale="log", xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
        for axis, edge in zip((axes.xaxis, axes.yaxis), edges, strict=True):
            logarithmic(axis, edge[0], edge[-1])
        axes.set_xlabel("Frequency of the tone [Hz]")
        axes.set_ylabel(f"Amplitude [{unit}]")
        _colour_bar(figure, axes, cells, (low, high), design.decisive_z)
        figure.legend(handles=handles, loc="outside upper left", ncols=4, columnspacing=1.2, handletextpad=0.5)
    return figure


def separation_lines(design: DesignResult, measurements: Sequence[MeasurementResult]) -> Figure | None:
    """Predicted separation of the tests that are searched over one setting; None where there are none."""
    lines = {test: own for test in (STEADY_TONE, *SETTING) if (own := _searched_setting(design, test)) is not None}
    if not lines:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 2.5), layout="constrained")
        panels = figure.subplots(1, max(2, len(lines)), squeeze=False, sharey=True)[0]
        for axes in panels[len(lines) :]:
            axes.set_visible(False)
        for axes, (test, setting) in zip(panels, lines.items(), strict=False):
            _draw_line(axes, design, test, setting)
            axes.set_title(test)
            label = setting.name.capitalize().replace("Release", "Displacement of release")
            axes.set_xlabel(f"{label} [{setting.unit}]")
            best = _best(measurements, test)
            if best is not None:
                look: Look = {"color": MARK, "markersize": 11, "zorder": 5}
                look |= {"markerfacecolor": "white"} if best.z < MIN_AXIS_Z else {}
                place = setting.factor * setting_of(best, setting.name)
                axes.plot(place, max(best.z, MIN_AXIS_Z), "*", **look)
        low, high = panels[0].get_ylim()
        panels[0].set_ylim(min(low, 0.5 * design.decisive_z), max(high, 2.0 * design.decisive_z))
        panels[0].set_ylabel("Predicted separation z [1]")
    return figure


# --- scales


def _bounds(design: DesignResult) -> dict[str, tuple[float, float]]:
    known = {variable.name: (variable.low, variable.high) for variable in design.variables}
    return {name: known.get(name, (0.0, 0.0)) for name in SETTINGS}


def _amplitude_unit(design: DesignResult) -> tuple[float, str]:
    unit = next((v.unit for v in design.variables if v.name == "amplitude"), "1")
    return shown_unit(unit, _bounds(design)["amplitude"][1])


def _z_limits(z: Sequence[float | None], decisive: float) -> tuple[float, float]:
    """Ends of the colour scale, between which the decisive z lies."""
    known = [value for value in z if value is not None] or [decisive]
    high = max(*known, HEADROOM_RATIO * decisive)
    return max(MIN_AXIS_Z, min(*known, 0.5 * decisive)), high


def _by_status(
    points: Sequence[DesignPointResult],
) -> tuple[list[tuple[DesignPointResult, float]], list[DesignPointResult]]:
    """Points with their separation, and the points without one: an irregular motion or a failed simulation."""
    good = [(point, point.z) for point in points if point.status == OK and point.z is not None]
    return good, [point for point in points if point.status != OK]


def _best(measurements: Sequence[MeasurementResult], test: str) -> MeasurementResult | None:
    """Return the best measurement of a kind of test without additional channels, None where there is none."""
    return next((m for m in measurements if m.kind == test and not m.channel), None)


def _edges(centres: np.ndarray) -> np.ndarray:
    """Bounds (n + 1,) of cells around centres (n,), half-way between neighbours on a logarithmic axis.

    The outermost cells reach no further than their centres, which lie on the bounds of the search, and a margin.
    """
    log = np.log(centres)
    margin = BOUNDS_MARGIN * (log[-1] - log[0])
    return np.exp(np.concatenate([[log[0] - margin], 0.5 * (log[1:] + log[:-1]), [log[-1] + margin]]))


def _on_grid(
    tones: Sequence[DesignPointResult], factor: float, quantity: Literal["z", "impacts"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (n,) [Hz], amplitudes (m,) [shown unit] and a quantity (m, n) of the grid, NaN where unknown."""
    grid = [point for point in tones if point.stage == GRID]
    frequencies = np.unique([setting_of(point, "frequency") for point in grid])
    amplitudes = np.unique([setting_of(point, "amplitude") for point in grid])
    values = np.full((amplitudes.size, frequencies.size), np.nan)
    for point in grid:
        row = np.searchsorted(amplitudes, setting_of(point, "amplitude"))
        column = np.searchsorted(frequencies, setting_of(point, "frequency"))
        value = point.z if quantity == "z" else point.impacts
        values[row, column] = np.nan if value is None else float(value)
    return frequencies, factor * amplitudes, values


# --- the map


def _mark_excluded(
    axes: Axes, tones: Sequence[DesignPointResult], edges: tuple[np.ndarray, np.ndarray], factor: float
) -> list[Artist]:
    """Grey cells with a cross where a simulation failed, with a hatch where the motion is irregular."""
    handles: list[Artist] = []
    for status, hatch, label in ((IRREGULAR, "////", "irregular motion"), (FAILED, "xxx", "simulation failed")):
        own = [point for point in tones if point.status == status]
        look: Look = {"facecolor": EXCLUDED, "edgecolor": LINE, "linewidth": 0.0, "hatch": hatch}
        for point in (p for p in own if p.stage == GRID):
            x = _cell(edges[0], setting_of(point, "frequency"))
            y = _cell(edges[1], factor * setting_of(point, "amplitude"))
            axes.add_patch(Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], **look))
        if own:
            handles.append(Patch(label=label, **look))
    return handles


def _cell(edges: np.ndarray, value: float) -> tuple[float, float]:
    k = int(np.clip(np.searchsorted(edges, value) - 1, 0, edges.size - 2))
    return float(edges[k]), float(edges[k + 1])


def _contours(axes: Axes, tones: Sequence[DesignPointResult], factor: float, decisive: float) -> list[Artist]:
    """Draw where the separation is decisive, and where contact begins."""
    handles: list[Artist] = []
    drawn: tuple[tuple[Literal["z", "impacts"], float, Literal["-", ":"], str, str], ...]
    drawn = (("z", decisive, "-", "#ffffff", f"z = {decisive:g}"), ("impacts", 0.5, ":", MARK, "limit of contact"))
    for key, level, style, colour, label in drawn:
        frequencies, amplitudes, values = _on_grid(tones, factor, key)
        if min(values.shape) < 2 or not np.nanmin(values, initial=np.inf) < level < np.nanmax(values, initial=-np.inf):
            continue
        values = np.log(np.maximum(values, MIN_AXIS_Z)) if key == "z" else values
        level = math.log(level) if key == "z" else level
        look: Look = {"linestyles": style, "linewidths": 1.6}
        if key == "z":
            axes.contour(frequencies, amplitudes, values, levels=[level], colors=LINE, linestyles=style, linewidths=2.8)
        axes.contour(frequencies, amplitudes, values, levels=[level], colors=colour, **look)
        shadow = [withStroke(linewidth=2.8, foreground=LINE)] if key == "z" else []
        handles.append(Line2D([], [], color=colour, linestyle=style, linewidth=1.6, label=label, path_effects=shadow))
    return handles


def _mark_refinement(axes: Axes, tones: Sequence[DesignPointResult], factor: float, norm: LogNorm) -> None:
    """Dots at the points of the refinement, coloured as the cells; crosses where there is no separation."""
    own = [point for point in tones if point.stage != GRID]
    good, bad = _by_status(own)
    axes.scatter(
        [setting_of(point, "frequency") for point, _ in good],
        [factor * setting_of(point, "amplitude") for point, _ in good],
        c=[max(z, float(norm.vmin or MIN_AXIS_Z)) for _, z in good],
        s=14.0, norm=norm, cmap=COLOURS, edgecolors="white", linewidths=0.5, zorder=4,
    )  # fmt: skip
    look: Look = {"color": LINE, "markersize": 3.5, "markeredgewidth": 0.8, "zorder": 4}
    axes.plot(
        [setting_of(p, "frequency") for p in bad], [factor * setting_of(p, "amplitude") for p in bad], "x", **look
    )


def _mark_best(axes: Axes, measurements: Sequence[MeasurementResult], factor: float) -> list[Artist]:
    handles: list[Artist] = []
    for test, (marker, size) in STARS.items():
        best = _best(measurements, test)
        if best is None:
            continue
        look: Look = {"color": MARK, "markeredgecolor": "white", "markersize": size, "marker": marker}
        place = [setting_of(best, "frequency")], [factor * setting_of(best, "amplitude")]
        axes.plot(*place, linestyle="none", zorder=6, clip_on=False, **look)
        handles.append(Line2D([], [], label=f"best {best.kind} (z = {number(best.z, 3)})", linestyle="none", **look))
    return handles


def _mark_records(axes: Axes, known: Sequence[RecordSetting], factor: float) -> list[Artist]:
    """Mark the settings of the existing records with crosses."""
    own = [
        (record.record, record.frequency, factor * record.amplitude)
        for record in known
        if record.amplitude is not None and record.frequency is not None
    ]
    look: Look = {"color": "white", "markeredgecolor": LINE, "markersize": 7.0, "linestyle": "none", "marker": "P"}
    axes.plot([x for _, x, _ in own], [y for *_, y in own], zorder=5, **look)
    for name, x, y in own if len(own) <= MAX_NAMED_RECORDS else ():
        label: Look = {"boxstyle": "square,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0.0}
        axes.annotate(name, (x, y), (6, 5), textcoords="offset points", fontsize=7.5, zorder=6, bbox=label)
    return [Line2D([], [], label="existing records", **look)] if own else []


def _colour_bar(figure: Figure, axes: Axes, cells: QuadMesh, limits: tuple[float, float], decisive: float) -> None:
    bar = figure.colorbar(cells, ax=axes, label="Predicted separation z [standard deviations]", aspect=30, extend="min")
    steps: tuple[float, ...] = (1.0, 2.0, 3.0, 5.0, 7.0) if limits[1] < MAX_RATIO_WITH_STEPS * limits[0] else (1.0, 3.0)
    wanted = {step * 10.0**power for power in range(-1, 6) for step in steps} | {decisive}
    ticks = sorted(tick for tick in wanted if limits[0] <= tick <= limits[1])
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    bar.ax.axhline(decisive, color=LINE, linewidth=2.8)
    bar.ax.axhline(decisive, color="white", linewidth=1.4)


# --- one setting


def _searched_setting(design: DesignResult, test: str) -> SearchedSetting | None:
    """Return the one setting over which a test was searched; None where there are more or no simulation succeeded."""
    if not any(point.test == test and point.status == OK for point in design.points):
        return None
    bounds = _bounds(design)
    if test == STEADY_TONE:
        free = [name for name in ("amplitude", "frequency") if bounds[name][0] < bounds[name][1]]
        if len(free) != 1:
            return None
        [name] = free
    else:
        name = SETTING[test]
    unit = next(v.unit for v in design.variables if v.name == name)
    factor, shown = (1.0, "Hz") if name == "frequency" else shown_unit(unit, bounds[name][1])
    return SearchedSetting(name, shown, factor)


def _draw_line(axes: Axes, design: DesignResult, test: str, setting: SearchedSetting) -> None:
    """Draw the separation of a test over its one setting; what is below the scale or failed is marked at its end."""

    def place(point: DesignPointResult) -> float:
        return setting.factor * setting_of(point, setting.name)

    own = sorted((p for p in design.points if p.test == test), key=place)
    good, bad = _by_status(own)
    shown = [z if z >= MIN_AXIS_Z else math.nan for _, z in good]
    axes.plot([place(p) for p, _ in good], shown, "o-", color=SIMULATED, markersize=3.5, linewidth=1.0)
    below = [place(p) for p, z in good if z < MIN_AXIS_Z]
    axes.plot(below, [MIN_AXIS_Z] * len(below), "v", color=SIMULATED, markersize=4.5, markerfacecolor="white")
    axes.plot([place(p) for p in bad], [MIN_AXIS_Z] * len(bad), "x", color=LINE, markersize=4.0)
    axes.axhline(design.decisive_z, color=MEASURED, linestyle="--", linewidth=1.0)
    axes.annotate(
        f"z = {design.decisive_z:g}",
        (1.0, design.decisive_z),
        (-2, 2),
        textcoords="offset points",
        xycoords=("axes fraction", "data"),
        fontsize=7.5,
        color=MEASURED,
        ha="right",
    )
    axes.set_xscale("log")
    label_powers(axes.xaxis)
    axes.set_yscale("log")
    places = [place(point) for point in own]
    if max(places) > min(places):
        logarithmic(axes.xaxis, min(places), max(places))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
