"""Figures of diagnosed phase curves: the local misfit, and the extended model; motions as in `diagnosed_cycles`."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from calib.report.plots.diagnosed_cycles import ComparedCycle, compared_cycle, state_rows
from calib.report.plots.diagnosed_residuals import dot_entry, line_entry
from calib.report.plots.style import EXTENDED, MEASURED, SIMULATED, STYLE, TEXT_WIDTH, Look
from calib.units import shown_unit

MAX_COLOUR_SIGMAS = 8.0  # standard deviations at which the colour of a loop is darkest, at most
SHADES = LinearSegmentedColormap.from_list("misfit", ["#d9d9d9", "#F0C44B", "#D55E00", "#7a1f00"])
AVERAGING_INTERVALS = 30  # intervals of a cycle over each of which a residual is averaged


class Panel(NamedTuple):
    """A panel of a figure: a body of a record, with the rows of its displacement and velocity."""

    record: str
    body: str
    motion: xr.Dataset
    rows: tuple[int, int]


def misfit_loops(motions: Mapping[str, xr.Dataset]) -> Figure | None:
    """Measured phase curves coloured by the local misfit: a panel for each body of each record."""
    panels = _panels(motions)
    if not panels:
        return None
    with mpl.rc_context(STYLE):
        figure, grid, used = _grid(panels)
        levels = [_level(panel) for panel in panels]
        top = float(np.clip(max(np.quantile(level, 0.99) for level in levels), 4.0, MAX_COLOUR_SIGMAS))
        look: Look = {"norm": Normalize(0.0, top), "cmap": SHADES}
        for panel, level, axes in zip(panels, levels, used, strict=True):
            x, v = _cycles(panel)
            factor, unit = _displacement_unit(panel, x)
            order = np.argsort(level)
            axes.scatter(
                factor * x.measured[order], v.measured[order], c=level[order], s=8.0,
                linewidths=0, rasterized=True, zorder=3, **look,
            )  # fmt: skip
            _label(axes, panel, unit)
        bar = figure.colorbar(ScalarMappable(**look), ax=grid, shrink=0.75, aspect=28, pad=0.02)
        bar.set_label("Local misfit [standard deviations]")
        bar.outline.set_visible(False)
    return figure


def _level(panel: Panel) -> np.ndarray:
    """Local misfit (n,): residuals of displacement and velocity, each averaged over a thirtieth of the cycle.

    Root mean square over both, in standard deviations of such an average.
    """
    square = number = np.zeros(1)
    for own in _cycles(panel):
        width = _window(own)
        weighted = own.weight * (own.measured - own.calibrated)
        total, counted = (_running(x, width, "period" in panel.motion.attrs) for x in (weighted, own.weight**2))
        here = counted > 0.3 * width
        error = np.linalg.norm(np.convolve(own.response, np.ones(width))) / math.sqrt(width)  # of a sum, over its root
        square = square + np.where(here, total**2 / np.maximum(counted, 1e-9), 0.0) / error**2
        number = number + here
    return np.sqrt(square / np.maximum(number, 1))


def _window(cycle: ComparedCycle) -> int:
    """Number of samples, odd, over which a residual is averaged."""
    return 2 * (cycle.abscissa.size // (2 * AVERAGING_INTERVALS)) + 1


def _running(values: np.ndarray, width: int, closed: bool) -> np.ndarray:
    """Sums (n,) over `width` neighbours, of a closed curve or of a record that begins and ends."""
    pad = width // 2
    padded = np.pad(values, pad, mode="wrap") if closed else np.pad(values, pad, mode="constant")
    return np.convolve(padded, np.ones(width), mode="valid")


def magnified_loops(motions: Mapping[str, xr.Dataset], label: str) -> Figure | None:
    """Phase curves of the extended model, and the distances of the calibrated and the measured ones, magnified."""
    panels = [p for p in _panels(motions) if "extended" in p.motion and "period" in p.motion.attrs]
    if not panels:
        return None
    with mpl.rc_context(STYLE):
        figure, _, used = _grid(panels)
        for panel, axes in zip(panels, used, strict=True):
            x, v = cycles = _cycles(panel)
            parts = [(_extended(one), _smoothed_distance(one)) for one in cycles]
            times = _magnification(cycles)
            factor, unit = _displacement_unit(panel, x)
            counts = np.minimum(x.weight, v.weight) > 0.5
            measured = [extended + times * distance for extended, distance in parts]
            before = [e + times * (one.calibrated - e) for one, (e, _) in zip(cycles, parts, strict=True)]
            axes.plot(
                factor * measured[0][counts],
                measured[1][counts],
                ".",
                color=MEASURED,
                markersize=3.0,
                markeredgewidth=0,
            )
            for points, colour in ((before, SIMULATED), ([extended for extended, _ in parts], EXTENDED)):
                across, up = (np.where(counts, p, np.nan)[np.append(np.arange(counts.size), 0)] for p in points)
                axes.plot(factor * across, up, color=colour, linewidth=1.1, zorder=3)
            _label(axes, panel, unit)
            axes.set_title(f"{panel.record}, {panel.body}: distances × {times:g}")
        handles = [dot_entry(MEASURED, "measured"), line_entry(SIMULATED, "calibrated"), line_entry(EXTENDED, label)]
        figure.legend(handles=handles, loc="outside upper right", ncols=3, columnspacing=1.4, handletextpad=0.5)
    return figure


def _extended(cycle: ComparedCycle) -> np.ndarray:
    """Mean cycle (n,) of the extended model."""
    if cycle.extended is None:
        raise ValueError("a magnified phase curve needs the mean cycle of the extended model")
    return cycle.extended


def _smoothed_distance(cycle: ComparedCycle) -> np.ndarray:
    """Measured minus extended mean cycle, averaged over a thirtieth of the cycle (n,)."""
    width, residual = _window(cycle), cycle.measured - _extended(cycle)
    total, counted = (_running(x, width, True) for x in (cycle.weight * residual, cycle.weight))
    return total / np.maximum(counted, 1e-9)


def _magnification(cycles: Sequence[ComparedCycle]) -> int:
    """Round factor at which the magnified distances stay below about a seventh of the size of the phase curve."""
    apart = [
        np.quantile(np.abs(distance), 0.95) / max(np.ptp(_extended(one)), 1e-300)
        for one in cycles
        for distance in (one.calibrated - _extended(one), _smoothed_distance(one))
    ]
    wanted = max(1.0, 0.15 / max([*apart, 1e-4]))
    return [n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if n <= wanted][-1]


def _panels(motions: Mapping[str, xr.Dataset]) -> list[Panel]:
    return [Panel(name, body, m, two) for name, m in motions.items() for body, two in state_rows(m).items()]


def _cycles(panel: Panel) -> tuple[ComparedCycle, ComparedCycle]:
    """Mean cycles of displacement and velocity."""
    x, v = panel.rows
    return compared_cycle(panel.motion, x), compared_cycle(panel.motion, v)


def _displacement_unit(panel: Panel, x: ComparedCycle) -> tuple[float, str]:
    """Factor and unit of the axis of displacements."""
    return shown_unit(str(panel.motion.unit.values[panel.rows[0]]), np.abs(x.measured).max())


def _grid(panels: Sequence[Panel]) -> tuple[Figure, np.ndarray, list[Axes]]:
    """Figure with two panels side by side, or four where there are more than four; all axes, and those used."""
    columns = min(len(panels), 4 if len(panels) > 4 else 2)
    count = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(TEXT_WIDTH, (2.0 if columns > 2 else 3.0) * count + 0.4), layout="constrained")
    grid = figure.subplots(count, columns, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    return figure, grid, list(grid.flat[: len(panels)])


def _label(axes: Axes, panel: Panel, unit: str) -> None:
    axes.set_title(f"{panel.record}, {panel.body}")
    axes.set_xlabel(f"Displacement [{unit}]")
    axes.set_ylabel("Velocity [m/s]")
    axes.margins(0.07)
