"""The frequency response made of the curves of a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from calib.digitise.reading import Reading
from calib.digitise.response_curve import AMPLITUDE_CURVE, PHASE_CURVE, PrintedSweep
from calib.digitise.spec import FigureToml
from calib.errors import CalibError
from calib.records.response import UNKNOWN_PHASE, make_response
from calib.units import shown

MAX_PRINTED_POINTS = 60  # of a curve in the record: a traced line has many more, which are no measurements of their own
MAX_FOLD = 0.01  # of its frequency range, by which a curve that has to be single-valued may run back

Curves = Mapping[str, Reading]  # of one sweep, amplitude or phase by body


def assembled_response(readings: Sequence[Reading], spec: FigureToml) -> xr.Dataset:
    """Make a frequency response: of each level and direction a sweep, its points along the amplitude of the first body.

    Standard uncertainties are those of the traced line and of the axes together. Without phases the record says so, and
    amplitudes alone are compared.

    Raises
    ------
    CalibError : curves over time among them, two of one kind, an amplitude that is missing, phases of some bodies
        only, curves of one sweep that share no frequency, or that are needed at a frequency at which they fold
    """
    others = [reading.kind for reading in readings if reading.sweep is None]
    if others:
        raise CalibError(f"a record is over frequency or over time: of this one there are {others[0]}s too; make two")
    amplitudes, phases = (_by_sweep(readings, kind) for kind in (AMPLITUDE_CURVE, PHASE_CURVE))
    bodies = list(dict.fromkeys(reading.body for reading in readings))
    for sweep in {**amplitudes, **phases}:
        for body in bodies:
            if body not in amplitudes.get(sweep, {}):
                raise CalibError(f"the amplitude of {body!r} over the frequency is missing {_of(sweep)}")
            if phases and body not in phases.get(sweep, {}):
                raise CalibError(
                    f"the phase of {body!r} over the frequency is missing {_of(sweep)}, but others have one; give it "
                    "of all curves or of none"
                )
    parts = [_points(curves, phases.get(sweep, {}), bodies, sweep) for sweep, curves in amplitudes.items()]
    rows = {key: np.concatenate([part[key] for part in parts], axis=-1) for key in parts[0]}
    sizes = [part["frequency"].size for part in parts]
    record = make_response(
        rows["frequency"], bodies, rows["amplitude"], np.repeat([sweep.level for sweep in amplitudes], sizes),
        next(iter(amplitudes)).unit, np.repeat(np.arange(len(sizes)), sizes),
        np.repeat([sweep.direction for sweep in amplitudes], sizes), sigma=rows["sigma"],
        frequency_sigma=rows["frequency_sigma"], source=spec.source,
    )  # fmt: skip
    if not phases:
        record.attrs["phases"] = UNKNOWN_PHASE
    if spec.excitation is not None:
        record.attrs |= {"place": spec.excitation.place, "quantity": spec.excitation.quantity}
    return record


def _by_sweep(readings: Sequence[Reading], kind: str) -> dict[PrintedSweep, dict[str, Reading]]:
    found: dict[PrintedSweep, dict[str, Reading]] = {}
    for reading in readings:
        if reading.kind != kind or reading.sweep is None:
            continue
        sweep = reading.sweep._replace(rates=None)
        if reading.body in found.setdefault(sweep, {}):
            raise CalibError(f"two curves are the {kind} of body {reading.body!r} {_of(sweep)}; keep one")
        found[sweep][reading.body] = reading
    return dict(sorted(found.items()))


def _of(sweep: PrintedSweep) -> str:
    return f"at {shown(sweep.level, sweep.unit)}, {'up' if sweep.direction > 0.0 else 'down'}"


def _points(amplitudes: Curves, phases: Curves, bodies: Sequence[str], sweep: PrintedSweep) -> dict[str, np.ndarray]:
    """Points of one sweep: frequency, complex amplitude and the uncertainties of both."""
    curves = [*amplitudes.values(), *phases.values()]
    low = max(curve.points[:, 0].min() for curve in curves)
    high = min(curve.points[:, 0].max() for curve in curves)
    first = amplitudes[bodies[0]]
    chosen = _spread(first.points, (first.points[:, 0] >= low) & (first.points[:, 0] <= high))
    if not chosen.size:
        raise CalibError(f"the curves {_of(sweep)} share no frequency; are their units and axes right?")
    if sweep.direction * (first.points[chosen[-1], 0] - first.points[chosen[0], 0]) < 0.0:
        chosen = chosen[::-1]
    frequency, total = first.points[chosen, 0], _total(first)[chosen]
    amplitude, sigma = [], []
    for body in bodies:
        own = amplitudes[body]
        size, spread = (first.points[chosen, 1], total[:, 1]) if own is first else _at(own, frequency, sweep)
        turn, uncertain = np.ones(size.size, dtype=complex), np.zeros(size.size)
        if phases:
            phase, uncertain = _at(_unwrapped(phases[body]), frequency, sweep)
            turn = np.exp(1j * phase) * (-1j) ** _rates(phases[body], own)
        amplitude.append(size * turn)
        sigma.append(np.sqrt((spread**2 + (size * uncertain) ** 2) / 2.0) if phases else spread)
    tiny = 1e-9 * frequency
    return {
        "frequency": frequency, "frequency_sigma": np.maximum(total[:, 0], tiny), "amplitude": np.array(amplitude),
        "sigma": np.array(sigma),
    }  # fmt: skip


def _rates(phase: Reading, amplitude: Reading) -> int:
    """How often the displacement is differentiated in the motion whose phase is shown."""
    for reading in (phase, amplitude):
        if reading.sweep is not None and reading.sweep.rates is not None:
            return reading.sweep.rates
    return 0


def _unwrapped(phase: Reading) -> Reading:
    """Return a curve of phase [rad] that goes on where its axis begins anew at the other end."""
    frequency, angle = phase.points.T
    return replace(phase, points=np.column_stack([frequency, np.unwrap(angle)]))


def _total(reading: Reading) -> np.ndarray:
    """Standard uncertainty (n, 2) of each point, that of the axes included."""
    return np.asarray(np.sqrt(reading.sigma**2 + (reading.modes**2).sum(axis=0)))


def _spread(points: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Indices of points at equal distances along the curve, all where there are few."""
    where = np.flatnonzero(inside)
    if where.size <= MAX_PRINTED_POINTS:
        return where
    scaled = points[where] / np.where(np.ptp(points, axis=0) > 0.0, np.ptp(points, axis=0), 1.0)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(scaled, axis=0), axis=1))])
    return np.unique(
        where[np.searchsorted(along, np.linspace(0.0, along[-1], MAX_PRINTED_POINTS)).clip(0, where.size - 1)]
    )


def _at(reading: Reading, frequency: np.ndarray, sweep: PrintedSweep) -> tuple[np.ndarray, np.ndarray]:
    """Values (n,) of a curve at frequencies, and their standard uncertainty, that of its frequencies included."""
    own, values = reading.points.T
    turned = own[-1] < own[0]
    own, values, total = (x[::-1] if turned else x for x in (own, values, _total(reading)))
    steady = np.maximum.accumulate(own)
    if (steady - own).max() > MAX_FOLD * np.ptp(own):
        raise CalibError(
            f"the {reading.kind} of {reading.body!r} {_of(sweep)} runs back in frequency, so that it has several "
            "values at one; give each direction of the sweep a curve of its own"
        )
    steady = steady + np.arange(own.size) * 1e-12 * np.ptp(own)
    slope = np.gradient(values, steady) if own.size > 1 else np.zeros(1)
    spread = np.hypot(total[:, 1], np.clip(slope * total[:, 0], -np.ptp(values), np.ptp(values)))
    return np.interp(frequency, steady, values), np.interp(frequency, steady, spread)
