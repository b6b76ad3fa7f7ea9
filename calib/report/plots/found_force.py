"""Figure of a force that was found in the records, over the states that they visit."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from calib.diagnosis.discovery.document import DiscoveryResult, FormulaResult, FunctionResult
from calib.report.formatting import HALF_WIDTH_ERRORS_95, number, raised
from calib.report.plots.formula import formula_lines
from calib.report.plots.missing_force import SIGNS
from calib.report.plots.style import LINE, MARK, SIMULATED, STYLE, TEXT_WIDTH
from calib.units import shown_unit

BODY_LABELS = {"displacement": "Displacement", "velocity": "Velocity"}
INTERFACE_LABELS = {"displacement": "Clearance", "velocity": "Rate of the clearance"}
CURVE_HEIGHT, SURFACE_HEIGHT, FORMULA_HEIGHT = 2.5, 2.9, 0.22  # of the figure, of a line of the formula  [inch]
FORMULA_LEVELS = 7  # contours of a formula  [count]
EXTENSIONS = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
NUMBERS_OF_A_LINE = 3  # of a formula, above the figure  [count]


def found_force_figure(result: DiscoveryResult) -> Figure | None:
    """Force per unit mass over its arguments with its 95 % band; None where none was found.

    A function of one argument is a curve, one of two a map with the half width of its band beside it, on one scale.
    Where there is a formula, the force is that and what the records add to it; the formula alone is drawn over it.
    """
    if not result.functions:
        return None
    labels = INTERFACE_LABELS if result.interface else BODY_LABELS
    surface = len(result.functions[0].arguments) == 2
    panels = 2 if surface else len(result.functions)
    title = "" if result.formula is None else _title(result.formula)
    with mpl.rc_context(STYLE):
        extra = FORMULA_HEIGHT * (title.count("\n") + 1) if title else 0.0
        width = TEXT_WIDTH if panels > 1 else 0.6 * TEXT_WIDTH
        figure = Figure(figsize=(width, extra + (SURFACE_HEIGHT if surface else CURVE_HEIGHT)), layout="constrained")
        axes = figure.subplots(1, panels, squeeze=False)[0]
        if surface:
            _maps(figure, axes, result.functions[0], labels)
        else:
            for own, function in zip(axes, result.functions, strict=True):
                _curve(own, function, labels)
            where = "at the" if result.interface else "on"
            axes[0].set_ylabel(f"Force {where} {result.body}\nper unit mass [m/s²]")
        if title:
            figure.suptitle(title, fontsize=8, parse_math=True)
    return figure


def _title(formula: FormulaResult) -> str:
    """Formula with its numbers below."""
    written = formula_lines(formula.latex)
    numbers = [
        f"${n.name[0]}_{{{n.name[1:]}}}$ = {number(n.value)} {raised(n.unit)}".removesuffix(" 1")
        for n in formula.numbers
    ]
    per_line = NUMBERS_OF_A_LINE
    written += [", ".join(numbers[k : k + per_line]) for k in range(0, len(numbers), per_line)]
    return "\n".join(written)


def _curve(axes: Axes, function: FunctionResult, labels: Mapping[str, str]) -> None:
    """Draw a function of one argument with its band."""
    force, error = np.array(function.force), np.array(function.error)
    factor, unit = shown_unit(function.units[0], float(np.abs(function.points[0]).max()))
    at = factor * np.array(function.points[0])
    axes.axhline(0.0, color=LINE, linewidth=0.7)
    half = HALF_WIDTH_ERRORS_95 * error
    axes.fill_between(at, force - half, force + half, color=SIMULATED, alpha=0.2, linewidth=0, label="95 % band")
    label = "formula and function" if function.formula else "free function"
    axes.plot(at, force, color=SIMULATED, linewidth=1.3, label=label)
    if function.formula:
        axes.plot(at, function.formula, color=MARK, linewidth=1.0, linestyle="--", label="formula alone")
    axes.set(xlabel=f"{labels[function.arguments[0]]} [{unit}]")
    axes.margins(x=0.0)
    axes.legend(loc="best")


def _maps(figure: Figure, axes: np.ndarray, function: FunctionResult, labels: Mapping[str, str]) -> None:
    """Draw a function of two arguments, and the half width of its band, where states are visited."""
    shape = tuple(len(points) for points in function.points)
    visited = np.array(function.visited).reshape(shape)
    scales = [
        shown_unit(unit, float(np.abs(points).max()))
        for unit, points in zip(function.units, map(np.array, function.points), strict=True)
    ]
    x, v = (factor * np.array(p) for (factor, _), p in zip(scales, function.points, strict=True))
    force = np.where(visited, np.array(function.force).reshape(shape), np.nan)
    half = np.where(visited, HALF_WIDTH_ERRORS_95 * np.array(function.error).reshape(shape), np.nan)
    top = _largest_known(force, half)
    drawn = (
        (axes[0], force, "Force per unit mass [m/s²]", Normalize(-top, top), SIGNS),
        (axes[1], half, "Half width of the 95 % band [m/s²]", Normalize(0.0, top), "Greys"),
    )
    if function.formula:
        formula = np.where(visited, np.array(function.formula).reshape(shape), np.nan)
        axes[0].contour(x, v, formula.T, levels=FORMULA_LEVELS, colors=LINE, linewidths=0.6)
    for own, value, label, norm, colours in drawn:
        mesh = own.pcolormesh(x, v, value.T, norm=norm, cmap=colours, shading="nearest", rasterized=True)
        beyond = (bool(np.nanmin(value) < norm.vmin), bool(np.nanmax(value) > norm.vmax))
        bar = figure.colorbar(mesh, ax=own, location="top", shrink=0.9, aspect=24, pad=0.02, extend=EXTENSIONS[beyond])
        bar.set_label(label)
        across, up = (f"{labels[a]} [{unit}]" for a, (_, unit) in zip(function.arguments, scales, strict=True))
        own.set(xlabel=across, ylabel=up)


def _largest_known(force: np.ndarray, half: np.ndarray) -> float:
    """Largest absolute force [m/s^2] where its band excludes zero: at the edge of the visited states it may be wide.

    That of all states where it does so nowhere. NaN: not visited.
    """
    size = np.abs(force)
    known = size[size > half]
    return float(np.nanmax(known if known.size else size)) or 1.0
