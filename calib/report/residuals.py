"""Pictures of what a simulation leaves of a measurement."""

import math

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy import signal

from calib.records import prescribed, stated_period
from calib.report.drawing import LINE, MEASURED, OTHER, SIMULATED, STYLE, WIDTH, line, marks, shown_unit, spot, thin
from calib.report.figures import has, impact_times, judged, quantity

CLOUD = 6000  # samples drawn as a (rasterised) cloud
MIN_TOLERANCE = 1e-4  # 1 - R^2 of a function regressed on 1, x and v, below which nothing is left of it  [1]; the
# tolerance of a regressor, with its default in SPSS (REGRESSION, CRITERIA TOLERANCE)


def residual_over_phase(measured: xr.Dataset, simulated: xr.Dataset) -> Figure | None:
    """Measured minus simulated over the phase of the excitation: mean of the cycles and two standard errors of it.

    None where the record has no period or nothing of it is judged.
    """
    period = stated_period(measured)
    pairs = judged(measured, simulated)
    if not period or not pairs:
        return None
    with mpl.rc_context(STYLE):
        columns = min(2, len(pairs))
        rows = math.ceil(len(pairs) / columns)
        figure = Figure(figsize=(WIDTH, 1.9 * rows + 0.2), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
        for (body, channel), axes in zip(pairs, grid.flat, strict=False):
            label, scale, unit = quantity(measured, body, channel)
            phase, mean, error = over_phase(measured, simulated, body, channel, period)
            mean, error = scale * mean, scale * error
            axes.fill_between(phase, mean - 2 * error, mean + 2 * error, color=SIMULATED, alpha=0.22, linewidth=0)
            axes.plot(phase, mean, color=SIMULATED, linewidth=1.1)
            axes.axhline(0.0, color=LINE, linewidth=0.7)
            marks(axes, np.unique(np.round((impact_times(simulated) - float(measured.time[0])) / period % 1.0, 3)))
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
    """What a residual hangs on, for a record without a period: time, velocity, displacement, simple laws, frequency.

    residual = measured - simulated, both (body, time) on one time base. The motion is the simulated one: of `simulated`
    or, where that lacks a channel, of `motions`, what was simulated with the channels that were not measured too. Of
    the measured motion the residual is a part, and would be correlated with it whatever the model is.
    """
    label, scale, unit = quantity(measured, body, channel)
    truth = scale * measured[channel].sel(body=body).values
    residual = truth - scale * simulated[channel].sel(body=body).values
    time = measured.time.values - float(measured.time[0])
    motion = _motion(measured, (simulated, simulated if motions is None else motions), body)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 6.4), layout="constrained")
        upper, middle, lower = figure.subfigures(3, 1, height_ratios=(1.0, 1.25, 1.0))
        axes = upper.subplots()
        line(axes, time, residual, width=0.6)
        axes.set(xlabel="Time [s]", ylabel=f"Residual [{unit}]")
        rms = math.sqrt(np.mean(residual**2))
        axes.set_title(f"{body}: {label.lower()}, measured minus simulated; rms {rms:.3g} {unit}")
        axes.margins(x=0.01)
        *clouds, bars = middle.subplots(1, len(motion) + 1, squeeze=False)[0]
        for (c, found), axes in zip(motion.items(), clouds, strict=True):
            _against(axes, *found, residual, c, unit)
        _correlations(bars, residual, {c: values for c, (values, *_) in motion.items()})
        _spectra(lower.subplots(), time, truth, residual, unit)
    return figure


def correlations(residual: np.ndarray, motion: dict[str, np.ndarray]) -> dict[str, float]:
    """Correlation of a residual (n,) with simple functions of displacement x and velocity v, each (n,), by name.

    x and v themselves are taken as they are; of the others and of the residual the part that is linear in x and v is
    taken out first (partial correlation): what a linear model could still absorb is no sign of what it lacks. A
    function of which x and v explain 99.99 % of the variance, as they do of v^2 in a free fall, is left out.
    """
    x, v = motion.get("displacement"), motion.get("velocity")
    linear = np.column_stack([np.ones_like(residual), *(m for m in (x, v) if m is not None)])
    scale = np.linalg.norm(linear, axis=0)
    basis = np.linalg.qr(linear / np.where(scale > 0.0, scale, 1.0))[0]

    def bare(a):
        return a - basis @ (basis.T @ a)

    rest = bare(residual)

    def partial(functions):
        left = {name: (f - np.mean(f), bare(f)) for name, f in functions.items()}
        return {n: _correlation(rest, b) for n, (f, b) in left.items() if b @ b > MIN_TOLERANCE * (f @ f)}

    found = {}
    if v is not None:
        found |= {"v": _correlation(residual, v)} | partial({**_shapes("v", v), "sign v": np.sign(v)})
    if x is not None:
        found |= {"x": _correlation(residual, x)} | partial(_shapes("x", x))
    return found


def _shapes(name, m):
    return {f"{name}²": m**2, f"{name}|{name}|": m * np.abs(m), f"{name}³": m**3}


def _against(axes, values, origin, x_unit, residual, channel, unit):
    """Residual over a motion: a cloud, with the mean in 25 bins of equal width."""
    factor, x_unit = shown_unit(x_unit, np.max(np.abs(values)))
    x = factor * values
    keep = thin(x.size, CLOUD)
    cloud = {"color": MEASURED, "markersize": spot(keep.size), "markeredgewidth": 0, "alpha": 0.5, "rasterized": True}
    axes.plot(x[keep], residual[keep], ".", **cloud)
    edges = np.linspace(*np.quantile(x, [0.002, 0.998]), 26)
    which = np.digitize(x, edges) - 1
    bins = np.array([i for i in range(25) if np.sum(which == i) > 4], dtype=int)  # none where nothing moves
    means = [np.mean(residual[which == i]) for i in bins]
    axes.plot(0.5 * (edges[bins] + edges[bins + 1]), means, "o-", color=SIMULATED, markersize=2.8, linewidth=1.2)
    axes.axhline(0.0, color=LINE, linewidth=0.7)
    axes.set_xlabel(f"{channel.capitalize()}, {origin} [{x_unit}]")
    axes.set_ylabel(f"Residual [{unit}]")
    axes.set_title(f"against {channel}")


def _correlations(axes, residual, motion):
    values = {**correlations(residual, motion), "own past": _correlation(residual[1:], residual[:-1])}
    names = list(values)[::-1]
    colours = [OTHER if n in ("own past", "x", "v") else SIMULATED for n in names]
    axes.barh(names, [values[n] for n in names], color=colours, height=0.62)
    axes.set_xlim(-1.0, 1.0)
    axes.axvline(0.0, color=LINE, linewidth=0.7)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0, labelsize=7)
    axes.set_xlabel("Correlation [1]")
    axes.set_title("correlated with")


def _spectra(axes, time, truth, residual, unit):
    """Amplitude spectral densities of what was measured and of what is left of it (Welch 1967)."""
    rate = (time.size - 1) / (time[-1] - time[0])
    length = min(time.size, max(256, time.size // 8))
    for values, colour, label in ((truth, MEASURED, "measured"), (residual, SIMULATED, "residual")):
        frequency, power = signal.welch(values, rate, nperseg=length, detrend="linear")
        keep = thin(frequency.size - 1, 1500) + 1
        axes.loglog(frequency[keep], np.sqrt(power[keep]), color=colour, linewidth=1.0, label=label)
    axes.set(xlabel="Frequency [Hz]", ylabel=f"Density [{unit}/√Hz]")
    axes.set_title("spectrum")
    axes.legend(loc="lower left")


def _motion(measured, simulations, body):
    """Velocity and displacement by channel: values (n,) at the measured instants, how they are known and their unit.

    Both are of one simulation, the first that has the most of them; of the measurement where none has any.
    """
    channels = ("velocity", "displacement")
    record = max(simulations, key=lambda one: sum(has(one, body, c) for c in channels))
    if not any(has(record, body, c) for c in channels):
        record = measured
    given = set() if record is measured else prescribed(record)
    found = {}
    for c in (c for c in channels if has(record, body, c)):
        values = np.interp(measured.time.values, record.time.values, record[c].sel(body=body).values)
        origin = "measured" if record is measured else "prescribed" if (body, c) in given else "simulated"
        found[c] = values, origin, record[c].attrs.get("units", "1")
    return found


def _correlation(a, b):
    a, b = a - np.mean(a), b - np.mean(b)
    return float(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-300))
