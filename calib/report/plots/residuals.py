"""Figures of the residual of a calibration: measured minus simulated."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import scipy
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.records import prescribed, stated_period
from calib.report.formatting import number
from calib.report.plots.records import channel_axis, compared_channels, has_channels, impact_times
from calib.report.plots.style import (
    LINE,
    MEASURED,
    OTHER,
    SIMULATED,
    STYLE,
    TEXT_WIDTH,
    Look,
    label_powers,
    line,
    logarithmic,
    mark_impacts,
    spot,
    thin,
)
from calib.units import shown_unit

MAX_CLOUD_DOTS = 6000  # samples drawn as a (rasterised) cloud of dots
MIN_TOLERANCE = 1e-4  # 1 - R^2 of a function regressed on 1, x and v, below which it counts as linear in them  [1]; the
# tolerance of a regressor, with its default in SPSS (REGRESSION, CRITERIA TOLERANCE)
PROFILE_BINS = 25  # of displacement or velocity
PREVIOUS_SAMPLE = "previous sample"  # what the lag-1 autocorrelation correlates the residual with


class Regressor(NamedTuple):
    """A motion that a residual is drawn against: values (n,) at the measured instants, their origin and SI unit."""

    values: np.ndarray
    origin: str
    unit: str


def residual_over_phase(measured: xr.Dataset, simulated: xr.Dataset) -> Figure | None:
    """Measured minus simulated over the phase of the excitation: mean of the cycles and two standard errors of it.

    None where the record has no period or no channel is compared.
    """
    period = stated_period(measured)
    pairs = compared_channels(measured, simulated)
    if not period or not pairs:
        return None
    with mpl.rc_context(STYLE):
        columns = min(2, len(pairs))
        rows = math.ceil(len(pairs) / columns)
        figure = Figure(figsize=(TEXT_WIDTH, 1.9 * rows + 0.2), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
        for (body, channel), axes in zip(pairs, grid.flat, strict=False):
            label, scale, unit = channel_axis(measured, body, channel)
            phase, mean, error = over_phase(measured, simulated, body, channel, period)
            mean, error = scale * mean, scale * error
            axes.fill_between(phase, mean - 2 * error, mean + 2 * error, color=SIMULATED, alpha=0.22, linewidth=0)
            axes.plot(phase, mean, color=SIMULATED, linewidth=1.1)
            axes.axhline(0.0, color=LINE, linewidth=0.7)
            mark_impacts(
                axes, np.unique(np.round((impact_times(simulated) - float(measured.time[0])) / period % 1.0, 3))
            )
            axes.set_title(f"{body}: {label.lower()}")
            axes.set_ylabel(f"Residual [{unit}]")
            axes.set_xlim(0.0, 1.0)
        for axes in grid.flat[len(pairs) :]:
            axes.set_visible(False)
        for axes in grid[-1]:
            axes.set_xlabel("Phase of the record [periods]")
    return figure


def over_phase(
    measured: xr.Dataset, simulated: xr.Dataset, body: str, channel: str, period: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Phase (k,) [1], mean (k,) and its standard error (k,) of the residual over the cycles, in up to 100 bins."""
    residual = measured[channel].sel(body=body).values - simulated[channel].sel(body=body).values
    place = (measured.time.values - float(measured.time[0])) / period
    bins = int(np.clip(residual.size / max(4.0, place[-1]), 8, 100))
    which = np.minimum((place % 1.0 * bins).astype(int), bins - 1)
    number = np.maximum(np.bincount(which, minlength=bins), 1)
    mean = np.bincount(which, residual, bins) / number
    spread = np.sqrt(np.maximum(np.bincount(which, residual**2, bins) / number - mean**2, 0.0))
    return (np.arange(bins) + 0.5) / bins, mean, spread / np.sqrt(np.maximum(number - 1, 1))


def residual_structure(
    measured: xr.Dataset, simulated: xr.Dataset, body: str, channel: str, motions: xr.Dataset | None = None
) -> Figure:
    """Dependence of a residual, for a record without a period, on time, motion, simple laws and frequency.

    Residual = measured - simulated, both (body, time) on one time base. It is drawn against the simulated motion: that
    of `simulated` or, where a channel is missing there, of `motions`, the simulation with the channels that were not
    measured. The measured motion contains the residual and would be correlated with it whatever the model.
    """
    label, scale, unit = channel_axis(measured, body, channel)
    values = scale * measured[channel].sel(body=body).values
    residual = values - scale * simulated[channel].sel(body=body).values
    time = measured.time.values - float(measured.time[0])
    motion = _motion(measured, (simulated, simulated if motions is None else motions), body)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 6.4), layout="constrained")
        upper, middle, lower = figure.subfigures(3, 1, squeeze=False, height_ratios=(1.0, 1.25, 1.0))[:, 0]
        axes = upper.subplots()
        line(axes, time, residual, width=0.6)
        axes.set(xlabel="Time [s]", ylabel=f"Residual [{unit}]")
        rms = math.sqrt(np.mean(residual**2))
        axes.set_title(f"{body}: {label.lower()}, measured minus simulated; rms {number(rms, 3)} {unit}")
        axes.margins(x=0.01)
        *clouds, bars = middle.subplots(1, len(motion) + 1, squeeze=False)[0]
        for (c, regressor), axes in zip(motion.items(), clouds, strict=True):
            _against(axes, regressor, residual, c, unit)
        _correlations(bars, residual, {c: regressor.values for c, regressor in motion.items()})
        _spectra(lower.subplots(), time, values, residual, unit)
    return figure


def correlations(residual: np.ndarray, motion: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Correlation of a residual (n,) with simple functions of displacement x and velocity v, each (n,), by name.

    x and v are correlated as they are. From the other functions and from the residual the part that is linear in x and
    v is removed first (partial correlation), because a linear model could still absorb it. A function of whose variance
    x and v explain 99.99 %, such as v^2 in a free fall, is left out.
    """
    x, v = motion.get("displacement"), motion.get("velocity")
    linear = np.column_stack([np.ones_like(residual), *(m for m in (x, v) if m is not None)])
    scale = np.linalg.norm(linear, axis=0)
    basis = np.linalg.qr(linear / np.where(scale > 0.0, scale, 1.0))[0]

    def without_linear_part(a: np.ndarray) -> np.ndarray:
        return a - basis @ (basis.T @ a)

    rest = without_linear_part(residual)

    def partial(functions: Mapping[str, np.ndarray]) -> dict[str, float]:
        parts = {name: (f - np.mean(f), without_linear_part(f)) for name, f in functions.items()}
        return {n: _correlation(rest, b) for n, (f, b) in parts.items() if b @ b > MIN_TOLERANCE * (f @ f)}

    by_function: dict[str, float] = {}
    if v is not None:
        by_function |= {"v": _correlation(residual, v)} | partial({**_shapes("v", v), "sign v": np.sign(v)})
    if x is not None:
        by_function |= {"x": _correlation(residual, x)} | partial(_shapes("x", x))
    return by_function


def _shapes(name: str, m: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}²": m**2, f"{name}|{name}|": m * np.abs(m), f"{name}³": m**3}


def _against(axes: Axes, regressor: Regressor, residual: np.ndarray, channel: str, unit: str) -> None:
    """Draw the residual over a motion as dots, with its mean in bins of equal width."""
    factor, x_unit = shown_unit(regressor.unit, np.max(np.abs(regressor.values)))
    x = factor * regressor.values
    keep = thin(x.size, MAX_CLOUD_DOTS)
    cloud: Look = {
        "color": MEASURED,
        "markersize": spot(keep.size),
        "markeredgewidth": 0,
        "alpha": 0.5,
        "rasterized": True,
    }
    axes.plot(x[keep], residual[keep], ".", **cloud)
    low, high = np.quantile(x, [0.002, 0.998])
    edges = np.linspace(low, high, PROFILE_BINS + 1)
    which = np.digitize(x, edges) - 1
    bins = np.array([i for i in range(PROFILE_BINS) if np.sum(which == i) > 4], dtype=int)  # none where nothing moves
    means = [np.mean(residual[which == i]) for i in bins]
    axes.plot(0.5 * (edges[bins] + edges[bins + 1]), means, "o-", color=SIMULATED, markersize=2.8, linewidth=1.2)
    axes.axhline(0.0, color=LINE, linewidth=0.7)
    axes.set_xlabel(f"{channel.capitalize()}, {regressor.origin} [{x_unit}]")
    axes.set_ylabel(f"Residual [{unit}]")
    axes.set_title(f"against {channel}")


def _correlations(axes: Axes, residual: np.ndarray, motion: Mapping[str, np.ndarray]) -> None:
    values = {**correlations(residual, motion), PREVIOUS_SAMPLE: _correlation(residual[1:], residual[:-1])}
    names = list(values)[::-1]
    colours = [OTHER if n in (PREVIOUS_SAMPLE, "x", "v") else SIMULATED for n in names]
    axes.barh(names, [values[n] for n in names], color=colours, height=0.62)
    axes.set_xlim(-1.0, 1.0)
    axes.axvline(0.0, color=LINE, linewidth=0.7)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0, labelsize=7)
    axes.set_xlabel("Correlation [1]")
    axes.set_title("correlation with")


def _spectra(axes: Axes, time: np.ndarray, measured: np.ndarray, residual: np.ndarray, unit: str) -> None:
    """Draw the amplitude spectral densities of a measured channel and of its residual (Welch 1967)."""
    rate = (time.size - 1) / (time[-1] - time[0])
    length = min(time.size, max(256, time.size // 8))
    for values, colour, label in ((measured, MEASURED, "measured"), (residual, SIMULATED, "residual")):
        frequency, power = scipy.signal.welch(values, rate, nperseg=length, detrend="linear")
        keep = thin(frequency.size - 1, 1500) + 1
        axes.loglog(frequency[keep], np.sqrt(power[keep]), color=colour, linewidth=1.0, label=label)
    logarithmic(axes.xaxis, frequency[1], frequency[-1])
    label_powers(axes.yaxis)
    axes.set(xlabel="Frequency [Hz]", ylabel=f"[{unit}/√Hz]")
    axes.set_title("amplitude spectral density")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)


def _motion(measured: xr.Dataset, simulations: Sequence[xr.Dataset], body: str) -> dict[str, Regressor]:
    """Velocity and displacement of a body by channel.

    Both come from one simulation, the first that has the most of them, or from the measurement where none has any.
    """
    channels = ("velocity", "displacement")
    record = max(simulations, key=lambda one: sum(has_channels(one, body, c) for c in channels))
    if not any(has_channels(record, body, c) for c in channels):
        record = measured
    given = () if record is measured else prescribed(record)
    regressors = {}
    for c in (c for c in channels if has_channels(record, body, c)):
        values = np.interp(measured.time.values, record.time.values, record[c].sel(body=body).values)
        origin = "measured" if record is measured else "prescribed" if (body, c) in given else "simulated"
        regressors[c] = Regressor(values, origin, record[c].attrs.get("units", "1"))
    return regressors


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a - np.mean(a), b - np.mean(b)
    return float(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-300))
