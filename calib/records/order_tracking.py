"""Frequency responses from time records of a stepped or a swept sine: order tracking of the excitation.

The record is cut into windows of whole cycles of the excitation. In each a motion x is

    x(t) = Re((c_0 P_0(s) + c_1 P_1(s) + c_2 P_2(s)) exp(i phi(t))) + mean + harmonics,

phi the phase of the excitation, P_j Legendre polynomials over the window, s from -1 to 1, fitted by least squares (the
Vold-Kalman filter has the same signal model: Vold & Leuridan, SAE paper 931288 (1993)). The response is its
value in the middle over that of the excitation. The polynomials of orders 3 to 8 are fitted too: what they amount to is
noise near the frequency of the excitation, whatever its spectrum elsewhere - hum, harmonics, another mode - and tells
the standard uncertainty, as tapers do of a spectral estimate (Thomson, Proceedings of the IEEE 70 (1982) 1055).

A frequency response is that of steady motion. Behind a sweep of the rate w' [rad/s^2] a linear system lags: under the
level A it shows H A - i w' (H'' A + 2 H' A') / 2, with derivatives by w (Carson & Fry, Bell System Technical Journal 16
(1937) 513). The size of that term is part of the uncertainty, and where it exceeds the noise a warning says so; where
it is a large part of the response, the point is left out. On a step, what the motion still changes in the window is
part of the uncertainty.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr
from numpy.polynomial import legendre, polynomial
from scipy.fft import next_fast_len
from scipy.signal import hilbert

from calib.errors import CalibError
from calib.records.motion_unit import MOTIONS
from calib.records.record import prescribed
from calib.records.response import LEVEL_UNITS, check_response, make_response
from calib.units import plain_number

STEPPED, SWEPT = "stepped", "swept"
Sine = Literal["stepped", "swept"]
CYCLES = 20  # of the excitation in a window, where none is stated  [count]
SIGNAL_ORDERS, NOISE_ORDERS = 3, 6  # Legendre polynomials of the motion, and of the noise beside it  [count]
ORDERS_BESIDE = range(2, 6)  # that are fitted beside the motion
PHASE_DEGREE = SIGNAL_ORDERS - 1  # of the phase of the excitation over a window
MIN_SAMPLES_PER_UNKNOWN = 2  # in a window
NYQUIST_SHARE = 0.9  # of the Nyquist frequency, to which a harmonic is fitted  [1]
MAX_DRIVE_RESIDUAL = 0.3  # rms of the excitation beside one sine, over that sine's, in a window that is used  [1]
LEAST_CHANGE = 2e-5  # of a frequency, relative, from which it changes  [1]
MIN_CHANGE_STD = 5.0  # of a frequency, over its standard error, from which it changes  [1]
SMOOTHED_WINDOWS = 5  # of a sweep over which the variance of the noise is averaged  [count]
MAX_RATE_CHANGE = 3.0  # of a sweep, from window to window  [1]
MAX_LEVEL_STEP = 0.1  # of levels that are nearly the same, relative  [1]
LEAST_DRIFT = 4.0  # of the square of a drift in a step, over its mean by noise, above which it is one  [1]
CURVATURE_POINTS = 5  # of which the second derivative of a response is determined  [count]
MIN_SWEEP_POINTS = 4  # of a sweep, or of a series of steps in one direction  [count]
MAX_LEVEL_DEPARTURE = 3.0  # mean square of the departures of constant levels, over their variance  [1]
MIN_LEVEL_VARIATION = 1e-3  # relative, of levels that vary  [1]
MAX_LAG_SHARE = 0.2  # of the response that it may lag behind a sweep, in a point of it  [1]
MAX_STEP_SHARE = 0.5  # of the response by which it may change from point to point of a sweep  [1]
MAX_LAG = 3.0  # of the response behind a sweep, over its noise, above which a warning says so  [1]
VALUE_VARIANCE = 1.0 + 5.0 / 4.0  # of c_0 - c_2 / 2, the value in the middle of a window, over that of c_0  [1]
DRIFT_VARIANCE = 3.0  # of c_1, the change over half of a window, over that of c_0  [1]
MAX_CLOCK_DEPARTURE = 0.3  # of the instants from equal intervals, over one  [1]


@dataclass(frozen=True, eq=False)
class _Window:
    """A window in which the excitation is one sine.

    Attributes
    ----------
    number : among all windows of the record
    time : of its middle  [s]
    frequency, frequency_sigma : of the excitation in the middle, and its standard uncertainty  [Hz]
    level : amplitude of the excitation
    response : (row,) complex amplitude of each motion before the excitation
    drift : (row,) its change over half of the window
    variance : (1 + row,) of the noise of either part of a polynomial's coefficient, over 2 j + 1 of the j-th one, of
        the excitation and of each motion
    """

    number: int
    time: float
    frequency: float
    frequency_sigma: float
    level: float
    response: np.ndarray
    drift: np.ndarray
    variance: np.ndarray

    def step_to(self, other: "_Window", noise: float) -> float:
        """Direction of the frequency from this window to another, 0 where it is no more than noise [Hz] of either."""
        step = other.frequency - self.frequency
        least = max(MIN_CHANGE_STD * math.sqrt(2.0) * noise, LEAST_CHANGE * self.frequency)
        return float(np.sign(step)) if abs(step) > least else 0.0

    def has_level_of(self, other: "_Window") -> bool:
        """Whether the level of another window is nearly the same."""
        return abs(self.level - other.level) < MAX_LEVEL_STEP * max(self.level, other.level)


def tracked(record: xr.Dataset, sine: Sine, cycles: int = CYCLES) -> xr.Dataset:
    """Return the frequency response that a time record of a stepped or swept sine shows.

    Parameters
    ----------
    record : over time at a constant interval, with its excitation and the `place` and `quantity` of it; of each body
        the displacement is taken, or else the velocity, or else the acceleration
    cycles : of the excitation in a window; of a step its last window is taken, of a sweep one after the other

    Returns
    -------
    A sweep is what goes in one direction; their levels are constant where they do not vary by more than noise

    Raises
    ------
    CalibError : no excitation, an interval that varies, or too few windows in which the excitation is one such sine
    """
    where = str(record.attrs.get("source", "the record")).partition(",")[0]
    time, drive, rows = _signals(record, where)
    windows = _windows(time, drive, np.array([row for row, _ in rows.values()]), cycles)
    noise = float(np.median([one.frequency_sigma for one in windows])) if windows else 0.0
    used = _moving(windows, noise) if sine == SWEPT else _last_of_each_step(windows, noise)
    runs = _sweeps(used) if sine == SWEPT else _series(used, noise)
    if not runs:
        raise CalibError(
            f"{where}: the excitation is one sine in {len(windows)} windows of {cycles} cycles, but no "
            f"{MIN_SWEEP_POINTS} of them are a {sine} sine one after the other"
            f"{' (a step needs three windows)' if sine == STEPPED else ''}; mend sine, take other cycles, or a record "
            "that is sampled faster"
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


def _windows(time: np.ndarray, drive: np.ndarray, rows: np.ndarray, cycles: int) -> list[_Window]:
    """Windows of so many cycles in which the excitation is one sine, in order."""
    centred = drive - drive.mean()
    phase = np.unwrap(np.angle(hilbert(centred, next_fast_len(centred.size))[: centred.size]))
    advanced = np.maximum.accumulate(phase) / (2.0 * math.pi * cycles)
    edges = np.searchsorted(advanced, np.arange(math.ceil(advanced[0]), math.floor(advanced[-1]) + 1))
    found = []
    for number, (begin, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        own = slice(begin, end)
        window = _window(number, time[own], phase[own], np.vstack([drive[own], rows[:, own]]), cycles)
        if window is not None:
            found.append(window)
    return found


def _window(number: int, time: np.ndarray, phase: np.ndarray, rows: np.ndarray, cycles: int) -> _Window | None:
    """Fit a window of the excitation and the motions (1 + row, n); None where the excitation is no sine in it.

    phase : (n,) of the excitation's analytic signal, which noise disturbs
    """
    harmonics = [k for k in ORDERS_BESIDE if k * cycles < NYQUIST_SHARE * 0.5 * time.size]
    unknowns = 2 * (SIGNAL_ORDERS + NOISE_ORDERS + len(harmonics)) + 1
    if time.size < MIN_SAMPLES_PER_UNKNOWN * unknowns or 2 * cycles > NYQUIST_SHARE * time.size:
        return None
    half = 0.5 * (time[-1] - time[0])
    s = (time - time[0]) / half - 1.0
    turn = polynomial.polyfit(s, phase, PHASE_DEGREE)
    for last in (False, True):
        columns = _columns(s, polynomial.polyval(s, turn), harmonics)
        solved = rows if last else rows[:1]
        fitted = np.linalg.lstsq(columns, solved.T, rcond=None)[0]
        orders = SIGNAL_ORDERS + NOISE_ORDERS
        c = (fitted[: 2 * orders : 2] + 1j * fitted[1 : 2 * orders : 2]).T
        if not last:  # the phase with what the fit shows of it
            ahead = np.unwrap(np.angle(legendre.legval(s, c[0, :SIGNAL_ORDERS])))
            turn = polynomial.polyfit(s, polynomial.polyval(s, turn) + ahead, PHASE_DEGREE)
    left = rows[0] - columns @ fitted[:, 0]
    weight = 2.0 * np.arange(SIGNAL_ORDERS, orders) + 1.0
    variance = np.mean(np.abs(c[:, SIGNAL_ORDERS:]) ** 2 / weight, axis=1) / 2.0
    middle = c[:, 0] - 0.5 * c[:, 2]
    level = float(abs(middle[0]))
    beside = np.sqrt(np.mean(left**2) + np.sum(np.abs(c[0, SIGNAL_ORDERS:]) ** 2) / 2.0)
    if not math.sqrt(2.0) * beside < MAX_DRIVE_RESIDUAL * level:
        return None
    slope = c[0, 1] / middle[0]
    noise = math.sqrt(variance[0]) / level
    before = np.conj(middle[0]) / level
    return _Window(
        number=number, time=float(time[0] + half),
        frequency=float(turn[1] + slope.imag) / (2.0 * math.pi * half),
        frequency_sigma=math.sqrt(DRIFT_VARIANCE) * noise / (2.0 * math.pi * half),
        level=level,
        response=middle[1:] * before,
        drift=(c[1:, 1] - middle[1:] * slope) * before,
        variance=variance,
    )  # fmt: skip


def _columns(s: np.ndarray, phase: np.ndarray, harmonics: Sequence[int]) -> np.ndarray:
    """Columns (n, k): real and imaginary part of each polynomial's coefficient, the mean, and harmonics."""
    shapes = legendre.legvander(s, SIGNAL_ORDERS + NOISE_ORDERS - 1)
    both = np.stack([shapes * np.cos(phase)[:, None], -shapes * np.sin(phase)[:, None]], axis=2)
    further = [part(k * phase) for k in harmonics for part in (np.cos, np.sin)]
    return np.column_stack([both.reshape(s.size, -1), np.ones(s.size), *further])


def _last_of_each_step(windows: Sequence[_Window], noise: float) -> list[_Window]:
    """Last window of each step, where the motion has settled longest: like the window before it."""
    pairs = zip(windows[:-1], windows[1:], strict=True)
    steady = [w for before, w in pairs if not before.step_to(w, noise) and w.has_level_of(before)]
    return [
        one
        for one, after in zip(steady, [*steady[1:], None][: len(steady)], strict=True)
        if after is None or one.step_to(after, noise) or not one.has_level_of(after) or after.number - one.number > 1
    ]


def _series(steps: Sequence[_Window], noise: float) -> list[list[_Window]]:
    """Series of steps in one direction; several levels at each frequency are as many series."""
    at_one_frequency: list[list[_Window]] = []
    for one in steps:
        if not at_one_frequency or at_one_frequency[-1][-1].step_to(one, noise):
            at_one_frequency.append([])
        at_one_frequency[-1].append(one)
    levels = int(np.median([len(own) for own in at_one_frequency])) if at_one_frequency else 0
    if levels > 1:
        return [
            run for k in range(levels) for run in _one_way([own[k] for own in at_one_frequency if k < len(own)], noise)
        ]
    return _one_way(steps, noise)


def _one_way(steps: Sequence[_Window], noise: float) -> list[list[_Window]]:
    """Runs of steps whose frequency goes on in one direction."""
    runs, way = [list(steps[:1])], 0.0
    for before, one in zip(steps[:-1], steps[1:], strict=True):
        step = before.step_to(one, noise)
        if not step or (way and step != way):
            runs.append([])
            step = 0.0
        runs[-1].append(one)
        way = step
    return [run for run in runs if len(run) >= MIN_SWEEP_POINTS]


def _moving(windows: Sequence[_Window], noise: float) -> list[_Window]:
    """Windows whose neighbours differ in frequency: without those where the excitation waits, or turns."""
    ends = zip([windows[0], *windows[:-1]], windows, [*windows[1:], windows[-1]], strict=True) if windows else ()
    return [one for before, one, after in ends if before.step_to(after, noise)]


def _sweeps(windows: Sequence[_Window]) -> list[list[_Window]]:
    """Runs of windows whose frequency goes on in one direction at about one rate, over windows that are missing too."""
    runs = [list(windows[:1])]
    for one in windows[1:]:
        run = runs[-1]
        step = (one.frequency - run[-1].frequency) / (one.time - run[-1].time)
        pairs = zip(run[-4:-1], run[-4:][1:], strict=True)
        before = [(b.frequency - a.frequency) / (b.time - a.time) for a, b in pairs]
        ratio = step / float(np.median(before)) if before else 1.0
        if not 1.0 / MAX_RATE_CHANGE < ratio < MAX_RATE_CHANGE:
            runs.append([])
        runs[-1].append(one)
    return [run for run in runs if len(run) >= MIN_SWEEP_POINTS]


def _assembled(
    record: xr.Dataset, runs: Sequence[Sequence[_Window]], rates: Sequence[int], bodies: Sequence[str], sine: Sine,
    where: str,
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
            drift = np.abs(np.array([one.drift for one in run]).T * per_motion) ** 2
            chance = 2.0 * DRIFT_VARIANCE * noise
            further, kept = np.where(drift > LEAST_DRIFT * chance, drift - chance, 0.0), np.ones(len(run), dtype=bool)
        if np.count_nonzero(kept) < MIN_SWEEP_POINTS:
            continue
        sigma = np.sqrt(VALUE_VARIANCE * noise + further / 2.0)
        floor = np.finfo(float).eps * np.abs(amplitude).max(axis=1, keepdims=True)
        one = (
            frequency, amplitude, _levels(level, variance[0]), np.full(frequency.size, float(number)),
            np.full(frequency.size, np.sign(frequency[-1] - frequency[0])), np.maximum(sigma, floor),
            np.maximum([one.frequency_sigma for one in run], np.finfo(float).eps * frequency),
        )  # fmt: skip
        points.append(tuple(values[..., kept] for values in one))
    if not points:
        raise CalibError(f"{where}: every sweep is too fast to be a frequency response; compare the record over time")
    frequency, amplitude, level, sweep, direction, sigma, frequency_sigma = (
        np.concatenate(own, axis=-1) for own in zip(*points, strict=True)
    )
    attrs = {key: record.attrs[key] for key in ("place", "quantity", "source") if key in record.attrs}
    made = make_response(
        frequency, bodies, amplitude, level, str(record["excitation"].attrs["units"]), sweep, direction,
        sigma=sigma, frequency_sigma=frequency_sigma, **attrs,
    )  # fmt: skip
    return check_response(made, where)


def _smoothed(variance: np.ndarray) -> np.ndarray:
    """Variance (row, point) averaged over neighbouring windows: one of them alone has few degrees of freedom."""
    n = variance.shape[1]
    width = min(SMOOTHED_WINDOWS, n)
    begin = np.clip(np.arange(n) - width // 2, 0, n - width)
    sums = np.concatenate([np.zeros((len(variance), 1)), np.cumsum(variance, axis=1)], axis=1)
    return np.asarray((sums[:, begin + width] - sums[:, begin]) / width)


def _levels(level: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Levels (point,) of a sweep: their mean where they do not vary by more than noise of this variance (point,)."""
    mean, chance = float(level.mean()), VALUE_VARIANCE * float(variance.mean())
    if np.mean((level - mean) ** 2) < max(MAX_LEVEL_DEPARTURE * chance, (MIN_LEVEL_VARIATION * mean) ** 2):
        return np.full(level.size, mean)
    return level


def _lag(run: Sequence[_Window], amplitude: np.ndarray, variance: np.ndarray) -> np.ndarray:
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


def _warn_of_lag(where: str, run: Sequence[_Window], kept: np.ndarray, ratio: np.ndarray) -> None:
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
