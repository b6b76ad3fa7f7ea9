"""Figure of a reference record: phase curve, channels over time, energy over the cycle, or how it decays."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from calib.execution.files import whole
from calib.records import STATE, channels, is_response, prescribed, stated_period
from calib.records.cycles import impact
from calib.records.decay import BodyDecay, body_decays, is_free_decay
from calib.report.plots.decay import draw_decay
from calib.report.plots.measured_response import response_picture
from calib.report.plots.records import channel_axis, time_axis, two_periods
from calib.report.plots.style import DPI, MARK, MEASURED, STYLE, TEXT_WIDTH, line, png, thin
from calib.report.record_description import recorded_cycle, standard_uncertainty

BAND_SIGMAS = 2.0  # standard uncertainties on either side of a curve
MAX_ELLIPSES = 300  # that show the uncertainty of a phase curve


def reference_picture(record: xr.Dataset, path: str | Path) -> None:
    """Draw a record to a PNG file: phase curve, channels over time with their bands, and energy over the cycle.

    Of a free decay frequency and damping ratio over amplitude are drawn: a dot a period, by its zero crossings, and the
    smoother. Bands and ellipses are 2 standard uncertainties on either side.

    record : channels (body, time) in SI
    """
    if is_response(record):
        response_picture(record, path)
        return
    bodies, names = [str(b) for b in record.body.values], channels(record)
    cycle = recorded_cycle(record) if "velocity" in names else None
    loops = set(STATE) <= set(names)
    decays = (
        {one.body: one for one in body_decays(record) if isinstance(one, BodyDecay)} if is_free_decay(record) else {}
    )
    columns = len(names) + loops + (cycle is not None) + 2 * bool(decays)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(0.55 * TEXT_WIDTH * columns, 2.5 * len(bodies)), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(bodies), columns, squeeze=False)
        for body, row in zip(bodies, grid, strict=True):
            if loops:
                _loop(row[0], record, body)
            for channel, axes in zip(names, row[loops:], strict=False):
                _history(axes, record, body, channel)
            if cycle is not None:
                _energy(row[-1], cycle, body)
            if body in decays:
                draw_decay(row[-2], row[-1], record, decays[body])
            given = [c for b, c in prescribed(record) if b == body]
            row[0].set_title(f"{body} (prescribed by the excitation)" if given else body)
        with whole(Path(path)) as temporary:
            temporary.write_bytes(png(figure))


def _loop(axes: Axes, record: xr.Dataset, body: str) -> None:
    """Draw a phase curve with the ellipses of its uncertainty."""
    one = record.sel(body=body)
    _, scale, unit = channel_axis(record, body, "displacement")
    x, v = scale * one.displacement.values, one.velocity.values
    sigma_x, sigma_v = (standard_uncertainty(record, body, channel) for channel in STATE)
    if sigma_x is not None and sigma_v is not None:
        keep = thin(x.size, MAX_ELLIPSES)
        band = EllipseCollection(
            2.0 * BAND_SIGMAS * scale * sigma_x[keep], 2.0 * BAND_SIGMAS * sigma_v[keep], np.zeros(keep.size),
            units="xy",
            offsets=np.column_stack([x[keep], v[keep]]), offset_transform=axes.transData,
            facecolors=MEASURED, alpha=0.25, linewidths=0.0,
        )  # fmt: skip
        axes.add_collection(band)
    line(axes, x, v)
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.7, zorder=1)
    axes.margins(0.08)
    axes.set_xlabel(f"Displacement [{unit}]")
    axes.set_ylabel("Velocity [m/s]")


def _history(axes: Axes, record: xr.Dataset, body: str, channel: str) -> None:
    """Draw a channel over time, two periods of it where it has a period, with the band of its uncertainty."""
    label, scale, unit = channel_axis(record, body, channel)
    period, time = stated_period(record), record.time.values
    shown = two_periods(record, period) if period else slice(None)
    factor, unit_of_time = time_axis(record)
    times, values = factor * (time[shown] - time[0]), scale * record[channel].sel(body=body).values[shown]
    sigma = standard_uncertainty(record, body, channel)
    if sigma is not None:
        half = BAND_SIGMAS * scale * sigma[shown]
        axes.fill_between(times, values - half, values + half, color=MEASURED, alpha=0.45, linewidth=0.0)
    line(axes, times, values)
    axes.margins(x=0.01)
    axes.set_xlabel(f"Time [{unit_of_time}]")
    axes.set_ylabel(f"{label} [{unit}]")


def _energy(axes: Axes, cycle: xr.Dataset, body: str) -> None:
    """Draw the kinetic energy per unit mass over the cycle, with the impact."""
    phase, velocity = cycle.phase.values, cycle.velocity.sel(body=body).values
    line(axes, phase, 0.5 * velocity**2)
    impact_phase, _, contact = impact(phase, velocity)
    if np.isfinite(impact_phase):
        start, end = impact_phase - 0.5 * contact, impact_phase + 0.5 * contact
        axes.axvspan(start, end, color=MARK, alpha=0.35, linewidth=0.0, label="impact")
        axes.legend(loc="best")
    axes.margins(x=0.01)
    axes.set_xlabel("Phase [periods]")
    axes.set_ylabel("Kinetic energy\nper unit mass [J/kg]")
