"""What a reference record holds, and what to check in it, in sentences."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from calib.diagnosis.criteria import CRITERIA
from calib.errors import CalibError
from calib.records import (
    STATE,
    channels,
    fills_periods,
    is_response,
    mean_interval,
    nuisance_sigma,
    stated_period,
)
from calib.records.clipping import clipped_runs
from calib.records.cycles import gaps_in, impact, kind_of_motion, phase_curve
from calib.records.decay import is_free_decay, release, smoothed_record
from calib.records.excitation import UNITS
from calib.records.held_response import is_held, unsteady
from calib.records.repetition import other_frequency
from calib.records.response import HELD, SIGMA_SOURCE, complex_amplitude, has_phase, tolerances
from calib.records.white_noise import shows_noise
from calib.report.decay_description import decay_description
from calib.report.response_description import response_description
from calib.units import count, shown

MAX_INTEGRAL_ERROR = 0.02  # of the velocity's integral, over the rms displacement, noise apart  [1]
SIGNIFICANT_Z = 4.0  # from which noise does not explain a difference  [standard uncertainties]
MAX_GAP = 3.0  # between the last and the first sample of a closed curve, over its usual steps  [1]
MAX_GAP_OVER_JUMP = 1.5  # the same over its largest step  [1]
USUAL_STEP_QUANTILE = 0.98  # of the steps of a curve, which leaves out its jumps  [1]
MIN_SAMPLES_PER_CLIPPED_PERIOD = 20.0  # of the excitation; of fewer, noise is not told from the motion itself
MIN_CONTACT_SAMPLES = 4.0  # of an impact whose duration is resolved


def standard_uncertainty(record: xr.Dataset, body: str, channel: str) -> np.ndarray | None:
    """Standard uncertainty (time,) of a channel in its unit; None where the record states none."""
    name = f"{channel}_sigma"
    if name not in record:
        return None
    return np.broadcast_to(record[name].sel(body=body).values, record.time.shape)


def recorded_cycle(record: xr.Dataset) -> xr.Dataset | None:
    """Mean phase curve of a record over one period of its motion; None where the excitation has no period."""
    if stated_period(record) is None:
        return None
    try:
        return phase_curve(record, kind_of_motion(record).period or 1)
    except CalibError:  # shorter than a period
        return None


def record_description(record: xr.Dataset) -> Iterator[str]:
    """Describe a record: source, excitation, kind of motion, channels, energy over the cycle; a sentence each."""
    if "source" in record.attrs:
        yield f"source: {record.attrs['source']}"
    if is_response(record):
        yield from response_description(record)
        return
    time, period = record.time.values, stated_period(record)
    step = float(np.median(np.diff(time))) if gaps_in(time).size else (time[-1] - time[0]) / (time.size - 1)
    yield f"{time.size} samples at intervals of {shown(step, 's')}, {shown(time[-1] - time[0] + step, 's')} in all"
    if period is not None:
        drive = [f"{record.attrs[k]}" for k in ("quantity", "place") if k in record.attrs]
        size = ""
        if "amplitude" in record.attrs:
            unit = UNITS.get(str(record.attrs.get("quantity", "")), "")
            size = f", amplitude {shown(float(record.attrs['amplitude']), unit)}"
        yield f"excitation: {' at the '.join(drive) or 'not stated'}, {1.0 / period:.6g} Hz{size}"
    motion = kind_of_motion(record)
    yield f"kind of motion: {motion.kind} ({motion.evidence})"
    for channel in channels(record):
        unit = record[channel].attrs.get("units", "1")
        for body in (str(b) for b in record.body.values):
            values, sigma = record[channel].sel(body=body).values, standard_uncertainty(record, body, channel)
            uncertainty = "no uncertainty stated"
            if sigma is not None:
                uncertainty = f"standard uncertainty {shown(float(np.median(sigma)), unit, 2)} (median)"
            low, high = shown(float(values.min()), unit), shown(float(values.max()), unit)
            yield f"{channel} of {body}: {low} to {high}, {uncertainty}"
    yield from _energies(record)
    if is_free_decay(record):
        yield from decay_description(record)
    yield from _nuisances(record)


def _nuisances(record: xr.Dataset) -> Iterator[str]:
    """Name the nuisances of a record, and their uncertainty by the axis points of a digitised figure."""
    if "nuisance" in record.attrs:
        yield f"nuisances: {record.attrs['nuisance']}, unless the study states others"
    known: list[str] = []
    for name, sigma in nuisance_sigma(record).items():
        what, _, where = name.partition(".")
        size = f"{100.0 * sigma:.2g} %" if what == "scale" else shown(sigma, "s" if what == "shear" else "m", 2)
        known.append(f"{what}{f' of {where}' if where else ''} {size}")
    if known:
        yield f"standard uncertainties by the axis points: {', '.join(known)}"


def _energies(record: xr.Dataset) -> Iterator[str]:
    cycle = recorded_cycle(record)
    if cycle is None or "velocity" not in cycle:
        return
    phase = cycle.phase.values
    for body in (str(b) for b in record.body.values):
        velocity = cycle.velocity.sel(body=body).values
        energy = 0.5 * velocity**2
        gained = np.diff(energy, append=energy[:1])
        impact_phase, change, contact = impact(phase, velocity)
        text = f"kinetic energy of {body} per unit mass: at most {energy.max():.3g} J/kg"
        if np.isfinite(impact_phase):
            spacing = phase[1] - phase[0]
            near = np.abs((phase + 0.5 * spacing - impact_phase + 0.5 * phase.size * spacing) % (phase.size * spacing)
                          - 0.5 * phase.size * spacing) <= 0.5 * contact + spacing  # fmt: skip
            lost = float(gained[near].sum())
            text += (
                f"; the impact at phase {impact_phase:.3f} changes the velocity by {change:+.3g} m/s and the energy by "
                f"{lost:+.3g} J/kg, the rest of the cycle by {float(gained[~near].sum()):+.3g} J/kg"
            )
        yield text


def record_warnings(record: xr.Dataset) -> Iterator[str]:
    """Warn of what may be wrong with a record, a sentence each."""
    if "warning" in record.attrs:
        yield str(record.attrs["warning"])
    if is_response(record):
        if "response_sigma" not in record:
            yield (
                "the response states no uncertainty: a calibration takes 2 % of the rms amplitude of each sweep, a "
                f"diagnosis estimates it where the record has {CRITERIA.min_noise_samples} points or more"
            )
        if (doubt := doubtful_phase(record)) is not None:
            yield doubt
        yield from doubtful_uncertainties(record)
        yield from doubtful_control(record)
        return
    names = channels(record)
    for channel in names:
        if f"{channel}_sigma" not in record:
            yield f"{channel} states no uncertainty"
    for key in ("place", "quantity"):
        if key not in record.attrs and stated_period(record) is not None:
            yield f"the excitation is not fully stated (attribute {key!r} is missing); state it in the study"
    yield from doubtful_uncertainties(record)
    yield from _gaps(record)
    if (doubt := doubtful_frequency(record)) is not None:
        yield doubt
    if stated_period(record) is not None and not fills_periods(record):
        yield "the record does not fill whole periods of the excitation; the rest of the last period is not compared"
    for body in (str(b) for b in record.body.values):
        yield from _clipped_channels(record, body)
        if is_free_decay(record):
            yield from _late_release(record, body)
        if set(STATE) <= set(names):
            yield from _inconsistent_channels(record, body)
        if stated_period(record) is not None:
            yield from _open_curve(record, body)
            yield from _short_impact(record, body)


def doubtful_frequency(record: xr.Dataset, name: str = "the record") -> str | None:
    """Warn of a record over time that repeats itself at another frequency than its excitation is said to have."""
    other = other_frequency(record)
    if other is None:
        return None
    return (
        f"{name} repeats itself at {other:.4g} Hz, not at the {float(record.attrs['frequency']):.5g} Hz of its "
        "excitation; check the stated frequency and the unit of time"
    )


def doubtful_phase(record: xr.Dataset, name: str = "the record") -> str | None:
    """Warn of a response to a force by which a structure would do work on its exciter: no passive one does.

    The work of a force F on the body that it acts on is pi F |H| sin(lag) in a cycle, of which the sum over all points
    is looked at.
    """
    place, bodies = str(record.attrs.get("place", "")), [str(body) for body in record.body.values]
    if record.attrs.get("quantity") != "force" or place not in bodies or not has_phase(record):
        return None
    row = bodies.index(place)
    leading, sigma = complex_amplitude(record)[row].imag, tolerances(record)[1][row]
    if leading.sum() <= SIGNIFICANT_Z * np.sqrt((sigma**2).sum()):
        return None
    return (
        f"{name}: the displacement of {place} leads the force on it, by which a structure would do work on its "
        "exciter; a lag is a negative phase, and the phase is the displacement's unless its column says of what else"
    )


def doubtful_control(record: xr.Dataset, name: str = "the record") -> Iterator[str]:
    """Warn of sweeps whose amplitude is said to have been held, and was not."""
    if not is_held(record):
        return
    for sweep, varies in unsteady(record):
        yield (
            f"{name}: {record.attrs[HELD]} is said to have been held at a set amplitude, but in sweep {sweep:g} its "
            f"displacement, velocity and acceleration all vary by {100.0 * varies:.0f} % (rms) or more; check which "
            "body was held, and whether the level was set instead"
        )


def doubtful_uncertainties(record: xr.Dataset, name: str = "the record") -> Iterator[str]:
    """Warn of stated uncertainties (the median of each) above the largest amplitude of what they belong to."""
    for called, unit, amplitude, sigma in _uncertainties(record):
        largest, stated = float(np.nanmax(amplitude)), float(np.median(sigma))
        if 0.0 < largest < stated:
            yield (
                f"{name}: the {called} has a stated standard uncertainty of {shown(stated, unit, 2)}, above its "
                f"largest amplitude of {shown(largest, unit, 2)}; check the unit of sigma"
            )


def _uncertainties(record: xr.Dataset) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name and unit of each row that states its uncertainty, its amplitude about the mean (n,), uncertainty (n,)."""
    for row, body in enumerate(str(b) for b in record.body.values):
        if is_response(record):
            if "response_sigma" in record and SIGMA_SOURCE not in record.attrs:
                sigma = record["response_sigma"].values[row]
                yield f"response of {body}", "m", np.abs(complex_amplitude(record)[row]), sigma
            continue
        for channel in channels(record):
            stated, values = standard_uncertainty(record, body, channel), record[channel].values[row]
            if stated is not None:
                unit = str(record[channel].attrs.get("units", "1"))
                yield f"{channel} of {body}", unit, np.abs(values - np.nanmean(values)), stated


def _gaps(record: xr.Dataset) -> Iterator[str]:
    """Name the longest interval in which samples are missing."""
    time = record.time.values
    gaps = gaps_in(time)
    if gaps.size:
        before, behind = gaps[np.argmax(np.diff(gaps, axis=1))]
        usual = float(np.median(np.diff(time)))
        yield (
            f"samples are missing in {len(gaps)} interval(s) of time, the longest of {shown(behind - before, 's')} "
            f"from {shown(before, 's')} on, where the usual interval is {shown(usual, 's')}: "
            "nothing is compared there; check the recorder, or cut the record off before"
        )


def _clipped_channels(record: xr.Dataset, body: str) -> Iterator[str]:
    """Name channels of which runs of samples equal the largest or the smallest value.

    In a record of a driven motion the samples elsewhere have to show noise, lest a body that rests against a rigid stop
    in a simulated or a coarsely rounded record is told.
    """
    period, decays = stated_period(record), is_free_decay(record)
    if not decays and period is not None and period < MIN_SAMPLES_PER_CLIPPED_PERIOD * mean_interval(record):
        return
    for channel in channels(record):
        values = record[channel].sel(body=body).values
        runs = clipped_runs(values)
        if runs.size and (decays or shows_noise(values)):
            levels = sorted({float(values[first]) for first, _ in runs})
            unit = record[channel].attrs.get("units", "1")
            yield (
                f"{channel} of {body}: {int(np.diff(runs).sum())} samples in {count(len(runs), 'run')} equal the "
                f"extreme value of {' or '.join(shown(level, unit) for level in levels)}: a converter or an amplifier "
                "was at its limit; "
                + ("the decay is analysed behind them" if decays else "record again in a wider range")
            )


def _late_release(record: xr.Dataset, body: str) -> Iterator[str]:
    """Tell when a decay begins whose first samples are a rest, or a motion that the release still disturbs."""
    channel = next((c for c in STATE if c in channels(record)), None)
    if channel is None:
        return
    time = record.time.values
    first = release(time, record[channel].sel(body=body).values)
    free = _disturbed_until(record, body, channel)
    begins = []
    if first:
        begins.append(f"is at rest until {shown(time[first], 's')}")
    if free:
        begins.append(
            f"does not move freely until {shown(time[free], 's')} (what comes before is not continued to by the motion "
            "behind it, as when a magnet or a hand lets go with a jerk or slips)"
        )
    if begins:
        count = max(first, free)
        yield (
            f"{body} {' and '.join(begins)}: its decay is analysed from there on, but simulations are released at the "
            f"first sample; cut off the {count} samples before with `first` of [record.table]: `first = {count}`, or "
            f"{count} more than it is, times `decimate` where samples are left out"
        )


def _disturbed_until(record: xr.Dataset, body: str, channel: str) -> int:
    """Index of the first sample of a decay that its release no longer disturbs, 0 where it does not disturb any."""
    try:
        decay = smoothed_record(record, body, channel)
    except CalibError:  # which the description says
        return 0
    return int(np.searchsorted(record.time.values, decay.start)) if decay.disturbed and decay.start is not None else 0


def _inconsistent_channels(record: xr.Dataset, body: str) -> Iterator[str]:
    """Compare the integral of the velocity with the displacement, both without their mean and linear drift."""
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
    sigma_x, sigma_v = (standard_uncertainty(record, body, channel) for channel in STATE)
    if sigma_x is not None and sigma_v is not None:
        walk = float(np.sqrt(np.mean(sigma_v**2) * steps.mean() * (time[-1] - time[0])))
        noise = float(np.hypot(np.sqrt(np.mean(sigma_x**2)), walk))
    jump = float(np.abs(np.diff(v)).max() * steps.max())  # the instant of an impact between two samples is unknown
    off = float(np.sqrt(np.mean((summed - x) ** 2)))
    if off > max(MAX_INTEGRAL_ERROR * size, SIGNIFICANT_Z * noise, jump):
        ratio = float(summed @ x / (x @ x))
        yield (
            f"{body}: the velocity is not the derivative of the displacement: its integral differs by "
            f"{100.0 * off / size:.2g} % (root mean square) and is {ratio:.3f} times as large; check the scales, units "
            "and zeros of the axes"
        )


def _open_curve(record: xr.Dataset, body: str) -> Iterator[str]:
    """Compare the step from the last sample of the cycle to the first with the other steps."""
    if not fills_periods(record):
        return
    one = record.sel(body=body)
    for channel in (c for c in STATE if c in one):
        values = one[channel].values
        steps = np.abs(np.diff(values))
        usual = float(np.quantile(steps, USUAL_STEP_QUANTILE))
        sigma = standard_uncertainty(record, body, channel)
        noise = 0.0 if sigma is None else float(np.hypot(sigma[0], sigma[-1]))
        gap = float(abs(values[0] - values[-1]))
        if gap > MAX_GAP * usual + SIGNIFICANT_Z * noise and gap > MAX_GAP_OVER_JUMP * float(steps.max()):
            yield (
                f"{body}: the phase curve is not closed: {channel} changes by "
                f"{shown(gap, record[channel].attrs['units'])} from the last sample to the first, "
                f"{gap / max(usual, 1e-300):.1f} times its usual steps"
            )


def _short_impact(record: xr.Dataset, body: str) -> Iterator[str]:
    cycle = recorded_cycle(record)
    if cycle is None or "velocity" not in cycle:
        return
    phase = cycle.phase.values
    impact_phase, _, contact = impact(phase, cycle.velocity.sel(body=body).values)
    count = contact / (phase[1] - phase[0])
    if np.isfinite(impact_phase) and count < MIN_CONTACT_SAMPLES:
        yield (
            f"{body}: the impact at phase {impact_phase:.3f} lasts {count:.1f} samples: its duration is not resolved, "
            "and the velocity beside it depends on the instants of the samples"
        )
