"""Figure of the suspected effects: how strongly each shows in the residuals."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from calib.report.formatting import signed
from calib.report.plots.style import EXTENDED, MARK, SIMULATED, STYLE, TEXT_WIDTH, Look, label_powers

MAX_LINEAR_RATIO = 12.0  # largest |z| over the threshold up to which the axis is linear  [1]
PATCH = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}  # behind a number, on which a line may lie
MIN_AXIS_RATIO = 0.1  # lower end of a logarithmic axis over the threshold  [1]


class SuspectOutcome(StrEnum):
    """What a diagnosis concludes of a suspected effect."""

    NAMED = "named"
    INDISTINGUISHABLE = "in the class"
    CLOSEST = "explains most"
    EXPLAINS_LESS = "explains less"
    WRONG_SIGN = "wrong sign"
    BELOW = "below"
    ABSORBED = "absorbed"


COLOURS = {
    SuspectOutcome.NAMED: EXTENDED,
    SuspectOutcome.INDISTINGUISHABLE: "#E69F00",
    SuspectOutcome.CLOSEST: "#E69F00",
    SuspectOutcome.EXPLAINS_LESS: SIMULATED,
    SuspectOutcome.WRONG_SIGN: "#9cc3dd",
    SuspectOutcome.BELOW: "#cfcfcf",
    SuspectOutcome.ABSORBED: "#cfcfcf",
}
LEGEND = {
    SuspectOutcome.NAMED: "named",
    SuspectOutcome.INDISTINGUISHABLE: "indistinguishable alternatives",
    SuspectOutcome.CLOSEST: "explains most, but cannot be named",
    SuspectOutcome.EXPLAINS_LESS: "above the threshold, explains less",
    SuspectOutcome.WRONG_SIGN: "above the threshold, size of the wrong sign",
    SuspectOutcome.BELOW: "below the threshold",
}
EMPHASISED = (SuspectOutcome.NAMED, SuspectOutcome.INDISTINGUISHABLE, SuspectOutcome.CLOSEST)


class Strength(NamedTuple):
    """Strength |z| of an effect in the residuals, and what the diagnosis concludes of it."""

    effect: str
    z: float
    outcome: SuspectOutcome


def suspect_strengths(strengths: Sequence[Strength], threshold: float) -> Figure | None:
    """Strength |z| of each effect as a bar, with the threshold; None where there are no effects."""
    if not strengths:
        return None
    ordered = sorted(strengths, key=lambda s: s.z)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 0.165 * len(ordered) + 1.1), layout="constrained")
        axes = figure.subplots()
        _draw_bars(axes, ordered, threshold)
        dashes: Look = {"color": MARK, "linewidth": 1.2, "linestyle": (0, (4, 2))}
        axes.axvline(threshold, zorder=4, **dashes)
        axes.set_ylim(-0.7, len(ordered) - 0.3)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel("|z| of the score test of the effect in the residuals [standard deviations of noise]")
        used = [outcome for outcome in LEGEND if any(s.outcome == outcome for s in ordered)]
        patches = [Patch(color=COLOURS[outcome], label=LEGEND[outcome]) for outcome in used]
        handles = [*patches, Line2D([], [], label=f"threshold {threshold:.2f}", **dashes)]
        figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.4, handletextpad=0.5)
    return figure


def _draw_bars(axes: Axes, ordered: Sequence[Strength], threshold: float) -> None:
    """Draw a bar for each strength with its number; the axis is logarithmic where they differ much."""
    largest = ordered[-1].z
    logarithmic = largest > MAX_LINEAR_RATIO * threshold
    least = MIN_AXIS_RATIO * threshold
    values = [max(s.z, 1.15 * least) if logarithmic else s.z for s in ordered]
    axes.barh(range(len(ordered)), values, color=[COLOURS[s.outcome] for s in ordered], height=0.68, zorder=3)
    axes.set_yticks(range(len(ordered)), [s.effect for s in ordered], fontsize=7.5)
    for tick, strength in zip(axes.get_yticklabels(), ordered, strict=True):
        if strength.outcome in EMPHASISED:
            tick.set_fontweight("bold")
    for k, strength in enumerate(ordered):
        place = (values[k], k)
        axes.annotate(
            signed(strength.z),
            place,
            (3, 0),
            textcoords="offset points",
            fontsize=6.8,
            va="center",
            zorder=5,
            bbox=PATCH,
        )
    if logarithmic:
        axes.set_xscale("log")
        label_powers(axes.xaxis)
        axes.set_xlim(least, 1.8 * largest)
    else:
        axes.set_xlim(0.0, 1.1 * max(largest, threshold))
