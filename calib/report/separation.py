"""Pictures of the predicted separation of rival models over the settings of a next measurement."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from calib.diagnosis.laboratory import FREE_DECAY, RECORDED_INPUT, STEADY_TONE, SWEEP, WITHOUT_CONTACT
from calib.diagnosis.measurement import FAILED, GRID, IRREGULAR, OK
from calib.report.drawing import LINE, MARK, MEASURED, SIMULATED, STYLE, WIDTH, logarithmic, shown_unit
from calib.report.words import number

COLOURS = "cividis"  # from least to most separation; read alike by colour-blind readers
LEAST_Z = 0.1  # end of the scale: smaller ones are marked as being below it
HEADROOM = 1.5  # of the scale above the decisive z, where no point reaches that
EXCLUDED = "#e8e8e8"
STARS = {STEADY_TONE: ("*", 15.0), WITHOUT_CONTACT: ("D", 7.0)}  # marker and size [points] of the best
SETTING = {SWEEP: "amplitude", RECORDED_INPUT: "amplitude", FREE_DECAY: "release"}  # that a test is searched over
FEW_DECADES = 20.0  # ratio of the ends of the scale below which it has ticks in between
EDGE_MARGIN = 0.02  # of the range on a logarithmic axis, beyond the bounds of the search
MAX_NAMES = 6  # records that are named in the map


def separation_map(design: Mapping[str, Any], measurements: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Predicted separation of steady tones over frequency and amplitude; None where not both were searched.

    Parameters
    ----------
    design : as diagnosis.json holds it
    measurements : the best of each kind of test
    """
    tones = [point for point in design["points"] if point["test"] == STEADY_TONE]
    bounds = _bounds(design)
    if not tones or not all(bounds[name][0] < bounds[name][1] for name in ("frequency", "amplitude")):
        return None
    factor, unit = _amplitude_unit(design)
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(WIDTH, 4.1), layout="constrained")
        axes = figure.subplots()
        frequencies, amplitudes, z = _on_grid(tones, factor, "z")
        norm = _norm([point["z"] for point in tones], design["decisive_z"])
        edges = _edges(frequencies), _edges(amplitudes)
        cells = axes.pcolormesh(*edges, np.clip(z, norm.vmin, None), norm=norm, cmap=COLOURS, rasterized=True)
        handles = _mark_excluded(axes, tones, edges, factor)
        handles += _contours(axes, tones, factor, design["decisive_z"])
        _mark_refinement(axes, tones, factor, norm)
        handles += _mark_best(axes, measurements, factor)
        handles += _mark_records(axes, design["known"], factor)
        axes.set(xscale="log", yscale="log", xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
        for axis, edge in zip((axes.xaxis, axes.yaxis), edges, strict=True):
            logarithmic(axis, edge[0], edge[-1])
        axes.set_xlabel("Frequency of the tone [Hz]")
        axes.set_ylabel(f"Amplitude [{unit}]")
        _colour_bar(figure, axes, cells, design["decisive_z"])
        figure.legend(handles=handles, loc="outside upper left", ncols=4, columnspacing=1.2, handletextpad=0.5)
    return figure


def separation_lines(design: Mapping[str, Any], measurements: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Predicted separation of the tests that are searched over one setting; None where there are none."""
    lines = {test: own for test in (STEADY_TONE, *SETTING) if (own := _line(design, test)) is not None}
    if not lines:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 2.5), layout="constrained")
        panels = figure.subplots(1, max(2, len(lines)), squeeze=False, sharey=True)[0]
        for axes in panels[len(lines) :]:
            axes.set_visible(False)
        for axes, (test, (name, unit, factor)) in zip(panels, lines.items(), strict=False):
            _draw_line(axes, design, test, name, factor)
            axes.set_title(test)
            axes.set_xlabel(f"{name.capitalize().replace('Release', 'Displacement of release')} [{unit}]")
            best = next((m for m in measurements if m["kind"] == test and not m["channel"]), None)
            if best is not None:
                look = {"color": MARK, "markersize": 11, "zorder": 5}
                look |= {"markerfacecolor": "white"} if best["z"] < LEAST_Z else {}
                axes.plot(factor * best[name], max(best["z"], LEAST_Z), "*", **look)
        low, high = panels[0].get_ylim()
        panels[0].set_ylim(min(low, 0.5 * design["decisive_z"]), max(high, 2.0 * design["decisive_z"]))
        panels[0].set_ylabel("Predicted separation z")
    return figure


# --- scales


def _bounds(design) -> dict[str, tuple[float, float]]:
    known = {variable["name"]: (variable["low"], variable["high"]) for variable in design["variables"]}
    return {name: known.get(name, (0.0, 0.0)) for name in ("amplitude", "frequency", "release")}


def _amplitude_unit(design) -> tuple[float, str]:
    unit = next((v["unit"] for v in design["variables"] if v["name"] == "amplitude"), "1")
    return shown_unit(unit, _bounds(design)["amplitude"][1])


def _norm(z, decisive) -> LogNorm:
    known = [value for value in z if value is not None] or [decisive]
    high = max(*known, HEADROOM * decisive)
    return LogNorm(max(LEAST_Z, min(*known, 0.5 * decisive)), high)


def _edges(centres: np.ndarray) -> np.ndarray:
    """Bounds (n + 1,) of cells around centres (n,), half-way between neighbours on a logarithmic axis.

    The outermost cells reach no further than their centres, which lie on the bounds of the search, and a margin.
    """
    log = np.log(centres)
    margin = EDGE_MARGIN * (log[-1] - log[0])
    return np.exp(np.concatenate([[log[0] - margin], 0.5 * (log[1:] + log[:-1]), [log[-1] + margin]]))


def _on_grid(tones, factor, key) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (n,) [Hz], amplitudes (m,) [shown unit] and a quantity (m, n) of the grid, NaN where it is not."""
    grid = [point for point in tones if point["stage"] == GRID]
    frequencies = np.unique([point["frequency"] for point in grid])
    amplitudes = np.unique([point["amplitude"] for point in grid])
    values = np.full((amplitudes.size, frequencies.size), np.nan)
    for point in grid:
        row, column = np.searchsorted(amplitudes, point["amplitude"]), np.searchsorted(frequencies, point["frequency"])
        values[row, column] = np.nan if point[key] is None else float(point[key])
    return frequencies, factor * amplitudes, values


# --- the map


def _mark_excluded(axes, tones, edges, factor) -> list:
    """Grey cells with a cross where a simulation failed, with a hatch where the motion is irregular."""
    handles = []
    for status, hatch, label in ((IRREGULAR, "////", "irregular motion"), (FAILED, "xxx", "simulation failed")):
        own = [point for point in tones if point["status"] == status]
        look = {"facecolor": EXCLUDED, "edgecolor": LINE, "linewidth": 0.0, "hatch": hatch}
        for point in (p for p in own if p["stage"] == GRID):
            x, y = _cell(edges[0], point["frequency"]), _cell(edges[1], factor * point["amplitude"])
            axes.add_patch(mpl.patches.Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], **look))
        if own:
            handles.append(mpl.patches.Patch(label=label, **look))
    return handles


def _cell(edges, value) -> tuple[float, float]:
    k = int(np.clip(np.searchsorted(edges, value) - 1, 0, edges.size - 2))
    return float(edges[k]), float(edges[k + 1])


def _contours(axes, tones, factor, decisive) -> list:
    """Draw where the separation is decisive, and where contact begins."""
    handles = []
    drawn = (("z", decisive, "-", "#ffffff", f"z = {decisive:g}"), ("impacts", 0.5, ":", MARK, "limit of contact"))
    for key, level, style, colour, label in drawn:
        frequencies, amplitudes, values = _on_grid(tones, factor, key)
        if min(values.shape) < 2 or not np.nanmin(values, initial=np.inf) < level < np.nanmax(values, initial=-np.inf):
            continue
        values = np.log(np.maximum(values, LEAST_Z)) if key == "z" else values
        level = math.log(level) if key == "z" else level
        look = {"linestyles": style, "linewidths": 1.6}
        if key == "z":
            axes.contour(frequencies, amplitudes, values, levels=[level], colors=LINE, linestyles=style, linewidths=2.8)
        axes.contour(frequencies, amplitudes, values, levels=[level], colors=colour, **look)
        shadow = [withStroke(linewidth=2.8, foreground=LINE)] if key == "z" else []
        handles.append(
            mpl.lines.Line2D([], [], color=colour, linestyle=style, linewidth=1.6, label=label, path_effects=shadow)
        )
    return handles


def _mark_refinement(axes, tones, factor, norm) -> None:
    """Dots at the points of the refinement, coloured as the cells; crosses where there is no separation."""
    own = [point for point in tones if point["stage"] != GRID]
    good = [point for point in own if point["status"] == OK]
    bad = [point for point in own if point["status"] != OK]
    axes.scatter(
        [point["frequency"] for point in good],
        [factor * point["amplitude"] for point in good],
        c=[max(point["z"], norm.vmin) for point in good],
        s=14.0, norm=norm, cmap=COLOURS, edgecolors="white", linewidths=0.5, zorder=4,
    )  # fmt: skip
    look = {"color": LINE, "markersize": 3.5, "markeredgewidth": 0.8, "zorder": 4}
    axes.plot([p["frequency"] for p in bad], [factor * p["amplitude"] for p in bad], "x", **look)


def _mark_best(axes, measurements, factor) -> list:
    handles = []
    for test, (marker, size) in STARS.items():
        best = next((m for m in measurements if m["kind"] == test and not m["channel"]), None)
        if best is None:
            continue
        look = {"color": MARK, "markeredgecolor": "white", "markersize": size, "linestyle": "none", "marker": marker}
        axes.plot([best["frequency"]], [factor * best["amplitude"]], zorder=6, clip_on=False, **look)
        handles.append(mpl.lines.Line2D([], [], label=f"best {best['kind']} (z = {number(best['z'], 3)})", **look))
    return handles


def _mark_records(axes, known, factor) -> list:
    """Crosses at the settings of the records that there are."""
    own = [record for record in known if None not in (record["amplitude"], record["frequency"])]
    look = {"color": "white", "markeredgecolor": LINE, "markersize": 7.0, "linestyle": "none", "marker": "P"}
    axes.plot([r["frequency"] for r in own], [factor * r["amplitude"] for r in own], zorder=5, **look)
    for record in own if len(own) <= MAX_NAMES else ():
        place = (record["frequency"], factor * record["amplitude"])
        label = {"boxstyle": "square,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0.0}
        axes.annotate(record["record"], place, (6, 5), textcoords="offset points", fontsize=7.5, zorder=6, bbox=label)
    return [mpl.lines.Line2D([], [], label="records", **look)] if own else []


def _colour_bar(figure, axes, cells, decisive) -> None:
    bar = figure.colorbar(cells, ax=axes, label="Predicted separation z", aspect=30, extend="min")
    steps = (1.0, 2.0, 3.0, 5.0, 7.0) if bar.vmax < FEW_DECADES * bar.vmin else (1.0, 3.0)
    ticks = {step * 10.0**power for power in range(-1, 6) for step in steps} | {decisive}
    ticks = sorted(tick for tick in ticks if bar.vmin <= tick <= bar.vmax)
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    bar.ax.axhline(decisive, color=LINE, linewidth=2.8)
    bar.ax.axhline(decisive, color="white", linewidth=1.4)


# --- one setting


def _line(design, test) -> tuple[str, str, float] | None:
    """Setting over which a test was searched alone, its shown unit, and the factor to that; None for another test."""
    if not any(point["test"] == test and point["status"] == OK for point in design["points"]):
        return None
    bounds, name = _bounds(design), SETTING.get(test)
    if test == STEADY_TONE:
        free = [name for name in ("amplitude", "frequency") if bounds[name][0] < bounds[name][1]]
        if len(free) != 1:
            return None
        [name] = free
    unit = next(v["unit"] for v in design["variables"] if v["name"] == name)
    factor, shown = (1.0, "Hz") if name == "frequency" else shown_unit(unit, bounds[name][1])
    return name, shown, factor


def _draw_line(axes, design, test, name, factor) -> None:
    own = sorted((p for p in design["points"] if p["test"] == test), key=lambda p: p[name])
    good = [point for point in own if point["status"] == OK]
    bad = [point for point in own if point["status"] != OK]
    shown = [p["z"] if p["z"] >= LEAST_Z else math.nan for p in good]
    axes.plot([factor * p[name] for p in good], shown, "o-", color=SIMULATED, markersize=3.5, linewidth=1.0)
    below = [factor * p[name] for p in good if p["z"] < LEAST_Z]
    axes.plot(below, [LEAST_Z] * len(below), "v", color=SIMULATED, markersize=4.5, markerfacecolor="white")
    axes.plot([factor * p[name] for p in bad], [LEAST_Z] * len(bad), "x", color=LINE, markersize=4.0)
    axes.axhline(design["decisive_z"], color=MEASURED, linestyle="--", linewidth=1.0)
    axes.annotate(
        f"z = {design['decisive_z']:g}",
        (1.0, design["decisive_z"]),
        (-2, 2),
        textcoords="offset points",
        xycoords=("axes fraction", "data"),
        fontsize=7.5,
        color=MEASURED,
        ha="right",
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    places = [factor * point[name] for point in own]
    if max(places) > min(places):
        logarithmic(axes.xaxis, min(places), max(places))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
