"""Frequency responses from time records of a stepped or a swept sine: order tracking of the excitation.

The record is cut into windows of whole cycles of the excitation. In each a motion x is

    x(t) = Re((c_0 P_0(s) + c_1 P_1(s) + c_2 P_2(s)) exp(i phi(t))) + mean + harmonics,

phi the phase of the excitation, P_j Legendre polynomials over the window, s from -1 to 1, fitted by least squares (the
Vold-Kalman filter has the same signal model: Vold & Leuridan, SAE paper 931288 (1993)). The response is its
value in the middle over that of the excitation. Higher harmonics that are asked for have polynomials of their own about
k times the phase, to which theirs are related. The polynomials of orders 3 to 8 are fitted too: what they amount to is
noise near the frequency of the excitation, whatever its spectrum elsewhere - hum, harmonics, another mode - and tells
the standard uncertainty, as tapers do of a spectral estimate (Thomson, Proceedings of the IEEE 70 (1982) 1055).

A frequency response is that of steady motion. Behind a sweep of the rate w' [rad/s^2] a linear system lags: under the
level A it shows H A - i w' (H'' A + 2 H' A') / 2, with derivatives by w (Carson & Fry, Bell System Technical Journal 16
(1937) 513). The size of that term is part of the uncertainty, and where it exceeds the noise a warning says so; where
it is a large part of the response, the point is left out. On a step, what the motion still changes in the window is
part of the uncertainty. A higher harmonic lags by its own second derivative, and with the first one, whose phase error
it has k times.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records.motion_unit import MOTIONS
from calib.records.order_tracking_sweeps import (
    MIN_SLOW_VARIANCE_RATIO,
    MIN_SWEEP_POINTS,
    rests_between_steps,
    series_of_steps,
    steps,
    sweeps_of_windows,
)
from calib.records.order_tracking_windows import (
    DRIFT_VARIANCE,
    LEAST_LEVEL_CHANGE,
    MIN_CHANGE_STD,
    VALUE_VARIANCE,
    TrackedHarmonic,
    TrackedWindow,
    windows_of_cycles,
)
from calib.records.record import prescribed
from calib.records.response import HIGHEST_ORDER, LEVEL_UNITS, SIGMA_SOURCE, check_response, make_response
from calib.units import plain_number

STEPPED, SWEPT = "stepped", "swept"
Sine = Literal["stepped", "swept"]
MIN_CYCLES_OF_HARMONICS = 10  # in a window of which higher ones are tracked: their polynomials overlap in fewer
CYCLES = 20  # of the excitation in a window, where none is stated  [count]
SMOOTHED_WINDOWS = 5  # of a sweep over which the variance of the noise is averaged  [count]
CURVATURE_POINTS = 5  # of which the second derivative of a response is determined  [count]
MAX_LEVEL_DEPARTURE = 3.0  # mean square of the departures of constant levels, over their variance  [1]
MAX_LAG_SHARE = 0.2  # of the response that it may lag behind a sweep, in a point of it  [1]
MAX_STEP_SHARE = 0.5  # of the response by which it may change from point to point of a sweep  [1]
MAX_DRIVEN_SHARE = 0.1  # of the excitation that a harmonic may be, over what it is of the motion  [1]
MAX_LAG = 3.0  # of the response behind a sweep, over its noise, above which a warning says so  [1]
MAX_CLOCK_DEPARTURE = 0.3  # of the instants from equal intervals, over one  [1]


def tracked(record: xr.Dataset, sine: Sine, cycles: int = CYCLES, highest: int = 1) -> xr.Dataset:
    """Return the frequency response that a time record of a stepped or swept sine shows.

    Parameters
    ----------
    record : over time at a constant interval, with its excitation and the `place` and `quantity` of it; of each body
        the displacement is taken, or else the velocity, or else the acceleration
    cycles : of the excitation in a window; of a step its last window is taken, of a sweep one after the other
    highest : harmonic of the motion that the response has

    Returns
    -------
    A sweep is what goes in one direction; their levels are constant where they do not vary by more than noise

    Raises
    ------
    CalibError : orders or cycles that cannot be tracked, no excitation, an interval that varies, or too few windows in
        which the excitation is one such sine
    """
    where = str(record.attrs.get("source", "the record")).partition(",")[0]
    if not 1 <= highest <= HIGHEST_ORDER:
        raise CalibError(f"{where}: harmonics are tracked up to an order from 1 to {HIGHEST_ORDER}, got {highest}")
    if highest > 1 and cycles < MIN_CYCLES_OF_HARMONICS:
        raise CalibError(
            f"{where}: higher harmonics are tracked in windows of {MIN_CYCLES_OF_HARMONICS} cycles or more, got "
            f"{cycles}; take more cycles, or the first harmonic alone"
        )
    time, drive, rows = _signals(record, where)
    motions = np.array([row for row, _ in rows.values()])
    windows = windows_of_cycles(time, drive, motions, cycles, sine == STEPPED, highest)
    used = steps(windows) if sine == STEPPED else []
    if rests_between_steps(used):
        text = "the excitation stops between the steps until the motion is at rest; a sweep is said to go on over that"
        warnings.warn(f"{where}: {text}", stacklevel=2)
        used = [replace(one, start=0) for one in used]
    runs = sweeps_of_windows(windows) if sine == SWEPT else series_of_steps(used)
    if not runs:
        raise CalibError(
            f"{where}: the excitation is one sine in {len(windows)} windows of {cycles} cycles, but no "
            f"{MIN_SWEEP_POINTS} of them are a {sine} sine one after the other"
            f"{' (a step needs three windows)' if sine == STEPPED else ''}; mend sine, take other cycles, "
            f"{'fewer harmonics, ' if highest > 1 else ''}or a record that is sampled faster"
        )
    lost = len(used) - sum(map(len, runs))
    if lost and sine == STEPPED:
        text = f"{lost} of {len(used)} steps are left out, which are no {MIN_SWEEP_POINTS} in one direction"
        warnings.warn(f"{where}: {text}", stacklevel=2)
    return _assembled(record, runs, [rates for _, rates in rows.values()], list(rows), sine, where)


def _signals(
    record: xr.Dataset, where: str
) -> tuple[np.ndarray, np.ndarray, Mapping[str, tuple[np.ndarray, int]]]:  # fmt: skip
    """Time (n,), excitation (n,), and of each body a motion (n,) with the number of its differentiations."""
    if "excitation" not in record or record["excitation"].attrs.get("units") not in LEVEL_UNITS:
        raise CalibError(f"{where}: tracking needs a recorded excitation, a force or a displacement")
    time = record["time"].values
    uniform = np.linspace(time[0], time[-1], time.size)
    if time.size < 2 or np.abs(time - uniform).max() > MAX_CLOCK_DEPARTURE * (uniform[1] - uniform[0]):
        raise CalibError(
            f"{where}: tracking needs samples at a constant interval; state the rate of the clock in the place of "
            "time, or resample the record"
        )
    if not np.isfinite(record["excitation"].values).all():
        raise CalibError(f"{where}: the excitation holds NaN or infinity; cut those samples off")
    given = {body for body, channel in prescribed(record) if channel == "displacement"}
    rows: dict[str, tuple[np.ndarray, int]] = {}
    for body in (body for body in map(str, record["body"].values) if body not in given):
        for rates, channel in enumerate(MOTIONS):
            values = record[channel].sel(body=body).values if channel in record else np.full(time.size, np.nan)
            if np.isfinite(values).all():
                rows[body] = values, rates
                break
        else:
            raise CalibError(f"{where}: body {body!r} has none of {', '.join(MOTIONS)} without gaps")
    if not rows:
        raise CalibError(f"{where}: the excitation prescribes the motion of all bodies; measure another one")
    return time, record["excitation"].values, rows


def _assembled(
    record: xr.Dataset, runs: Sequence[Sequence[TrackedWindow]], rates: Sequence[int], bodies: Sequence[str],
    sine: Sine, where: str,
) -> xr.Dataset:  # fmt: skip
    """Return the response of the windows of all sweeps."""
    points: list[tuple[np.ndarray, ...]] = []
    for number, run in enumerate(runs):
        frequency = np.array([one.frequency for one in run])
        per_motion = 1.0 / (2j * math.pi * frequency) ** np.array(rates)[:, None]  # displacement of a velocity, ...
        amplitude = np.array([one.response for one in run]).T * per_motion
        variance, level = _smoothed(np.array([one.variance for one in run]).T), np.array([one.level for one in run])
        noise = (variance[1:] + np.abs(amplitude / per_motion / level) ** 2 * variance[0]) * np.abs(per_motion) ** 2
        noise = np.maximum(noise, np.finfo(float).tiny)
        if sine == SWEPT:
            further = _lag(run, amplitude, VALUE_VARIANCE * noise)
            kept = _is_quasi_steady(amplitude, further, VALUE_VARIANCE * noise)
            _warn_of_lag(where, run, kept, np.sqrt(further / (2.0 * VALUE_VARIANCE * noise)).max(axis=0))
        else:
            further, kept = _departure(run, per_motion, noise), np.ones(len(run), dtype=bool)
        higher = _higher(run, rates, amplitude, variance[0], further, sine)
        _warn_of_driven_harmonics(where, run, amplitude, higher[0], variance[0])
        if np.count_nonzero(kept) < MIN_SWEEP_POINTS:
            continue
        sigma = np.sqrt(VALUE_VARIANCE * noise + further / 2.0)
        floor = np.finfo(float).eps * np.abs(amplitude).max(axis=1, keepdims=True)
        one = (
            frequency, amplitude, _levels(run, variance[0]), np.full(frequency.size, float(number)),
            np.full(frequency.size, np.sign(frequency[-1] - frequency[0])), np.maximum(sigma, floor),
            np.maximum([one.frequency_sigma for one in run], np.finfo(float).eps * frequency),
            higher[0], np.maximum(higher[1], floor),
        )  # fmt: skip
        points.append(tuple(values[..., kept] for values in one))
    if not points:
        raise CalibError(f"{where}: every sweep is too fast to be a frequency response; compare the record over time")
    frequency, amplitude, level, sweep, direction, sigma, frequency_sigma, higher_amplitude, higher_sigma = (
        np.concatenate(own, axis=-1) for own in zip(*points, strict=True)
    )
    attrs = {key: record.attrs[key] for key in ("place", "quantity", "source") if key in record.attrs}
    attrs[SIGMA_SOURCE] = "estimated by order tracking"
    made = make_response(
        frequency, bodies, amplitude, level, str(record["excitation"].attrs["units"]), sweep, direction,
        sigma=sigma, frequency_sigma=frequency_sigma, higher=dict(enumerate(higher_amplitude, 2)),
        higher_sigma=dict(enumerate(higher_sigma, 2)), **attrs,
    )  # fmt: skip
    return check_response(made, where)


def _higher(
    run: Sequence[TrackedWindow], rates: Sequence[int], first: np.ndarray, of_drive: np.ndarray, further: np.ndarray,
    sine: Sine,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Complex amplitudes (order, row, point) of higher harmonics, and the standard uncertainty of either part  [m].

    first, further : (row, point) first harmonic, and the square of what it departs from steady motion by  [m], [m^2]
    of_drive : (point,) variance of the noise of the excitation
    """
    frequency, level = np.array([one.frequency for one in run]), np.array([one.level for one in run])
    shape = len(run[0].harmonics), *first.shape
    amplitudes, sigmas = np.zeros(shape, dtype=complex), np.zeros(shape)
    for k, order in enumerate(own.order for own in run[0].harmonics):
        windows = [one.harmonics[k] for one in run]
        per_motion = 1.0 / (2j * math.pi * order * frequency) ** np.array(rates)[:, None]
        own = np.array([one.response for one in windows]).T * per_motion
        noise = _smoothed(np.array([one.variance for one in windows]).T) * np.abs(per_motion) ** 2
        noise = np.maximum(noise + np.abs(order * own / level) ** 2 * of_drive, np.finfo(float).tiny)
        if sine == SWEPT:
            with_first = np.divide(np.abs(own), np.abs(first), out=np.zeros(own.shape), where=np.abs(first) > 0.0)
            departure = _lag(run, own, VALUE_VARIANCE * noise) + (order * with_first) ** 2 * further
        else:
            departure = _departure(windows, per_motion, noise)
        amplitudes[k], sigmas[k] = own, np.sqrt(VALUE_VARIANCE * noise + departure / 2.0)
    return amplitudes, sigmas


def _warn_of_driven_harmonics(
    where: str, run: Sequence[TrackedWindow], first: np.ndarray, higher: np.ndarray, variance: np.ndarray
) -> None:
    """Say which higher harmonics the excitation has itself, to which a linear structure responds.

    Where their share of the level, beyond noise, is more than a tenth of what a harmonic of a motion is of its first.

    first, higher : (row, point) and (order, row, point) complex amplitudes of the motions  [m]
    variance : (point,) of the noise of the excitation
    """
    level = math.sqrt(np.mean([one.level**2 for one in run]))
    noise = math.sqrt(2.0 * VALUE_VARIANCE * float(np.mean(variance)))
    of_first = np.sqrt(np.mean(np.abs(first) ** 2, axis=-1))
    texts = []
    for k, own in enumerate(higher):
        driven = math.sqrt(np.mean([one.harmonics[k].level ** 2 for one in run]))
        share = np.sqrt(np.mean(np.abs(own) ** 2, axis=-1)) / of_first
        if driven > MIN_CHANGE_STD * noise and driven / level > MAX_DRIVEN_SHARE * share.min():
            texts.append(f"{plain_number(100.0 * driven / level, 2)} % of harmonic {k + 2}")
    if texts:
        warnings.warn(
            f"{where}: the excitation itself has {' and '.join(texts)}, to which a linear structure responds, and a "
            "simulation is driven by a sine; add the effects drive_harmonic_2 and drive_harmonic_3, or track the first "
            "harmonic alone",
            stacklevel=4,
        )


def _smoothed(variance: np.ndarray) -> np.ndarray:
    """Variance (row, point) averaged over neighbouring windows: one of them alone has few degrees of freedom."""
    n = variance.shape[1]
    width = min(SMOOTHED_WINDOWS, n)
    begin = np.clip(np.arange(n) - width // 2, 0, n - width)
    sums = np.concatenate([np.zeros((len(variance), 1)), np.cumsum(variance, axis=1)], axis=1)
    return np.asarray((sums[:, begin + width] - sums[:, begin]) / width)


def _levels(run: Sequence[TrackedWindow], variance: np.ndarray) -> np.ndarray:
    """Levels (point,) of a sweep: their mean where they do not vary by more than scatter and noise (point,) of them."""
    level = np.array([one.level for one in run])
    mean, chance = float(level.mean()), float(np.mean(VALUE_VARIANCE * variance + [one.scatter[0] for one in run]))
    if np.mean((level - mean) ** 2) < max(MAX_LEVEL_DEPARTURE * chance, (LEAST_LEVEL_CHANGE * mean) ** 2):
        return np.full(level.size, mean)
    return level


def _departure(
    run: Sequence[TrackedWindow] | Sequence[TrackedHarmonic], per_motion: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """Mean square of the departure (row, point) of steps from steady motion, less what this noise makes of it.

    The larger of their drift within the window and of their scatter over the windows of the step, in which slow beating
    with a hum is.
    """
    drift = np.abs(np.array([one.drift for one in run]).T * per_motion) ** 2
    scatter = np.array([one.scatter[-len(per_motion) :] for one in run]).T * np.abs(per_motion) ** 2
    by_noise = ((drift, 2.0 * DRIFT_VARIANCE * noise), (scatter, 2.0 * VALUE_VARIANCE * noise))
    return np.maximum(
        *(np.where(own > MIN_SLOW_VARIANCE_RATIO * chance, own - chance, 0.0) for own, chance in by_noise)
    )


def _lag(run: Sequence[TrackedWindow], amplitude: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Square of the lag (row, point) of the response behind a sweep, less what noise of this variance makes of it."""
    omega = 2.0 * math.pi * np.array([one.frequency for one in run])
    rate, level = np.gradient(omega, [one.time for one in run]), np.array([one.level for one in run])
    square = np.zeros(amplitude.shape)
    for k in range(omega.size):
        own, curvature = _curvature(omega, k, rate[k] ** 2 / (2.0 * variance[:, k].min()), variance)
        half = amplitude[:, own] @ curvature - amplitude[:, k] / level[k] * (level[own] @ curvature)
        chance = 2.0 * variance[:, own] @ curvature**2
        square[:, k] = rate[k] ** 2 * np.maximum(0.0, np.abs(half) ** 2 - chance)
    return square


def _curvature(omega: np.ndarray, k: int, weight: float, variance: np.ndarray) -> tuple[slice, np.ndarray]:
    """Points about the k-th of a sweep, and factors (n,) that make of values there half of their second derivative.

    As few points as determine it so well that its error, times a weight, is below 1.

    variance : (row, point) of either part of the values
    """
    n, width = omega.size, min(CURVATURE_POINTS, omega.size)
    while True:
        begin = min(max(0, k - width // 2), n - width)
        own = slice(begin, begin + width)
        span = np.abs(omega[own] - omega[k]).max()
        factors = np.linalg.pinv(np.vander((omega[own] - omega[k]) / span, 3))[0] / span**2
        if width == n or weight * 2.0 * (variance[:, own] @ factors**2).max() < 1.0:
            return own, factors
        width = min(n, 2 * width)


def _is_quasi_steady(amplitude: np.ndarray, lag: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Whether a response (row, point) of a sweep is nearly that of steady motion, by point.

    Where its lag, of this square, is a large part of it, or where it changes by such a part from point to point, the
    expansion does not hold: at a jump, and where the sweep is too fast. What noise may do is no such change.

    variance : (row, point) of the noise of either part
    """
    size, step = np.abs(amplitude), np.abs(np.diff(amplitude, axis=1))
    chance = MIN_CHANGE_STD * np.sqrt(2.0 * variance)
    off = np.sqrt(lag) > MAX_LAG_SHARE * size + chance
    jumps = step > MAX_STEP_SHARE * np.maximum(size[:, :-1], size[:, 1:]) + np.hypot(chance[:, :-1], chance[:, 1:])
    off[:, :-1] |= jumps
    off[:, 1:] |= jumps
    return ~off.any(axis=0)


def _warn_of_lag(where: str, run: Sequence[TrackedWindow], kept: np.ndarray, ratio: np.ndarray) -> None:
    """Say where a response lags behind a sweep, by this ratio (point,) to its noise, and what was left out."""
    way = "up" if run[-1].frequency > run[0].frequency else "down"

    def between(there: np.ndarray) -> str:
        low, high = sorted(
            (run[int(np.flatnonzero(there)[0])].frequency, run[int(np.flatnonzero(there)[-1])].frequency)
        )
        return f"{low:.5g} to {high:.5g} Hz"

    texts = []
    behind = kept & (ratio > MAX_LAG)
    if behind.any():
        texts.append(
            f"from {between(behind)} the response lags behind the sweep, by up to "
            f"{plain_number(float(ratio[behind].max()), 2)} times its noise, and its uncertainty is that large"
        )
    if not kept.all():
        texts.append(
            f"{np.count_nonzero(~kept)} of {kept.size} points, from {between(~kept)}, are left out, where it jumps or "
            "the sweep is too fast"
        )
    if texts:
        rate = abs(run[-1].frequency - run[0].frequency) / (run[-1].time - run[0].time)
        warnings.warn(
            f"{where}, sweep {way} at {rate:.2g} Hz/s: {'; '.join(texts)}. A record over time, without tracking, is "
            "compared as fast as it is",
            stacklevel=4,
        )
