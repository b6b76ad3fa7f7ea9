"""Windows of whole cycles of an excitation that is a sine, and what its sine and that of each motion are in them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.polynomial import legendre, polynomial
from scipy.fft import next_fast_len

SIGNAL_ORDERS, NOISE_ORDERS = 3, 6  # Legendre polynomials of the motion, and of the noise beside it  [count]
ORDERS_BESIDE = range(2, 6)  # that are fitted beside the motion
PHASE_DEGREE = SIGNAL_ORDERS - 1  # of the phase of the excitation over a window
MIN_SAMPLES_PER_UNKNOWN = 2  # in a window
NYQUIST_SHARE = 0.9  # of the Nyquist frequency, to which a harmonic is fitted  [1]
MAX_DRIVE_RESIDUAL = 0.3  # rms of the excitation beside one sine, over that sine's, in a window that is used  [1]
MAX_AMPLITUDE_AT_REST = 0.5  # of excitation and motion, over that in the windows beside, where it has stopped  [1]
LEAST_CHANGE = 2e-5  # of a frequency, relative, from which it changes  [1]
LEAST_LEVEL_CHANGE = 1e-3  # relative, from which a level changes  [1]
MIN_CHANGE_STD = 5.0  # of a frequency or a level, over its standard error, from which it changes  [1]
NEAR_WINDOWS = 9  # of a stepped sine, the lower quartile of whose changes and noises is not of a step  [count]
VALUE_VARIANCE = 1.0 + 5.0 / 4.0  # of c_0 - c_2 / 2, the value in the middle of a window, over that of c_0  [1]
DRIFT_VARIANCE = 3.0  # of c_1, the change over half of a window, over that of c_0  [1]


@dataclass(frozen=True, eq=False)
class TrackedHarmonic:
    """A higher harmonic of the motions in a window.

    Attributes
    ----------
    order : of the harmonic
    response, drift, variance, scatter : (row,) as those of `TrackedWindow`, of each motion before `order` times the
        phase of the excitation
    level : amplitude of that harmonic of the excitation itself
    """

    order: int
    response: np.ndarray
    drift: np.ndarray
    variance: np.ndarray
    scatter: np.ndarray
    level: float


@dataclass(frozen=True, eq=False)
class TrackedWindow:
    """A window in which the excitation is one sine.

    Attributes
    ----------
    number : among all windows of the record
    samples : of the record
    time : of its middle  [s]
    frequency, frequency_sigma : of the excitation in the middle, and its standard uncertainty  [Hz]
    level : amplitude of the excitation
    response : (row,) complex amplitude of each motion before the excitation
    drift : (row,) its change over half of the window
    variance : (1 + row,) of the noise of either part of a polynomial's coefficient, over 2 j + 1 of the j-th one, of
        the excitation and of each motion
    scatter : (1 + row,) variance of the level, and of the complex response, over the windows of a step that has settled
    frequency_error, level_error : standard errors, the level's relative, by which changes are tested  [Hz, 1]
    start : number of times that the excitation stopped before, until the motion was at rest
    harmonics : higher ones that are tracked, by rising order
    """

    number: int
    samples: slice
    time: float
    frequency: float
    frequency_sigma: float
    level: float
    response: np.ndarray
    drift: np.ndarray
    variance: np.ndarray
    scatter: np.ndarray
    frequency_error: float = 0.0
    level_error: float = 0.0
    start: int = 0
    harmonics: tuple[TrackedHarmonic, ...] = ()

    def step_to(self, other: "TrackedWindow") -> float:
        """Direction of the frequency from this window to another, 0 where the change is no more than noise."""
        step, error = other.frequency - self.frequency, math.hypot(self.frequency_error, other.frequency_error)
        return float(np.sign(step)) if abs(step) > max(MIN_CHANGE_STD * error, LEAST_CHANGE * self.frequency) else 0.0

    def has_level_of(self, other: "TrackedWindow") -> bool:
        """Whether the level of another window differs by no more than noise."""
        error = math.hypot(self.level_error, other.level_error)
        return abs(math.log(self.level / other.level)) <= max(MIN_CHANGE_STD * error, LEAST_LEVEL_CHANGE)


def windows_of_cycles(
    time: np.ndarray, drive: np.ndarray, rows: np.ndarray, cycles: int, stepped: bool, highest: int = 1
) -> list[TrackedWindow]:
    """Windows of so many cycles in which the excitation is one sine, in order.

    Parameters
    ----------
    time, drive : (n,) [s] and excitation
    rows : (row, n) motions
    stepped : whether the excitation stays at each frequency for several windows
    highest : harmonic of the motions that is tracked
    """
    centred = drive - drive.mean()
    phase = np.unwrap(np.angle(scipy.signal.hilbert(centred, next_fast_len(centred.size))[: centred.size]))
    advanced = np.maximum.accumulate(phase) / (2.0 * math.pi * cycles)
    edges = np.searchsorted(advanced, np.arange(math.ceil(advanced[0]), math.floor(advanced[-1]) + 1))
    signals, windows, start = np.vstack([drive, rows]), list[TrackedWindow](), 0
    for number, (begin, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        own = slice(begin, end)
        window = _window(number, own, time[own], phase[own], signals[:, own], cycles, highest)
        if window is not None:
            start += bool(windows) and _rests_between(windows[-1], window, signals, cycles)
            windows.append(replace(window, start=start))
    return _with_errors(windows, stepped) if windows else []


def _rests_between(before: TrackedWindow, after: TrackedWindow, signals: np.ndarray, cycles: int) -> bool:
    """Whether excitation and a motion of signals (1 + row, n) fade between two windows: a sensor alone loses one."""
    begin, period = before.samples.stop, (before.samples.stop - before.samples.start) // cycles
    blocks = (after.samples.start - begin) // period
    own = signals[:, begin : begin + blocks * period].reshape(len(signals), blocks, period)
    beside = np.array([[one.level, *np.abs(one.response)] for one in (before, after)]).min(axis=0)
    at_rest = math.sqrt(2.0) * own.std(axis=2) < MAX_AMPLITUDE_AT_REST * beside[:, None]
    return bool((at_rest[0] & at_rest[1:].any(axis=0)).any())


def _with_errors(windows: Sequence[TrackedWindow], stepped: bool) -> list[TrackedWindow]:
    """Windows with the errors by which changes are tested: not below the median noise of all windows.

    Of a swept sine that of the window itself. Of a stepped one that of the windows about it, as one that is on two
    steps is noisier, and the changes between them: most are of one step, and a beat, or a creeping level, is in them.
    """
    sigma = np.array([one.frequency_sigma for one in windows])
    level_sigma = np.sqrt([VALUE_VARIANCE * one.variance[0] / one.level**2 for one in windows])
    frequency, level = np.array([one.frequency for one in windows]), np.log([one.level for one in windows])
    errors = []
    for own, values in ((sigma, frequency), (level_sigma, level)):
        floor = np.full(own.size, np.median(own))
        estimates = (
            (_nearby(own, own.size), _nearby(np.abs(np.diff(values)), own.size) / math.sqrt(2.0)) if stepped else (own,)
        )
        errors.append(np.max([floor, *estimates], axis=0).tolist())
    return [replace(one, frequency_error=f, level_error=a) for one, f, a in zip(windows, *errors, strict=True)]


def _nearby(values: np.ndarray, n: int) -> np.ndarray:
    """Lower quartile (n,) of the values that are near each window."""
    if values.size < NEAR_WINDOWS:
        return np.zeros(n)
    near = np.lib.stride_tricks.sliding_window_view(values, NEAR_WINDOWS)
    centre = np.clip(np.arange(n) - NEAR_WINDOWS // 2, 0, len(near) - 1)
    return np.asarray(np.quantile(near, 0.25, axis=1)[centre])


def _window(
    number: int, samples: slice, time: np.ndarray, phase: np.ndarray, rows: np.ndarray, cycles: int, highest: int
) -> TrackedWindow | None:  # fmt: skip
    """Fit a window of the excitation and the motions (1 + row, n); None where the excitation is no sine in it.

    phase : (n,) of the excitation's analytic signal, which noise disturbs
    """
    orders = SIGNAL_ORDERS + NOISE_ORDERS
    beside = [k for k in ORDERS_BESIDE if k > highest and k * cycles < NYQUIST_SHARE * 0.5 * time.size]
    unknowns = 2 * (orders * highest + len(beside)) + 1
    if time.size < MIN_SAMPLES_PER_UNKNOWN * unknowns or 2 * highest * cycles > NYQUIST_SHARE * time.size:
        return None
    half = 0.5 * (time[-1] - time[0])
    s = (time - time[0]) / half - 1.0
    turn = polynomial.polyfit(s, phase, PHASE_DEGREE)
    for last in (False, True):
        columns = _columns(s, polynomial.polyval(s, turn), highest, beside)
        solved = rows if last else rows[:1]
        fitted = np.linalg.lstsq(columns, solved.T, rcond=None)[0]
        polynomials = fitted[: 2 * orders * highest]
        c, *higher = np.moveaxis((polynomials[::2] + 1j * polynomials[1::2]).T.reshape(-1, highest, orders), 1, 0)
        if not last:  # the phase with what the fit shows of it
            ahead = np.unwrap(np.angle(legendre.legval(s, c[0, :SIGNAL_ORDERS])))
            turn = polynomial.polyfit(s, polynomial.polyval(s, turn) + ahead, PHASE_DEGREE)
    left = rows[0] - columns @ fitted[:, 0]
    variance = _variance(c)
    middle = _middle(c)
    level = float(abs(middle[0]))
    residual = np.sqrt(np.mean(left**2) + np.sum(np.abs(c[0, SIGNAL_ORDERS:]) ** 2) / 2.0)
    if not math.sqrt(2.0) * residual < MAX_DRIVE_RESIDUAL * level:
        return None
    slope = c[0, 1] / middle[0]
    noise = math.sqrt(variance[0]) / level
    before = np.conj(middle[0]) / level
    return TrackedWindow(
        number=number, samples=samples, time=float(time[0] + half),
        frequency=float(turn[1] + slope.imag) / (2.0 * math.pi * half),
        frequency_sigma=math.sqrt(DRIFT_VARIANCE) * noise / (2.0 * math.pi * half),
        level=level,
        response=middle[1:] * before,
        drift=(c[1:, 1] - middle[1:] * slope) * before,
        variance=variance,
        scatter=np.zeros(variance.size),
        harmonics=tuple(_harmonic(order, own, before, slope) for order, own in enumerate(higher, 2)),
    )  # fmt: skip


def _harmonic(order: int, c: np.ndarray, before: complex, slope: complex) -> TrackedHarmonic:
    """Higher harmonic of motions by the coefficients (1 + row, j) of its polynomials, the first the excitation's.

    before : unit phasor that turns the excitation in the middle of the window to phase 0
    slope : relative change of the excitation's complex amplitude over half of the window
    """
    of_drive, *middle = _middle(c)
    turn, change = before**order, slope.real + 1j * order * slope.imag
    drift = (c[1:, 1] - np.array(middle) * change) * turn
    scatter = np.zeros(len(middle))
    return TrackedHarmonic(order, np.array(middle) * turn, drift, _variance(c[1:]), scatter, float(abs(of_drive)))


def _middle(c: np.ndarray) -> np.ndarray:
    """Values (row,) in the middle of a window of what polynomials with coefficients (row, j) describe."""
    return np.asarray(c[:, 0] - 0.5 * c[:, 2])


def _variance(c: np.ndarray) -> np.ndarray:
    """Variance (row,) of the noise of either part of coefficients (row, j), over 2 j + 1 of the j-th one."""
    weight = 2.0 * np.arange(SIGNAL_ORDERS, SIGNAL_ORDERS + NOISE_ORDERS) + 1.0
    return np.asarray(np.mean(np.abs(c[:, SIGNAL_ORDERS:]) ** 2 / weight, axis=1) / 2.0)


def _columns(s: np.ndarray, phase: np.ndarray, highest: int, beside: Sequence[int]) -> np.ndarray:
    """Columns (n, k): parts of each polynomial's coefficient by order up to the highest, mean, harmonics beside."""
    shapes = legendre.legvander(s, SIGNAL_ORDERS + NOISE_ORDERS - 1)
    tracked = [
        np.stack([shapes * np.cos(k * phase)[:, None], -shapes * np.sin(k * phase)[:, None]], axis=2)
        for k in range(1, highest + 1)
    ]
    further = [part(k * phase) for k in beside for part in (np.cos, np.sin)]
    return np.column_stack([*(both.reshape(s.size, -1) for both in tracked), np.ones(s.size), *further])
