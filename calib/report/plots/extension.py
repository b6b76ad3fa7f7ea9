"""Figures of what an extension of the model changes: misfit, sizes record by record, calibrated values."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter, NullLocator

from calib.diagnosis.document import GainResult, ShiftResult
from calib.report.formatting import raised, signed
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
    PowerLabels,
)
from calib.units import shown_unit

MAX_LINEAR_SHIFT = 200.0  # largest shift up to which the axis is linear  [standard errors]
LINEAR_HEADROOM_RATIO, LOGARITHMIC_HEADROOM_RATIO = 1.3, 40.0  # end of an axis over the largest shift  [1]
HIGHLIGHTED_SHIFT = 2.0  # that is highlighted  [standard errors]
NARROW_FIGURE_WIDTH = 0.62 * TEXT_WIDTH  # inch: of a figure of one panel


class RecordSize(NamedTuple):
    """Size of a parameter refitted to one record alone, in SI.

    `half_width` is that of its 95 % interval, `biased_half_width` that of the wider one which counts bias; None where
    there is no bias.
    """

    record: str
    parameter: str
    size: float
    half_width: float
    biased_half_width: float | None
    held_out: bool


class CommonSize(NamedTuple):
    """Size of a parameter common to the fitted records, with its 95 % interval, in SI."""

    size: float
    low: float
    high: float


class MisfitChange(NamedTuple):
    """Misfit of a record before and after the extension, and the ends of the interval that is drawn  [1]."""

    name: str
    before: float
    after: float
    interval: tuple[float, float] | None


def misfit_change(gain: GainResult) -> Figure | None:
    """Misfit before and after as dots, a row for each record; over all of them with the interval of the reduction."""
    lines = _changes(gain)
    if not lines:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 0.32 * len(lines) + 0.95), layout="constrained")
        axes = figure.subplots()
        band: Look = {"color": EXTENDED, "linewidth": 5.0, "alpha": 0.35}
        for k, (_, before, after, interval) in enumerate(reversed(lines)):
            axes.plot([100.0 * before, 100.0 * after], [k, k], color=OTHER, linewidth=1.0, zorder=2)
            if interval is not None:
                ends = [100.0 * x for x in interval]
                axes.plot(ends, [k, k], solid_capstyle="butt", zorder=2, **band)
            axes.plot(100.0 * before, k, "o", color="white", markeredgecolor=SIMULATED, markersize=6.5, zorder=4)
            axes.plot(100.0 * after, k, "o", color=EXTENDED, markersize=6.5, zorder=5)
        axes.set_yticks(range(len(lines)), [line.name for line in reversed(lines)])
        axes.set_ylim(-0.6, len(lines) - 0.4)
        axes.margins(x=0.08)
        axes.set_xlabel("Misfit: rms of the residual over rms of the motion about its mean [%]")
        handles = [
            Line2D([], [], color="white", marker="o", markeredgecolor=SIMULATED, label="calibrated"),
            Line2D([], [], color=EXTENDED, marker="o", linestyle="none", label="with the extension"),
            Line2D([], [], label="95 % interval of the difference", **band),
        ]
        figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.4, handletextpad=0.5)
    return figure


def _changes(gain: GainResult) -> list[MisfitChange]:
    """Rows of the figure: each record whose misfits are known, and all of them together."""
    lines = [
        MisfitChange(name, before, after, None)
        for name, (before, after) in gain.each.items()
        if before is not None and after is not None
    ]
    low, high = gain.interval
    if gain.before is not None and gain.after is not None and low is not None and high is not None:
        name = lines.pop().name if len(lines) == 1 else "all records"
        lines.append(MisfitChange(name, gain.before, gain.after, (gain.before - high, gain.before - low)))
    return lines


def sizes_by_record(
    known: Sequence[RecordSize], common: Mapping[str, CommonSize], units: Mapping[str, str]
) -> Figure | None:
    """Size of each parameter of the causes refitted to each record alone, with its 95 % interval; and the common one.

    common, units : by parameter
    """
    names = list(dict.fromkeys(own.parameter for own in known))
    if not names:
        return None
    records = list(dict.fromkeys(own.record for own in known))
    columns = min(2, len(names))
    count = math.ceil(len(names) / columns)
    with mpl.rc_context(STYLE):
        size = (TEXT_WIDTH if columns > 1 else NARROW_FIGURE_WIDTH + 0.8, count * (0.27 * len(records) + 0.75) + 0.35)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(count, columns, squeeze=False)
        for name, axes in zip(names, grid.flat, strict=False):
            own = [one for one in known if one.parameter == name]
            factor, unit = shown_unit(units.get(name, "1"), max(abs(one.size) for one in own))
            _draw_sizes(axes, own, records, factor)
            _draw_common_size(axes, common.get(name), factor)
            axes.set_yticks(range(len(records)), records[::-1])
            axes.set_ylim(-0.6, len(records) - 0.4)
            axes.axvline(0.0, color=MEASURED, linewidth=0.7)
            axes.set_xlabel(f"{name} [{raised(unit)}]")
            _limit(axes, own, factor, common.get(name))
        for axes in grid.flat[len(names) :]:
            axes.set_visible(False)
        handles: list[Line2D | Patch] = [
            Line2D([], [], color=LINE, marker="o", label="one record alone"),
            Line2D([], [], color=MARK, marker="o", markerfacecolor="white", label="held out"),
            Patch(color=EXTENDED, alpha=0.4, label="all fitted records together"),
        ]
        if any(one.biased_half_width is not None for one in known):
            handles.append(Line2D([], [], color=LINE, linewidth=3.0, alpha=0.3, label="with bias"))
        figure.legend(handles=handles, loc="outside upper right", ncols=4, columnspacing=1.4, handletextpad=0.5)
    return figure


def _draw_sizes(axes: Axes, own: Sequence[RecordSize], records: Sequence[str], factor: float) -> None:
    """Draw the size that each record alone has, a row for each record."""
    for one in own:
        colour = MARK if one.held_out else LINE
        look: Look = {"color": colour, "markersize": 5.0, "capsize": 2.5, "linewidth": 1.1}
        look |= {"markerfacecolor": "white"} if one.held_out else {}
        row = records[::-1].index(one.record)
        axes.errorbar(factor * one.size, row, xerr=factor * one.half_width, fmt="o", zorder=3, **look)
        if one.biased_half_width is not None:
            half = factor * one.biased_half_width
            axes.errorbar(factor * one.size, row, xerr=half, color=colour, linewidth=3.0, alpha=0.3)


def _draw_common_size(axes: Axes, common: CommonSize | None, factor: float) -> None:
    """Draw the size that all fitted records together have, with its 95 % interval as a band."""
    if common is not None:
        axes.axvspan(factor * common.low, factor * common.high, color=EXTENDED, alpha=0.22, linewidth=0)
        axes.axvline(factor * common.size, color=EXTENDED, linewidth=1.1)


def _limit(axes: Axes, own: Sequence[RecordSize], factor: float, common: CommonSize | None) -> None:
    """Limit the axis to the sizes that are determined; an interval that is far wider is cut off."""
    halves = sorted(one.half_width for one in own)
    wide = 6.0 * halves[len(halves) // 2]
    centre = common.size if common else sorted(one.size for one in own)[len(own) // 2]
    ends = [x for one in own for x in (one.size - one.half_width, one.size + one.half_width)] + [0.0, centre]
    near = [one.size for one in own if one.half_width < 2.0 * wide]
    low, high = max(min(ends), min(centre - wide, 0.0, *near)), min(max(ends), max(centre + wide, 0.0, *near))
    margin = 0.05 * (high - low) or 1.0
    axes.set_xlim(factor * (low - margin), factor * (high + margin))


def value_shifts(shifts: Sequence[ShiftResult]) -> Figure | None:
    """Shift of each calibrated value by the extension, in its standard errors; None where none is known."""
    known = [(shift.parameter, shift.errors) for shift in shifts if shift.errors is not None]
    if not known:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(NARROW_FIGURE_WIDTH + 0.8, 0.24 * len(known) + 0.65), layout="constrained")
        axes = figure.subplots()
        largest = max(abs(errors) for _, errors in known)
        axes.axvspan(-HIGHLIGHTED_SHIFT, HIGHLIGHTED_SHIFT, color="#e8e8e8", linewidth=0, zorder=0)
        for k, (_, moved) in enumerate(reversed(known)):
            axes.barh(k, moved, height=0.5, color=MARK if abs(moved) > HIGHLIGHTED_SHIFT else OTHER, zorder=3)
            side = 1 if moved >= 0.0 else -1
            place: Look = {"textcoords": "offset points", "ha": "left" if side > 0 else "right", "va": "center"}
            axes.annotate(signed(moved, "+"), (moved, k), (3 * side, 0), fontsize=7.5, **place)
        axes.set_yticks(range(len(known)), [name for name, _ in reversed(known)])
        axes.set_ylim(-0.6, len(known) - 0.4)
        logarithmic = largest > MAX_LINEAR_SHIFT
        reach = (LOGARITHMIC_HEADROOM_RATIO if logarithmic else LINEAR_HEADROOM_RATIO) * max(largest, 2.5)
        axes.set_xlim(-reach, reach)
        if logarithmic:
            axes.set_xscale("symlog", linthresh=HIGHLIGHTED_SHIFT)
            axes.xaxis.set_minor_locator(NullLocator())
            axes.xaxis.set_major_formatter(PowerLabels())
            axes.xaxis.set_minor_formatter(NullFormatter())
        axes.axvline(0.0, color=LINE, linewidth=0.7)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("Shift [standard errors of the calibrated value]")
    return figure
