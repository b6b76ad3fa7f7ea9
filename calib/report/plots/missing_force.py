"""The missing force of a calibrated model, per unit mass, over the states of a body.

Motions are Datasets as in `calib.report.plots.diagnosed_cycles`.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import matplotlib as mpl
import numpy as np
import scipy
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from calib.report.plots.diagnosed_cycles import compared_cycle, state_rows
from calib.report.plots.diagnosed_residuals import MAX_RESIDUAL_DOTS
from calib.report.plots.style import KINDS, LINE, STYLE, TEXT_WIDTH, Look, thin
from calib.units import shown_unit

STATE_BINS = 10  # of displacement and velocity
SIGNIFICANT_FORCE_Z = 4.0  # from which the mean over a bin is significant  [standard errors]
SIGNS = LinearSegmentedColormap.from_list("signs", ["#0072B2", "#b9d4e6", "#efefef", "#f2c9a8", "#D55E00"])


class MissingAcceleration(NamedTuple):
    """Measured minus simulated acceleration of a body at each sample of a cycle.

    Attributes
    ----------
    x, v : (n,) measured displacement [m] and velocity [m/s]
    value : (n,)  [m/s^2]
    error : standard error of each value  [m/s^2]
    width : number of neighbouring values that share their noise
    """

    x: np.ndarray
    v: np.ndarray
    value: np.ndarray
    error: float
    width: int


def missing_acceleration(motion: xr.Dataset, rows: tuple[int, int]) -> MissingAcceleration | None:
    """Derivative of the residual velocity by parabolas through neighbouring samples (Savitzky and Golay 1964).

    Samples are those of the mean cycle, or of the record where there is no period. None where the velocity is not
    compared or has too few samples. Samples whose parabola would cross an impact are left out.

    rows : of displacement and velocity
    """
    x, v = (compared_cycle(motion, row) for row in rows)
    step = float(np.median(np.diff(motion.time.values)))
    rate = np.sqrt(np.mean(np.gradient(v.calibrated, step) ** 2))
    radian = np.sqrt(np.mean((v.calibrated - v.calibrated.mean()) ** 2)) / max(rate, 1e-300) / step  # samples
    width = 2 * max(2, round(0.4 * radian)) + 1
    if v.abscissa.size < 4 * width:
        return None
    taps = scipy.signal.savgol_coeffs(width, 2, deriv=1, delta=step, use="dot")
    residual, fine = v.measured - v.calibrated, v.weight > 0.8
    half = width // 2
    mode: Literal["wrap", "edge"] = "wrap" if "period" in motion.attrs else "edge"
    spread = np.lib.stride_tricks.sliding_window_view(np.pad(residual, half, mode=mode), width)
    inside = np.asarray(np.lib.stride_tricks.sliding_window_view(np.pad(fine, half, mode=mode), width).all(axis=1))
    if mode == "edge":
        inside[:half] = inside[-half:] = False
    if not inside.any():
        return None
    error = float(np.linalg.norm(np.convolve(v.response, taps)))
    return MissingAcceleration(x.measured[inside], v.measured[inside], (spread @ taps)[inside], error, width)


def missing_accelerations(motions: Mapping[str, xr.Dataset], body: str) -> dict[str, MissingAcceleration]:
    """Missing acceleration of a body by record, of those records from which it can be computed."""
    rows = {name: state_rows(motion) for name, motion in motions.items()}
    forces = {name: missing_acceleration(motions[name], own[body]) for name, own in rows.items() if body in own}
    return {name: force for name, force in forces.items() if force is not None}


def is_significant(force: MissingAcceleration) -> bool:
    """Whether the mean over a bin of displacement or velocity differs significantly from zero."""
    parts = [binned(values, force) for values in (force.x, force.v)]
    return any((np.abs(mean) > SIGNIFICANT_FORCE_Z * error).any() for _, mean, error in parts)


def missing_force_figure(known: Mapping[str, MissingAcceleration]) -> Figure | None:
    """Missing acceleration of a body over the plane of its states, and its means over displacement and velocity."""
    if not known:
        return None
    factor, unit = shown_unit("m", max(np.abs(force.x).max() for force in known.values()))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 2.75), layout="constrained")
        plane, over_x, over_v = figure.subplots(1, 3, gridspec_kw={"width_ratios": (1.25, 1.0, 1.0)})
        top = max(np.quantile(np.abs(force.value), 0.97) for force in known.values()) or 1.0
        look: Look = {"norm": Normalize(-top, top), "cmap": SIGNS}
        for (name, force), colour in zip(known.items(), (KINDS * 9)[: len(known)], strict=True):
            keep = thin(force.x.size, MAX_RESIDUAL_DOTS)
            plane.scatter(
                factor * force.x[keep], force.v[keep], c=force.value[keep], s=6.0,
                linewidths=0, rasterized=True, zorder=3, **look,
            )  # fmt: skip
            for axes, values, scale in ((over_x, force.x, factor), (over_v, force.v, 1.0)):
                centre, mean, error = binned(values, force)
                axes.fill_between(
                    scale * centre, mean - 2 * error, mean + 2 * error, color=colour, alpha=0.18, linewidth=0
                )
                axes.plot(scale * centre, mean, "o-", color=colour, markersize=3.0, linewidth=1.1, label=name, zorder=3)
        bar = figure.colorbar(ScalarMappable(**look), ax=plane, location="top", shrink=0.9, aspect=24, pad=0.02)
        bar.set_label("Missing acceleration [m/s²]")
        bar.outline.set_visible(False)
        plane.set(xlabel=f"Displacement [{unit}]", ylabel="Velocity [m/s]")
        over_x.set(xlabel=f"Displacement [{unit}]", ylabel="Mean in bins [m/s²]")
        over_v.set(xlabel="Velocity [m/s]")
        for axes in (over_x, over_v):
            axes.axhline(0.0, color=LINE, linewidth=0.7)
        figure.legend(*over_x.get_legend_handles_labels(), loc="outside upper right", ncols=min(4, len(known)))
    return figure


def binned(values: np.ndarray, force: MissingAcceleration) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, mean of a missing acceleration and its standard error in bins of equal width of `values` (n,)."""
    edges = np.linspace(values.min(), values.max(), STATE_BINS + 1)
    which = np.clip(np.digitize(values, edges) - 1, 0, STATE_BINS - 1)
    number = np.bincount(which, minlength=STATE_BINS)
    some = number > 0
    mean = np.bincount(which, force.value, STATE_BINS)[some] / number[some]
    error = force.error * np.sqrt(np.minimum(1.0, force.width / number[some]))
    return (0.5 * (edges[1:] + edges[:-1]))[some], mean, error
