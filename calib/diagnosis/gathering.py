"""Measured records put together with their noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.clock import clock_sensitivity
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.noise import (
    MIN_NOISE_CYCLES,
    STATED,
    Noise,
    Remainder,
    Repeating,
    from_cycles,
    from_residual,
    shared,
    with_autoregression,
)
from calib.diagnosis.noise_profile import noise_profiles
from calib.diagnosis.part import Part
from calib.diagnosis.pure_error import pure_errors
from calib.objective import Reference, row_weights
from calib.objective.outliers import smoothed
from calib.records import is_response, mean_interval
from calib.records.cycles import kind_of_motion, mean_cycle
from calib.records.replicates import levels_of_sweeps
from calib.records.response import SIGMA_SOURCE, stated_sigma


@dataclass(frozen=True, eq=False)
class _ComparedRows:
    """Measured rows of a record beside the simulated ones.

    Attributes
    ----------
    rows : (body, channel) pairs
    measured : (row, n), each in its unit
    mended : (row, n) the same with outliers replaced
    simulated : (row, n)
    used : (row, n) whether a sample is compared
    weight : (row, n) in [0, 1], 0 where a sample is not compared
    """

    rows: Sequence[tuple[str, str]]
    measured: np.ndarray
    mended: np.ndarray
    simulated: np.ndarray
    used: np.ndarray
    weight: np.ndarray

    @property
    def remainder(self) -> Remainder:
        """What the simulation leaves, nothing having been fitted to it."""
        residual = self.mended - self.simulated
        return Remainder(residual, residual, np.zeros((len(residual), 1, 1)), np.zeros(residual.shape))


def cycle_of(reference: Reference) -> int:
    """Periods of the excitation after which a measured motion repeats; 1 where it does not, or is not known to."""
    return 1 if reference.is_swept else kind_of_motion(reference.record).period or 1


def gathered(
    references: Mapping[str, Reference],
    rows: Mapping[str, Sequence[tuple[str, str]]],
    cycle: Mapping[str, int],
    simulated: Mapping[str, SimulatedRows],
    left: Mapping[str, Remainder] | None = None,
    outliers: Mapping[str, np.ndarray] | None = None,
    clocks: Mapping[str, np.ndarray] | None = None,
) -> Evidence:
    """Put measured records and their noise together.

    Parameters
    ----------
    references, rows : by record
    cycle : of each record's motion, in periods
    simulated : by record
    left : what no fit explains, by record, from which the noise of rows without cycles is estimated; None: from what
        the simulations leave
    outliers : record -> (row, n) whether a sample is an outlier; None: none is
    clocks : as `clock_slopes` gives them; None: all clocks are right
    """
    compared = {
        name: _compared(reference, rows[name], simulated[name], None if outliers is None else outliers[name])
        for name, reference in references.items()
    }
    repeating = {name: _repeating(reference, compared[name], cycle[name]) for name, reference in references.items()}
    known = [
        Repeating(interval, noise) for name, noise in repeating.items() if (interval := _interval(references[name]))
    ]
    parts = []
    for name, reference in references.items():
        own, noise = compared[name], repeating[name]
        remainder = own.remainder if left is None else left[name]
        noises = [
            noise[row] if row in noise else _noise_of_row(reference, own, index, known, remainder, left is not None)
            for index, row in enumerate(own.rows)
        ]
        parts.append(
            Part(
                name=name,
                rows=tuple(own.rows),
                time=reference.abscissa,
                measured=own.measured,
                period=reference.period,
                cycle=cycle[name],
                nuisance=tuple(reference.nuisance),
                noise=tuple(noises),
                used=own.used,
                weight=own.weight,
                clock=(clocks or {}).get(name),
                sweep=reference.record["sweep"].values if reference.is_swept else None,
                level=levels_of_sweeps(reference.record) if reference.is_swept else None,
                frequency=reference.record["frequency"].values if reference.is_swept else None,
                sigma_source=str(reference.record.attrs.get(SIGMA_SOURCE, STATED)),
            )
        )
    return Evidence(tuple(parts))


def _compared(
    reference: Reference, rows: Sequence[tuple[str, str]], view: SimulatedRows, outliers: np.ndarray | None
) -> _ComparedRows:
    """Measured rows beside the simulated ones, without outliers (row, n)."""
    measured = _measured(reference, rows)
    good = np.ones(measured.shape, dtype=bool) if outliers is None else ~outliers
    used = _used(view, rows, good)
    weight = row_weights(rows, used, view.trust)
    return _ComparedRows(rows, measured, _mended(measured, view.rows, good), view.rows, used, weight)


def _noise_of_row(
    reference: Reference,
    compared: _ComparedRows,
    index: int,
    known: Sequence[Repeating],
    remainder: Remainder,
    fitted: bool,
) -> Noise:
    """Noise of a row whose cycles do not show it.

    Parameters
    ----------
    index : of the row
    known : noise of the rows whose cycles show it, of each record
    remainder : of this record
    fitted : whether that is what a fit leaves: before anything is fitted to it a residual shows no autocorrelation of
        the noise
    """
    row, weight = compared.rows[index], compared.weight[index]
    samples, interval = (weight, compared.measured[index], _stated(reference.record, row)), _interval(reference)
    ar, profile = None if interval is None else shared(known, row, interval), _stated_profile(reference.record, row)
    if ar is not None:
        noise = with_autoregression(ar, remainder.scaled(index, weight, ar) / profile, *samples)
    elif fitted:
        if reference.is_swept and samples[2] is None:
            profile = noise_profiles(compared.rows, compared.measured, compared.weight, remainder)[index]
        noise = from_residual(remainder.rows[index], *samples, remainder.absorbed[index], profile)
    else:
        noise = with_autoregression(np.zeros(0), remainder.rows[index] / profile, *samples)
        noise = replace(noise, repeated=False)
    return replace(noise, profile=profile).within(remainder.whole[index], weight)


def _used(simulated: SimulatedRows, rows: Sequence[tuple[str, str]], good: np.ndarray) -> np.ndarray:
    """Whether samples (row, n) are compared: those that are good, of rows that the excitation does not prescribe."""
    return np.array([row not in simulated.given for row in rows], dtype=bool)[:, None] & good


def _mended(measured: np.ndarray, simulated: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Measured rows (row, n) with outliers replaced by the simulation and the median residual about them."""
    residual = measured - simulated
    return np.where(good, measured, simulated + smoothed(residual))


def _measured(reference: Reference, rows: Sequence[tuple[str, str]]) -> np.ndarray:
    """Measured rows (row, n), each in its unit."""
    record = reference.compared
    bodies = [str(body) for body in record.body.values]
    return np.array([record[channel].values[bodies.index(body)] for body, channel in rows])


def _repeating(reference: Reference, compared: _ComparedRows, cycle: int) -> dict[tuple[str, str], Noise]:
    """Noise of the rows whose cycles show it: what the mean cycle of the residual leaves; or whose replicates do.

    A model error is periodic, and in the mean cycle; or it changes slowly, and is no noise either.
    """
    residual, rows, weight = compared.mended - compared.simulated, compared.rows, compared.weight
    period, time, record = reference.period, reference.abscissa, reference.record
    if reference.is_swept and rows:
        return pure_errors(record, rows, compared.mended, residual, weight, _stated(record, rows[0]))
    if period is None or not rows or time[-1] - time[0] < MIN_NOISE_CYCLES * cycle * period:
        return {}
    mean = mean_cycle(time, residual, period, cycle, weight=weight)
    changes = _slow_changes(time, compared.simulated)
    slow = [mean_cycle(time, change, period, cycle, weight=weight).residual for change in changes]
    about = zip(rows, mean.residual, weight, compared.mended, np.stack(slow, axis=2), strict=True)
    found: dict[tuple[str, str], Noise] = {}
    for row, left, w, values, own in about:
        profile = _stated_profile(record, row)
        if w.any():
            own = own / np.reshape(profile, (-1, 1))
            noise = from_cycles(left / profile, w, values, mean.parameters, _stated(record, row), (own[:, :1], own))
            found[row] = replace(noise, profile=profile)
    return found


def _slow_changes(time: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Changes (row, n) of a motion in proportion to time: of its phase, its frequency, its amplitude and its zero."""
    passed, clock = time - time[0], clock_sensitivity(time, rows)
    return [clock, passed * clock, passed * rows, np.broadcast_to(passed, rows.shape)]


def _interval(reference: Reference) -> float | None:
    """Sampling interval of a record [s]; None of a frequency response."""
    return None if reference.is_swept else mean_interval(reference.record)


def _stated(record: xr.Dataset, row: tuple[str, str]) -> float | None:
    """Standard deviation of the noise that a record states of a row; None where it states none  [unit of the row]."""
    if is_response(record):
        return None if stated_sigma(record, row[1]) is None else 1.0
    sigma = _stated_sigma(record, row)
    return None if sigma is None else float(np.sqrt(np.mean(sigma**2)))


def _stated_profile(record: xr.Dataset, row: tuple[str, str]) -> np.ndarray | float:
    """Standard deviation (n,) of each sample's noise over the rms one, where the record states one of each; else 1."""
    sigma = _stated_sigma(record, row)
    if sigma is None or not np.ptp(sigma) > 0.0:
        return 1.0
    return sigma / float(np.sqrt(np.mean(sigma**2)))


def _stated_sigma(record: xr.Dataset, row: tuple[str, str]) -> np.ndarray | None:
    """Standard deviation, () or of each sample (n,), that a record states of a row [its unit], else None."""
    body, channel = row
    if f"{channel}_sigma" not in record:
        return None
    index = [str(b) for b in record.body.values].index(body)
    return np.asarray(record[f"{channel}_sigma"].values[index])
