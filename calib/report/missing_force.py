"""What a calibrated model lacks, as an acceleration over the states of a body.

Motions are Datasets as in `calib.report.residual_plots`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.signal import savgol_coeffs

from calib.report import residual_plots
from calib.report.drawing import KINDS, LINE, STYLE, WIDTH, shown_unit, thin

BINS = 10  # of displacement and velocity
CLEAR = 4.0  # standard errors from which a mean over a bin is no noise
SIDES = mpl.colors.LinearSegmentedColormap.from_list("sides", ["#0072B2", "#b9d4e6", "#efefef", "#f2c9a8", "#D55E00"])


class Force(NamedTuple):
    """Acceleration that the simulation lacks at each place of a cycle: measured less simulated (n,) [m/s^2].

    x, v are those measured (n,) [m], [m/s]; `error` is the standard error of each, `width` the number of neighbours
    that share their noise.
    """

    x: np.ndarray
    v: np.ndarray
    value: np.ndarray
    error: float
    width: int


def missing_acceleration(motion: xr.Dataset, two: tuple[int, int]) -> Force | None:
    """Derivative of the residual velocity, by parabolas through neighbouring samples of the mean cycle or the record.

    As Savitzky and Golay (1964) have it. None where the velocity is not compared, or too short for it. Samples whose
    parabola would cross an impact are left out.
    """
    x, v = (residual_plots.loop(motion, row) for row in two)
    step = float(np.median(np.diff(motion.time.values)))
    rate = np.sqrt(np.mean(np.gradient(v.calibrated, step) ** 2))
    radian = np.sqrt(np.mean((v.calibrated - v.calibrated.mean()) ** 2)) / max(rate, 1e-300) / step  # samples
    width = 2 * max(2, round(0.4 * radian)) + 1
    if v.at.size < 4 * width:
        return None
    taps = savgol_coeffs(width, 2, deriv=1, delta=step, use="dot")
    residual, fine = v.measured - v.calibrated, v.weight > 0.8
    half = width // 2
    mode = "wrap" if "period" in motion.attrs else "edge"
    spread = np.lib.stride_tricks.sliding_window_view(np.pad(residual, half, mode=mode), width)
    kept = np.lib.stride_tricks.sliding_window_view(np.pad(fine, half, mode=mode), width).all(axis=1)
    if mode == "edge":
        kept[:half] = kept[-half:] = False
    if not kept.any():
        return None
    error = float(np.linalg.norm(np.convolve(v.response, taps)))
    return Force(x.measured[kept], v.measured[kept], (spread @ taps)[kept], error, width)


def accelerations(motions: Mapping[str, xr.Dataset], body: str) -> dict[str, Force]:
    """Accelerations that the simulation of a body lacks, by record, where they are known."""
    own = {
        name: residual_plots.pairs(motion)[body]
        for name, motion in motions.items()
        if body in residual_plots.pairs(motion)
    }
    found = {name: missing_acceleration(motions[name], two) for name, two in own.items()}
    return {name: force for name, force in found.items() if force is not None}


def stands_clear(force: Force) -> bool:
    """Whether a mean over a bin of displacement or velocity stands clear of noise."""
    parts = [binned(values, force) for values in (force.x, force.v)]
    return any((np.abs(mean) > CLEAR * error).any() for _, mean, error in parts)


def forces(known: Mapping[str, Force]) -> Figure | None:
    """Acceleration that the simulation of a body lacks: over the plane of its states, and over each of them."""
    if not known:
        return None
    factor, unit = shown_unit("m", max(np.abs(force.x).max() for force in known.values()))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 2.75), layout="constrained")
        plane, over_x, over_v = figure.subplots(1, 3, gridspec_kw={"width_ratios": (1.25, 1.0, 1.0)})
        top = max(np.quantile(np.abs(force.value), 0.97) for force in known.values()) or 1.0
        for (name, force), colour in zip(known.items(), (KINDS * 9)[: len(known)], strict=True):
            keep = thin(force.x.size, residual_plots.CLOUD)
            shown = plane.scatter(
                factor * force.x[keep], force.v[keep], c=force.value[keep], s=6.0, cmap=SIDES, vmin=-top, vmax=top,
                linewidths=0, rasterized=True, zorder=3,
            )  # fmt: skip
            for axes, values, scale in ((over_x, force.x, factor), (over_v, force.v, 1.0)):
                at, mean, error = binned(values, force)
                axes.fill_between(scale * at, mean - 2 * error, mean + 2 * error, color=colour, alpha=0.18, linewidth=0)
                axes.plot(scale * at, mean, "o-", color=colour, markersize=3.0, linewidth=1.1, label=name, zorder=3)
        bar = figure.colorbar(shown, ax=plane, location="top", shrink=0.9, aspect=24, pad=0.02)
        bar.set_label("Lacking acceleration [m/s²]")
        bar.outline.set_visible(False)
        plane.set(xlabel=f"Displacement [{unit}]", ylabel="Velocity [m/s]")
        over_x.set(xlabel=f"Displacement [{unit}]", ylabel="Mean [m/s²]")
        over_v.set(xlabel="Velocity [m/s]")
        for axes in (over_x, over_v):
            axes.axhline(0.0, color=LINE, linewidth=0.7)
        figure.legend(*over_x.get_legend_handles_labels(), loc="outside upper right", ncols=min(4, len(known)))
    return figure


def binned(values: np.ndarray, force: Force) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, mean of a lacking acceleration and its standard error in bins of equal width of `values` (n,)."""
    edges = np.linspace(values.min(), values.max(), BINS + 1)
    which = np.clip(np.digitize(values, edges) - 1, 0, BINS - 1)
    number = np.bincount(which, minlength=BINS)
    some = number > 0
    mean = np.bincount(which, force.value, BINS)[some] / number[some]
    error = force.error * np.sqrt(np.minimum(1.0, force.width / number[some]))
    return (0.5 * (edges[1:] + edges[:-1]))[some], mean, error
