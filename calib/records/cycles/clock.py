"""The rate of a recorder's clock against that of the drive, by the phases of the cycles of a steady motion."""

import numpy as np
import scipy
import xarray as xr

from calib.records.cycles.loop import cycles_in, period_of, sampled
from calib.records.cycles.mean_cycle import IN_STEP_TOLERANCE, mean_cycle
from calib.records.record import channels

MIN_RATE_CYCLES = 10  # with samples, for a rate; over fewer even one of 1e-3 shifts none by more than a hundredth of it
MIN_CYCLE_CURVATURE = 0.5  # of the sum of squared slopes of a cycle over the median one, for a cycle that counts  [1]
TAIL_PROBABILITY = 1e-4  # of Student's t, two-sided: of a rate where the clocks agree, and of its change  [1]
MAX_RATE_STEPS = 20  # of the search for the rate, by the method of Gauss and Newton


def clock_rate(record: xr.Dataset, periods: int = 1) -> float:
    """Rate of the drive's clock over the recorder's, less 1; 0 where they do not differ significantly.

    Each cycle is shifted in time against the mean cycle; a wrong rate makes the shift grow in proportion to time, at
    that rate. Its standard error is that of the scatter of the shifts about the line. A curved shift, such as that of a
    motion that still settles, is not attributed to the clock. A regression of phases on time as of a noisy sinusoid
    (Tretter, IEEE Transactions on Information Theory 31 (1985) 832), here of all harmonics of all channels together.

    Parameters
    ----------
    record : of a steady motion, with its channels over (body, time), time [s] and attribute frequency [Hz]
    periods : of the excitation that a cycle of the motion lasts

    Returns
    -------
    relative rate  [1]; time multiplied by 1 + rate is time on the clock of the drive

    Raises
    ------
    CalibError : no period
    """
    period, time = period_of(record), record.time.values
    if time[-1] - time[0] < MIN_RATE_CYCLES * period * periods:
        return 0.0
    number, samples, _ = cycles_in(time, period, periods)
    rows = np.concatenate([sampled(record, channel) for channel in channels(record)])
    rows, rate = rows[np.ptp(rows, axis=1) > 0.0], 0.0
    if not rows.size:
        return 0.0
    for _ in range(MAX_RATE_STEPS):
        if (1.0 + rate) * (time[-1] - time[0]) < (number - 1) * period * periods:
            return 0.0  # a clock that loses a whole cycle: the motion has another period than the drive
        centre, shift = _shifts((1.0 + rate) * time, rows, period, periods, number)
        if centre.size < MIN_RATE_CYCLES:
            return 0.0
        line = scipy.stats.linregress(centre, shift)
        if abs(line.slope) <= 0.1 * line.stderr or abs(line.slope * time[-1]) <= 1e-6 * period:
            break
        rate += line.slope * (1.0 + rate)
    else:
        return 0.0
    limit = scipy.stats.t.isf(0.5 * TAIL_PROBABILITY, centre.size - 3)
    in_step = abs(rate) * (time[-1] - time[0]) <= IN_STEP_TOLERANCE * period / samples
    if in_step or abs(rate) <= limit * line.stderr or _bends(centre, shift, limit):
        return 0.0
    return float(rate)


def _shifts(
    time: np.ndarray, rows: np.ndarray, period: float, periods: int, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Middle (cycle,) of each whole cycle, and by how much later than the mean cycle the clock should have it  [s].

    Cycles that a gap in time leaves with few samples have no shift, or one of another variance: they are left out.
    """
    mean = mean_cycle(time, rows, period, periods)
    slope = np.gradient(rows - mean.residual, time, axis=1)
    precision = 1.0 / np.maximum(np.mean(mean.residual**2, axis=1), 1e-300)
    cycle = ((time - time[0]) / (period * periods)).astype(int)
    moment = np.bincount(cycle, precision @ (slope * mean.residual), number)[:number]
    curvature = np.bincount(cycle, precision @ slope**2, number)[:number]
    whole = np.flatnonzero(curvature > MIN_CYCLE_CURVATURE * np.median(curvature))
    return time[0] + (whole + 0.5) * period * periods, moment[whole] / curvature[whole]


def _bends(centre: np.ndarray, shift: np.ndarray, limit: float) -> bool:
    """Whether the shifts of the cycles have a part that is quadratic in time."""
    coefficients, covariance = np.polyfit((centre - centre.mean()) / np.ptp(centre), shift, 2, cov=True)
    return bool(abs(coefficients[0]) > limit * np.sqrt(covariance[0, 0]))
