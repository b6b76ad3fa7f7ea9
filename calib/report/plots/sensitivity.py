"""Figure of a sensitivity: shares of the kinds of motion, and the influence of every parameter on every output."""

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.report.plots.style import FAILED as FAILED_COLOUR
from calib.report.plots.style import KINDS as COLOURS
from calib.report.plots.style import LINE, OTHER, STYLE, Look
from calib.sweep.sensitivity.design import MORRIS
from calib.sweep.sensitivity.document import Influence, OutputSensitivity, SensitivityResult
from calib.sweep.sensitivity.words import MIN_MONOTONIC_SHARE, interval_in_percent, percent, share_name, title
from calib.units import shown

SENSITIVITY_CELL = (1.05, 0.36)  # inch, width and height
MIN_LABELLED_SHARE = 0.07  # of the bar, in which its number has room
DARK_CELL = 0.6  # strength from which a cell's text is white  [1]
ARROWS = {"up": "↑", "down": "↓", "both": "↕"}


def sensitivity_figure(result: SensitivityResult) -> Figure:
    """Bar of the shares of the kinds of motion over a map of outputs and parameters, with 95 % intervals."""
    columns = len(result.parameters)
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        height = SENSITIVITY_CELL[1] * len(result.outputs)
        size = 4.6 + SENSITIVITY_CELL[0] * max(columns, 3), height + 2.4
        figure = Figure(figsize=size, layout="constrained")
        top, bottom = figure.subplots(2, 1, height_ratios=(0.45, height + 0.4))
        _draw_shares(top, result)
        _draw_map(bottom, result)
        what = "Morris screening" if result.method == MORRIS else "Sobol indices"
        figure.suptitle(f"{result.name}: {what}, {result.points} points", x=0.01, ha="left", fontsize=9.5)
    return figure


def _draw_shares(axes: Axes, result: SensitivityResult) -> None:
    left = 0.0
    for label, colour, share in _drawn(result):
        look: Look = {"color": colour, "edgecolor": "white", "linewidth": 0.6, "label": label}
        axes.barh(0.0, share, left=left, height=1.0, **look)
        if share >= MIN_LABELLED_SHARE:
            axes.text(left + 0.5 * share, 0.0, percent(share), ha="center", va="center", color="white", fontsize=8)
        left += share
    axes.set(xlim=(0.0, 1.0), ylim=(-0.5, 0.5), yticks=[], xticks=[], title="Motion over the box of parameters")
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.05), ncols=3, borderpad=0.0, handlelength=1.0)


def _drawn(result: SensitivityResult) -> list[tuple[str, str, float]]:
    """Label, colour and share of each part of the bar; rare kinds are taken together, failures go last."""
    kinds = [one for one in result.shares if not one.failed]
    parts = [(share_name(one, result), colour, one.share.value) for one, colour in zip(kinds, COLOURS, strict=False)]
    rare = sum(one.share.value for one in kinds[len(COLOURS) :])
    if rare:
        parts.append((f"{len(kinds) - len(COLOURS)} other kinds", OTHER, rare))
    return parts + [(share_name(one, result), FAILED_COLOUR, one.share.value) for one in result.shares if one.failed]


def _draw_map(axes: Axes, result: SensitivityResult) -> None:
    rows, columns = len(result.outputs), len(result.parameters)
    colours = mpl.colormaps["Blues"]
    for row, output in enumerate(result.outputs):
        if not output.influences:
            axes.text(0.5 * columns - 0.5, row, output.reason, ha="center", va="center", fontsize=6.5, color=OTHER)
            continue
        for column, influence in enumerate(output.influences):
            text, strength = _cell(influence, output)
            face = "#f4f4f4" if strength is None else colours(min(1.0, max(0.0, strength)))
            axes.fill_between([column - 0.5, column + 0.5], row - 0.5, row + 0.5, color=face, linewidth=0.0)
            dark = strength is not None and strength > DARK_CELL
            axes.text(column, row, text, ha="center", va="center", fontsize=6.3, color="white" if dark else LINE)
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
    axes.set_xticks(range(columns), result.parameters)
    axes.set_yticks(range(rows), [_row_label(output, result) for output in result.outputs], fontsize=7)
    axes.tick_params(length=0, bottom=False, top=False, labelbottom=False, labeltop=True)
    axes.spines[:].set_visible(False)
    axes.set_xticks([column - 0.5 for column in range(1, columns)], minor=True)
    axes.set_yticks([row - 0.5 for row in range(1, rows)], minor=True)
    axes.grid(which="minor", color="white", linewidth=1.5)
    axes.tick_params(which="minor", length=0)
    axes.set_xlabel(_meaning(result), loc="left", fontsize=7)


def _cell(influence: Influence, output: OutputSensitivity) -> tuple[str, float | None]:
    """Text of a cell, and its strength in [0, 1]: over that of the strongest parameter, or share of the variance."""
    one = influence.strength
    if one is None:
        return "not available", None
    if influence.mu_star is None:
        if influence.first is None or influence.total is None:
            return f"no total index\nalone {interval_in_percent(one)}", one.value
        return f"{interval_in_percent(one)}\nalone {percent(influence.first.value)}", one.value
    strongest = output.ranked()[0].strength
    scale = strongest.value if strongest is not None and strongest.value > 0.0 else 1.0
    interval = f"[{one.low / scale:.2f}, {one.high / scale:.2f}]"
    return f"{_arrow(influence)} {one.value / scale:.2f}\n{interval}", one.value / scale


def _arrow(influence: Influence) -> str:
    if influence.mu is None or influence.mu_star is None:
        return ""
    mean = influence.mu.value
    if abs(mean) < MIN_MONOTONIC_SHARE * influence.mu_star.value or not mean:
        return ARROWS["both"]
    return ARROWS["up" if mean > 0.0 else "down"]


def _row_label(output: OutputSensitivity, result: SensitivityResult) -> str:
    text = title(output, len(result.measured_kind))
    ranked = output.ranked()
    if result.method == MORRIS and ranked and ranked[0].mu_star is not None:
        return f"{text}\n1.00 = {shown(ranked[0].mu_star.value, output.unit, 3)}, {output.points} points"
    return f"{text}\n{output.points} points{f', {output.estimator}' if output.estimator else ''}"


def _meaning(result: SensitivityResult) -> str:
    if result.method == MORRIS:
        return (
            "mu* over the largest of the row, with its 95 % interval; \u2191 rises, \u2193 falls with the parameter, "
            "\u2195 neither throughout"
        )
    return "total index (alone: first-order index), share of the variance with its 95 % interval"
