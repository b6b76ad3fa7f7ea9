"""Pictures of who was suspected of a misfit, and of what the cause that was found brings."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, NullLocator

from calib.report.conclusion import biased_half_width, half_width
from calib.report.drawing import LINE, MARK, MEASURED, OTHER, SIMULATED, STYLE, WIDTH, shown_unit
from calib.report.residual_plots import EXTENDED
from calib.report.words import signed

NAMED, CLASS, LESS, SENSELESS, BELOW = "named", "in the class", "explains less", "wrong sign", "below"
CLOSEST, ABSORBED = "comes closest", "absorbed"
COLOURS = {
    NAMED: EXTENDED, CLASS: "#E69F00", CLOSEST: "#E69F00", LESS: SIMULATED, SENSELESS: "#9cc3dd", BELOW: "#cfcfcf",
    ABSORBED: "#cfcfcf",
}  # fmt: skip
LEGEND = {
    NAMED: "named",
    CLASS: "in the class",
    CLOSEST: "comes closest",
    LESS: "above the threshold, but explains less",
    SENSELESS: "above it, but of an impossible size",
    BELOW: "below the threshold",
}
STEEP = 12.0  # largest |z| over the threshold, from which the axis is logarithmic
MAX_LINEAR = 200.0  # largest shift, in standard errors, up to which the axis is linear  [1]
ROOM, ROOM_OF_LOGARITHMS = 1.3, 40.0  # end of that axis over the largest shift, which leaves room for the labels  [1]
WIDE = 0.62 * WIDTH  # inch: of a picture that would be too wide over the whole page


def suspects(strengths: Sequence[tuple[str, float, str]], threshold: float) -> Figure | None:
    """Strength |z| of each effect (name, |z|, outcome) as a bar, with the threshold."""
    if not strengths:
        return None
    ordered = sorted(strengths, key=lambda s: s[1])
    largest = ordered[-1][1]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 0.165 * len(ordered) + 1.1), layout="constrained")
        axes = figure.subplots()
        steep = largest > STEEP * threshold
        least = 0.1 * threshold
        values = [max(z, 1.15 * least) if steep else z for _, z, _ in ordered]
        axes.barh(range(len(ordered)), values, color=[COLOURS[o] for *_, o in ordered], height=0.68, zorder=3)
        axes.set_yticks(range(len(ordered)), [name for name, *_ in ordered], fontsize=7.5)
        for tick, (*_, outcome) in zip(axes.get_yticklabels(), ordered, strict=True):
            if outcome in (NAMED, CLASS, CLOSEST):
                tick.set_fontweight("bold")
        for k, (_, z, _) in enumerate(ordered):
            axes.annotate(f"{z:.1f}", (values[k], k), (3, 0), textcoords="offset points", fontsize=6.8, va="center")
        axes.axvline(threshold, color=MARK, linewidth=1.2, linestyle=(0, (4, 2)), zorder=4)
        if steep:
            axes.set_xscale("log")
            axes.set_xlim(least, 1.8 * largest)
        else:
            axes.set_xlim(0.0, 1.1 * max(largest, threshold))
        axes.set_ylim(-0.7, len(ordered) - 0.3)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel("|z| of the score test: evidence of the effect in the residuals [standard deviations by noise]")
        used = [outcome for outcome in LEGEND if any(o == outcome for *_, o in ordered)]
        handles = [mpl.patches.Patch(color=COLOURS[outcome], label=LEGEND[outcome]) for outcome in used]
        dashes = {"color": MARK, "linewidth": 1.2, "linestyle": (0, (4, 2))}
        handles.append(mpl.lines.Line2D([], [], label=f"threshold {threshold:.2f}", **dashes))
        figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.4, handletextpad=0.5)
    return figure


def gain(found: Mapping[str, Any]) -> Figure | None:
    """Held-out misfit before and after as dots, a row each record; over all of them with its interval."""
    lines = [(name, *pair, None) for name, pair in found["each"].items()]
    lines = [row for row in lines if None not in row[1:3]]
    if found["before"] is not None and None not in found["interval"]:
        low, high = found["interval"]
        name = lines.pop()[0] if len(lines) == 1 else "all together"
        lines.append((name, found["before"], found["after"], (found["before"] - high, found["before"] - low)))
    if not lines:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 0.32 * len(lines) + 0.95), layout="constrained")
        axes = figure.subplots()
        for k, (_, before, after, interval) in enumerate(reversed(lines)):
            axes.plot([100.0 * before, 100.0 * after], [k, k], color=OTHER, linewidth=1.0, zorder=2)
            if interval is not None:
                ends = [100.0 * x for x in interval]
                axes.plot(ends, [k, k], color=EXTENDED, linewidth=5.0, alpha=0.35, solid_capstyle="butt", zorder=2)
            axes.plot(100.0 * before, k, "o", color="white", markeredgecolor=SIMULATED, markersize=6.5, zorder=4)
            axes.plot(100.0 * after, k, "o", color=EXTENDED, markersize=6.5, zorder=5)
        axes.set_yticks(range(len(lines)), [name for name, *_ in reversed(lines)])
        axes.set_ylim(-0.6, len(lines) - 0.4)
        axes.margins(x=0.08)
        axes.set_xlabel("Misfit: residual over the motion, root mean squares [%]")
        band = {"color": EXTENDED, "linewidth": 5.0, "alpha": 0.35}
        handles = [
            mpl.lines.Line2D([], [], color="white", marker="o", markeredgecolor=SIMULATED, label="calibrated"),
            mpl.lines.Line2D([], [], color=EXTENDED, marker="o", linestyle="none", label="with the extension"),
            mpl.lines.Line2D([], [], label="95 % interval of the difference", **band),
        ]
        figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.4, handletextpad=0.5)
    return figure


def transfers(
    found: Sequence[Mapping[str, Any]], sizes: Mapping[str, tuple[float, float, float]], units: Mapping[str, str]
) -> Figure | None:
    """Size of each parameter of the causes as each record alone has it, with its 95 % interval; and the common one.

    sizes : parameter -> size and its interval, in SI
    """
    names = list(dict.fromkeys(transfer["parameter"] for transfer in found))
    if not names:
        return None
    records = list(dict.fromkeys(transfer["record"] for transfer in found))
    columns = min(2, len(names))
    count = math.ceil(len(names) / columns)
    with mpl.rc_context(STYLE):
        size = (WIDTH if columns > 1 else WIDE + 0.8, count * (0.27 * len(records) + 0.75) + 0.35)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(count, columns, squeeze=False)
        for name, axes in zip(names, grid.flat, strict=False):
            own = [t for t in found if t["parameter"] == name and None not in (t["size"], t["error"])]
            largest = max((abs(t["size"]) for t in own), default=0.0)
            factor, unit = shown_unit(units.get(name, "1"), largest)
            for t in own:
                look = {"color": MARK if t["held"] else LINE, "markersize": 5.0, "capsize": 2.5, "linewidth": 1.1}
                fill = {"markerfacecolor": "white"} if t["held"] else {}
                row = records[::-1].index(t["record"])
                half = factor * half_width(t)
                axes.errorbar(factor * t["size"], row, xerr=half, fmt="o", zorder=3, **look, **fill)
                if t.get("bias"):  # not written by earlier versions
                    wide = factor * biased_half_width(t)
                    axes.errorbar(factor * t["size"], row, xerr=wide, color=look["color"], linewidth=3.0, alpha=0.3)
            if name in sizes:
                common, low, high = (factor * x for x in sizes[name])
                axes.axvspan(low, high, color=EXTENDED, alpha=0.22, linewidth=0)
                axes.axvline(common, color=EXTENDED, linewidth=1.1)
            axes.set_yticks(range(len(records)), records[::-1])
            axes.set_ylim(-0.6, len(records) - 0.4)
            axes.axvline(0.0, color=MEASURED, linewidth=0.7)
            axes.set_xlabel(f"{name} [{unit}]")
            _within(axes, own, factor, sizes.get(name))
        for axes in grid.flat[len(names) :]:
            axes.set_visible(False)
        handles = [
            mpl.lines.Line2D([], [], color=LINE, marker="o", label="one record alone"),
            mpl.lines.Line2D([], [], color=MARK, marker="o", markerfacecolor="white", label="held out"),
            mpl.patches.Patch(color=EXTENDED, alpha=0.4, label="records that were fitted"),
        ]
        if any(t.get("bias") for t in found):
            handles.append(mpl.lines.Line2D([], [], color=LINE, linewidth=3.0, alpha=0.3, label="with bias"))
        figure.legend(handles=handles, loc="outside upper right", ncols=4, columnspacing=1.4, handletextpad=0.5)
    return figure


def _within(axes, own, factor, size):
    """Show what is determined: a record that says nearly nothing may run out of the picture."""
    halves = sorted(map(half_width, own))
    if not halves:
        return
    wide = 6.0 * halves[len(halves) // 2]
    centre = size[0] if size else sorted(t["size"] for t in own)[len(own) // 2]
    ends = [x for t in own for x in (t["size"] - half_width(t), t["size"] + half_width(t))] + [0.0, centre]
    near = [t["size"] for t in own if half_width(t) < 2.0 * wide]
    low, high = max(min(ends), min(centre - wide, 0.0, *near)), min(max(ends), max(centre + wide, 0.0, *near))
    room = 0.05 * (high - low) or 1.0
    axes.set_xlim(factor * (low - room), factor * (high + room))


def shifts(found: Sequence[Mapping[str, Any]]) -> Figure | None:
    """By how many of its standard errors each calibrated parameter moves when the cause is in the model."""
    known = [s for s in found if s["errors"] is not None]
    if not known:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE + 0.8, 0.24 * len(known) + 0.65), layout="constrained")
        axes = figure.subplots()
        largest = max(abs(s["errors"]) for s in known)
        axes.axvspan(-2.0, 2.0, color="#e8e8e8", linewidth=0, zorder=0)
        for k, s in enumerate(reversed(known)):
            moved = s["errors"]
            axes.barh(k, moved, height=0.5, color=MARK if abs(moved) > 2.0 else OTHER, zorder=3)
            side = 1 if moved >= 0.0 else -1
            place = {"textcoords": "offset points", "ha": "left" if side > 0 else "right", "va": "center"}
            axes.annotate(signed(moved, "+"), (moved, k), (3 * side, 0), fontsize=7.5, **place)
        axes.set_yticks(range(len(known)), [s["parameter"] for s in reversed(known)])
        axes.set_ylim(-0.6, len(known) - 0.4)
        logarithmic = largest > MAX_LINEAR
        reach = (ROOM_OF_LOGARITHMS if logarithmic else ROOM) * max(largest, 2.5)
        axes.set_xlim(-reach, reach)
        if logarithmic:
            axes.set_xscale("symlog", linthresh=2.0)
            axes.xaxis.set_minor_locator(NullLocator())
            axes.xaxis.set_minor_formatter(NullFormatter())
        axes.axvline(0.0, color=LINE, linewidth=0.7)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("Shift [standard errors of the calibrated value]")
    return figure
