"""Figure of the profiles of the likelihood over the parameters of a study, and over pairs of them."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator, RectBivariateSpline

from calib.confidence.document import ConfidenceResult, PairResult, ProfileResult
from calib.report.formatting import raised
from calib.report.plots.style import (
    BASE_LOOK,
    DPI,
    FAILED,
    KINDS,
    LINE,
    MARK,
    SIMULATED,
    STYLE,
    TEXT_WIDTH,
    logarithmic,
)
from calib.units import shown_unit

COLUMNS, PANEL_HEIGHT = 3, 2.1  # of the panels, and of one  [inch]
TOP = 1.9  # of a panel, in quantiles  [1]
CURVE_SAMPLES, MAP_SAMPLES = 200, 100  # of a drawn curve, and of each side of a map  [count]
PANEL_MARGIN = 0.12  # of the width of the interval, on both sides of a panel  [1]
JOINT_LEVELS = (0.25, 1.0)  # contours of a pair, in quantiles  [1]: about 1 and 2 standard errors


def profiles_figure(result: ConfidenceResult) -> Figure:
    """Likelihood-ratio statistic over each parameter with quantile and local parabola; over the pairs as contours."""
    panels: Sequence[ProfileResult | PairResult] = [*result.profiles, *result.pairs]
    columns = min(COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    with mpl.rc_context(STYLE):
        figure = Figure(
            figsize=(TEXT_WIDTH * columns / COLUMNS if columns > 1 else 0.55 * TEXT_WIDTH, 0.35 + rows * PANEL_HEIGHT),
            layout="constrained", dpi=DPI,
        )  # fmt: skip
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, panel in zip(grid, panels, strict=False):
            _profile(axes, panel) if isinstance(panel, ProfileResult) else _pair(axes, panel)
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        for k, axes in enumerate(grid[: len(result.profiles)]):
            axes.set_ylabel("Likelihood-ratio statistic" if k % columns == 0 else "")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), columnspacing=1.2)
    return figure


def _profile(axes: Axes, profile: ProfileResult) -> None:
    points = [p for p in profile.points if p.ratio is not None]
    ends = [profile.low.value, profile.high.value]
    factor, unit = shown_unit(profile.unit, max(abs(profile.value), *map(abs, ends)))
    x = _scaled(profile, [profile.value, *(p.value for p in points)])
    order = np.argsort(x)
    at, root = x[order], np.sqrt(np.array([0.0, *(max(p.ratio or 0.0, 0.0) for p in points)])[order])
    centre = float(_scaled(profile, [profile.value])[0])
    signed = np.where(at < centre, -root, root)
    dense = np.linspace(at[0], at[-1], CURVE_SAMPLES)
    curve = PchipInterpolator(at, signed)(dense) ** 2 if at.size > 1 else np.zeros(CURVE_SAMPLES)
    axes.axvspan(factor * ends[0], factor * ends[1], color=SIMULATED, alpha=0.1, linewidth=0)
    axes.axhline(profile.quantile, color=MARK, linewidth=0.9, label="quantile of the interval")
    if profile.half_width is not None:
        low, high = _scaled(profile, ends)
        wide = np.linspace(low - PANEL_MARGIN * (high - low), high + PANEL_MARGIN * (high - low), CURVE_SAMPLES)
        parabola = profile.quantile * ((wide - centre) / profile.half_width) ** 2
        axes.plot(factor * _value(profile, wide), parabola, label="local parabola", **BASE_LOOK)
    axes.plot(factor * _value(profile, dense), curve, color=SIMULATED, linewidth=1.3, label="profile")
    for k, kind in enumerate(dict.fromkeys(p.kind for p in points)):
        own = [p for p in points if p.kind == kind]
        axes.plot(
            [factor * p.value for p in own], [p.ratio or 0.0 for p in own], ".", color=KINDS[k % len(KINDS)],
            markersize=5, label=f"{kind}" if k else None,
        )  # fmt: skip
    failed = [factor * p.value for p in profile.points if p.ratio is None]
    axes.plot(failed, np.full(len(failed), 0.97 * TOP * profile.quantile), "x", color=FAILED, markersize=4)
    axes.axvline(factor * profile.value, color=LINE, linewidth=0.7, linestyle=(0, (2, 2)))
    axes.set(ylim=(0.0, TOP * profile.quantile), xlabel=f"{profile.name} [{raised(unit)}]")
    low, high = _scaled(profile, ends)
    room = PANEL_MARGIN * (high - low)
    left, right = factor * _value(profile, np.array([low - room, high + room]))
    _axis(axes, "x", profile.scale, left, right)


def _pair(axes: Axes, pair: PairResult) -> None:
    ratio = np.array([[np.nan if r is None else r for r in row] for row in pair.ratio])
    scales = [
        shown_unit(unit, max(map(abs, values)))
        for unit, values in zip(pair.units, (pair.first, pair.second), strict=True)
    ]
    x, y = (factor * np.array(v) for (factor, _), v in zip(scales, (pair.first, pair.second), strict=True))
    middle = x[x.size // 2], y[y.size // 2]
    if np.isfinite(ratio).all() and np.all(np.diff(x) > 0.0) and np.all(np.diff(y) > 0.0):
        spline = RectBivariateSpline(x, y, ratio)
        x, y = (np.linspace(own[0], own[-1], MAP_SAMPLES) for own in (x, y))
        ratio = spline(x, y)
    levels = [-np.inf, *(pair.quantile * level for level in JOINT_LEVELS)]
    axes.contourf(x, y, ratio.T, levels=levels, colors=[SIMULATED, SIMULATED], alpha=0.25)
    axes.contour(x, y, ratio.T, levels=levels[1:], colors=[SIMULATED, MARK], linewidths=1.1)
    axes.plot(*middle, "+", color=LINE, markersize=7)
    names = [f"{name} [{raised(unit)}]" for name, (_, unit) in zip(pair.names, scales, strict=True)]
    axes.set(xlabel=names[0], ylabel=names[1])
    for which, values, scale in zip("xy", (x, y), pair.scales, strict=True):
        _axis(axes, which, scale, values[0], values[-1])


def _axis(axes: Axes, which: str, scale: str, low: float, high: float) -> None:
    if scale == "log" and high > 2.0 * low > 0.0:
        axes.set(**{f"{which}scale": "log"})
        logarithmic(getattr(axes, f"{which}axis"), low, high)
    axes.set(**{f"{which}lim": (low, high)})


def _scaled(profile: ProfileResult, values: Sequence[float]) -> np.ndarray:
    """Values on the scale of the window."""
    return np.log(values) if profile.scale == "log" else np.array(values)


def _value(profile: ProfileResult, scaled: np.ndarray) -> np.ndarray:
    return np.exp(scaled) if profile.scale == "log" else scaled
