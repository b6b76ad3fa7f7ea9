"""Free decays: frequency and damping ratio over amplitude, measured and simulated."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.errors import CalibError
from calib.records.decay import BodyDecay, body_decays, crossing_curves, over_amplitude
from calib.report.plots.records import channel_axis, has_channels
from calib.report.plots.style import (
    LINE,
    MEASURED,
    SIMULATED,
    STYLE,
    TEXT_WIDTH,
    Look,
    legend,
    line,
    logarithmic,
    spot,
)

DECAY_SIGMAS = 2.0  # standard uncertainties on either side of a curve
MAX_SHOWN_SIGMA = 0.15  # of the curve's median, of a point that sets the limits of its axis  [1]
DECAY_MARGIN = 0.35  # of the range of the curve, above and below it  [1]
SIMULATED_MARGIN = 0.05  # of the axis, beyond a simulated curve  [1]
LABELS = {"frequency": "Frequency [Hz]", "damping_ratio": "Damping ratio [%]"}
FACTORS = {"frequency": 1.0, "damping_ratio": 100.0}  # of the axes: the damping ratio is in per cent


def decay_curves(measured: xr.Dataset, simulated: xr.Dataset | None) -> Figure | None:
    """Frequency and damping ratio of each body over amplitude; None where no body's can be told.

    simulated : on the same time base
    """
    decays = [one for one in body_decays(measured) if isinstance(one, BodyDecay)]
    if not decays:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(TEXT_WIDTH, 2.5 * len(decays) + 0.3), layout="constrained")
        for one, row in zip(decays, figure.subplots(len(decays), 2, squeeze=False), strict=True):
            draw_decay(row[0], row[1], measured, one)
            row[0].set_title(one.body)
            if simulated is not None and has_channels(simulated, one.body, one.channel):
                _simulated(row[0], row[1], measured, simulated, one)
        legend(figure, simulated is not None)
    return figure


def draw_decay(left: Axes, right: Axes, record: xr.Dataset, one: BodyDecay) -> None:
    """Draw the measured frequency and damping ratio: a dot a period by zero crossings, the smoother with its band."""
    label, scale, unit = channel_axis(record, one.body, one.channel)
    crossings, amplitude = crossing_curves(one.smoothed), scale * one.curves.amplitude.values
    for axes, name in ((left, "frequency"), (right, "damping_ratio")):
        factor, values = FACTORS[name], one.curves[name].values
        half = DECAY_SIGMAS * one.curves[f"{name}_sigma"].values
        look: Look = {"color": MEASURED, "markersize": spot(crossings.sizes["point"], 3.0), "markeredgewidth": 0}
        axes.plot(scale * crossings.amplitude.values, factor * crossings[name].values, ".", alpha=0.6, **look)
        axes.fill_between(
            amplitude, factor * (values - half), factor * (values + half), color=LINE, alpha=0.18, linewidth=0.0
        )
        line(axes, amplitude, factor * values, LINE)
        axes.set_xscale("log")
        axes.set_xlim(amplitude[-1] / 1.1, amplitude[0] * 1.1)
        logarithmic(axes.xaxis, float(amplitude[-1]), float(amplitude[0]))
        axes.set_ylim(*_limits(factor * values, factor * half))
        axes.set_xlabel(f"Amplitude of the {label.lower()} [{unit}]")
        axes.set_ylabel(LABELS[name])


def _limits(values: np.ndarray, half: np.ndarray) -> tuple[float, float]:
    """Limits of an axis on which the band of a curve is seen, but for points that are hardly known."""
    known = half <= max(DECAY_SIGMAS * MAX_SHOWN_SIGMA * float(np.median(np.abs(values))), float(np.median(half)))
    low, high = float((values - half)[known].min()), float((values + half)[known].max())
    return low - DECAY_MARGIN * (high - low), high + DECAY_MARGIN * (high - low)


def _simulated(left: Axes, right: Axes, measured: xr.Dataset, simulated: xr.Dataset, one: BodyDecay) -> None:
    """Draw the simulated frequency and damping ratio at the amplitudes that the simulation passes."""
    try:
        fit = one.smoothed.frame.smoothed(simulated.time.values, simulated[one.channel].sel(body=one.body).values)
    except CalibError:  # it does not oscillate
        return
    _, scale, _ = channel_axis(measured, one.body, one.channel)
    passed = fit.basis.matrix(np.linspace(*fit.basis.range, one.curves.sizes["point"])) @ fit.log_amplitude
    wanted = np.log(one.curves.amplitude.values)
    wanted = wanted[(wanted <= passed.max()) & (wanted >= passed.min())]
    _, frequency, damping = over_amplitude(fit, wanted)
    for axes, name, curve in ((left, "frequency", frequency), (right, "damping_ratio", damping)):
        line(axes, scale * np.exp(wanted), FACTORS[name] * curve, SIMULATED, 1.3)
        (low, high), values = axes.get_ylim(), FACTORS[name] * curve
        margin = SIMULATED_MARGIN * (high - low)
        axes.set_ylim(min([low, *(values - margin)]), max([high, *(values + margin)]))
