"""What a reference record holds: its picture, its figures, and what to be wary of."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from calib.errors import CalibError
from calib.execution.files import whole
from calib.records import STATE, channels, fills_periods, nuisance_sigma, prescribed, stated_period
from calib.records.cycles import impact, kind_of_motion, phase_curve
from calib.report.drawing import DPI, MARK, MEASURED, STYLE, WIDTH, line, png, thin
from calib.report.figures import clock, quantity, two_periods
from calib.units import shown

DERIVED = 0.02  # of the displacement: how far the integral of the velocity may be off it, noise apart
APART = 4.0  # standard uncertainties: what noise does not explain
OPEN = 3.0  # times the longest step of the loop but its jumps: a wider gap between end and beginning is open
RESOLVED = 4.0  # samples: a contact that lasts fewer is as short as the samples are far apart
TWO = 2.0  # standard uncertainties that a band shows on either side


def reference_picture(record: xr.Dataset, path: str | Path) -> None:
    """Draw a record to a PNG file: phase curve, channels over time with their bands, and energy over the cycle.

    Bands and ellipses are 2 standard uncertainties on either side.

    record : channels (body, time) in SI
    """
    bodies, names = [str(b) for b in record.body.values], channels(record)
    loops, cyclic = set(STATE) <= set(names), _cycle(record) is not None and "velocity" in names
    columns = len(names) + loops + cyclic
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(0.55 * WIDTH * columns, 2.5 * len(bodies)), dpi=DPI, layout="constrained")
        grid = figure.subplots(len(bodies), columns, squeeze=False)
        for body, row in zip(bodies, grid, strict=True):
            if loops:
                _loop(row[0], record, body)
            for channel, axes in zip(names, row[loops:], strict=False):
                _history(axes, record, body, channel)
            if cyclic:
                _energy(row[-1], record, body)
            given = [c for b, c in prescribed(record) if b == body]
            row[0].set_title(f"{body} (prescribed by the excitation)" if given else body)
        with whole(Path(path)) as temporary:
            temporary.write_bytes(png(figure))


def _sigma(record: xr.Dataset, body: str, channel: str) -> np.ndarray | None:
    """Standard uncertainty (time,) of a channel, None where the record states none."""
    name = f"{channel}_sigma"
    if name not in record:
        return None
    return np.broadcast_to(record[name].sel(body=body).values, record.time.shape)


def _loop(axes, record, body):
    one = record.sel(body=body)
    _, scale, unit = quantity(record, body, "displacement")
    x, v = scale * one.displacement.values, one.velocity.values
    sigma = [_sigma(record, body, c) for c in STATE]
    if all(s is not None for s in sigma):
        keep = thin(x.size, 300)
        band = EllipseCollection(
            2.0 * TWO * scale * sigma[0][keep], 2.0 * TWO * sigma[1][keep], np.zeros(keep.size), units="xy",
            offsets=np.column_stack([x[keep], v[keep]]), offset_transform=axes.transData,
            facecolors=MEASURED, alpha=0.25, linewidths=0.0,
        )  # fmt: skip
        axes.add_collection(band)
    line(axes, x, v)
    axes.axhline(0.0, color="#bbbbbb", linewidth=0.7, zorder=1)
    axes.margins(0.08)
    axes.set_xlabel(f"Displacement [{unit}]")
    axes.set_ylabel("Velocity [m/s]")


def _history(axes, record, body, channel):
    label, scale, unit = quantity(record, body, channel)
    period, time = stated_period(record), record.time.values
    kept = two_periods(record, period) if period else slice(None)
    factor, unit_of_time = clock(record)
    at, values = factor * (time[kept] - time[0]), scale * record[channel].sel(body=body).values[kept]
    sigma = _sigma(record, body, channel)
    if sigma is not None:
        half = TWO * scale * sigma[kept]
        axes.fill_between(at, values - half, values + half, color=MEASURED, alpha=0.45, linewidth=0.0)
    line(axes, at, values)
    axes.margins(x=0.01)
    axes.set_xlabel(f"Time [{unit_of_time}]")
    axes.set_ylabel(f"{label} [{unit}]")


def _energy(axes, record, body):
    cycle = _cycle(record)
    phase, velocity = cycle.phase.values, cycle.velocity.sel(body=body).values
    line(axes, phase, 0.5 * velocity**2)
    at, _, contact = impact(phase, velocity)
    if np.isfinite(at):
        axes.axvspan(at - 0.5 * contact, at + 0.5 * contact, color=MARK, alpha=0.35, linewidth=0.0, label="impact")
        axes.legend(loc="best")
    axes.margins(x=0.01)
    axes.set_xlabel("Phase [periods]")
    axes.set_ylabel("Kinetic energy / mass [J/kg]")


def _cycle(record: xr.Dataset) -> xr.Dataset | None:
    """Mean loop of a record, over as many periods as it says that it returns after; None without one."""
    if stated_period(record) is None:
        return None
    try:
        return phase_curve(record, kind_of_motion(record).period or 1)
    except CalibError:  # shorter than a period
        return None


# --- in words


def described(record: xr.Dataset) -> Iterator[str]:
    """Say what a record holds: its source, its drive, its kind of motion, its channels, its energy over the cycle."""
    if "source" in record.attrs:
        yield f"source: {record.attrs['source']}"
    time, period = record.time.values, stated_period(record)
    step = (time[-1] - time[0]) / (time.size - 1)
    yield f"{time.size} samples, {shown(step, 's')} apart, over {shown(time[-1] - time[0] + step, 's')}"
    if period is not None:
        drive = [f"{record.attrs[k]}" for k in ("quantity", "place") if k in record.attrs]
        size = f", amplitude {record.attrs['amplitude']:.4g} (SI)" if "amplitude" in record.attrs else ""
        yield f"excitation: {' at the '.join(drive) or 'not stated'}, {1.0 / period:.6g} Hz{size}"
    motion = kind_of_motion(record)
    yield f"kind of motion: {motion.kind} ({motion.evidence})"
    for channel in channels(record):
        unit = record[channel].attrs.get("units", "1")
        for body in (str(b) for b in record.body.values):
            values, sigma = record[channel].sel(body=body).values, _sigma(record, body, channel)
            sure = "no uncertainty stated"
            if sigma is not None:
                sure = f"+- {shown(float(np.median(sigma)), unit, 2)} (median)"
            low, high = shown(float(values.min()), unit), shown(float(values.max()), unit)
            yield f"{channel} of {body}: {low} .. {high}, {sure}"
    yield from _energies(record)
    yield from _left_open(record)


def _left_open(record: xr.Dataset) -> Iterator[str]:
    """Say what a study solves for, and how well the axes of a digitised figure know it."""
    if "nuisance" in record.attrs:
        yield f"a study solves for {record.attrs['nuisance']}, unless it states its own nuisances"
    known = []
    for name, sigma in nuisance_sigma(record).items():
        what, _, where = name.partition(".")
        size = f"{100.0 * sigma:.2g} %" if what == "scale" else shown(sigma, "s" if what == "shear" else "m", 2)
        known.append(f"{what}{f' of {where}' if where else ''} to {size}")
    if known:
        yield f"the axis points tell {', '.join(known)} (standard uncertainties)"


def _energies(record: xr.Dataset) -> Iterator[str]:
    cycle = _cycle(record)
    if cycle is None or "velocity" not in cycle:
        return
    phase = cycle.phase.values
    for body in (str(b) for b in record.body.values):
        velocity = cycle.velocity.sel(body=body).values
        energy = 0.5 * velocity**2
        gained = np.diff(energy, append=energy[:1])
        at, change, contact = impact(phase, velocity)
        said = f"energy of {body} per unit mass: at most {energy.max():.3g} J/kg"
        if np.isfinite(at):
            spacing = phase[1] - phase[0]
            near = np.abs((phase + 0.5 * spacing - at + 0.5 * phase.size * spacing) % (phase.size * spacing)
                          - 0.5 * phase.size * spacing) <= 0.5 * contact + spacing  # fmt: skip
            lost = float(gained[near].sum())
            said += (
                f"; the impact at phase {at:.3f} changes the velocity by {change:+.3g} m/s and the energy by "
                f"{lost:+.3g} J/kg, the rest of the cycle by {float(gained[~near].sum()):+.3g} J/kg"
            )
        yield said


def wary(record: xr.Dataset) -> Iterator[str]:
    """Say what to be wary of in a record."""
    if "warning" in record.attrs:
        yield str(record.attrs["warning"])
    names = channels(record)
    for channel in names:
        if f"{channel}_sigma" not in record:
            yield f"{channel} states no uncertainty"
    for key in ("place", "quantity"):
        if key not in record.attrs and stated_period(record) is not None:
            yield f"how the bodies were driven is not stated (attribute {key!r}); a study has to say it"
    if stated_period(record) is not None and not fills_periods(record):
        yield "the record does not fill whole periods of the excitation; what is over is not compared"
    for body in (str(b) for b in record.body.values):
        if set(STATE) <= set(names):
            yield from _not_derived(record, body)
        if stated_period(record) is not None:
            yield from _open(record, body)
            yield from _short_impact(record, body)


def _not_derived(record: xr.Dataset, body: str) -> Iterator[str]:
    """Compare the velocity's integral with the displacement, both without their means and drift."""
    time = record.time.values
    one = record.sel(body=body)
    x, v = one.displacement.values, one.velocity.values
    steps = np.diff(time)
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * steps)])
    design = np.column_stack([np.ones(time.size), time - time[0]])
    x, summed = (row - design @ np.linalg.lstsq(design, row, rcond=None)[0] for row in (x, summed))
    size = float(np.sqrt(np.mean(x**2)))
    if size == 0.0:
        return
    noise = 0.0
    if all(_sigma(record, body, c) is not None for c in STATE):
        walk = float(np.sqrt(np.mean(_sigma(record, body, "velocity") ** 2) * steps.mean() * (time[-1] - time[0])))
        noise = float(np.hypot(np.sqrt(np.mean(_sigma(record, body, "displacement") ** 2)), walk))
    jump = float(np.abs(np.diff(v)).max() * steps.max())  # the sum does not know where between two samples it was
    off = float(np.sqrt(np.mean((summed - x) ** 2)))
    if off > max(DERIVED * size, APART * noise, jump):
        ratio = float(summed @ x / (x @ x))
        yield (
            f"{body}: the velocity is not the derivative of the displacement: its integral differs by "
            f"{100.0 * off / size:.2g} % (root mean square; it is {ratio:.3f} times as large); are scales, units and "
            "zero of the axes right?"
        )


def _open(record: xr.Dataset, body: str) -> Iterator[str]:
    """Compare the way from the last sample of the cycle to the first with the other steps."""
    if not fills_periods(record):
        return
    one = record.sel(body=body)
    for channel in (c for c in STATE if c in one):
        values = one[channel].values
        steps = np.abs(np.diff(values))
        usual = float(np.quantile(steps, 0.98))
        sigma = _sigma(record, body, channel)
        noise = 0.0 if sigma is None else float(np.hypot(sigma[0], sigma[-1]))
        gap = float(abs(values[0] - values[-1]))
        if gap > OPEN * usual + APART * noise and gap > 1.5 * float(steps.max()):
            yield (
                f"{body}: the loop is not closed: {channel} goes {shown(gap, record[channel].attrs['units'])} from the "
                f"last sample to the first, {gap / max(usual, 1e-300):.1f} times its usual steps"
            )


def _short_impact(record: xr.Dataset, body: str) -> Iterator[str]:
    cycle = _cycle(record)
    if cycle is None or "velocity" not in cycle:
        return
    phase = cycle.phase.values
    at, _, contact = impact(phase, cycle.velocity.sel(body=body).values)
    count = contact / (phase[1] - phase[0])
    if np.isfinite(at) and count < RESOLVED:
        yield (
            f"{body}: the impact at phase {at:.3f} lasts {count:.1f} samples: its duration is not resolved, and the "
            "velocity next to it depends on where the samples fall"
        )
