"""Faults of the records themselves: outliers, and the steps of a converter."""

import numpy as np
import scipy

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.part import Part
from calib.objective.outliers import MIN_DEVIATION, deviations, smoothed

MAX_LEVEL_SHARE = 0.5  # levels over samples: fewer are steps of a converter  [1]
MAX_LEVEL_ERROR = 1e-3  # distance of a level from whole steps over a step, up to which it is rounding  [1]


def outliers(part: Part, simulated: SimulatedRows) -> np.ndarray:
    """Whether a sample (row, n) is an outlier.

    Its residual is MIN_DEVIATION standard deviations beyond the median about it, theirs are not, and the same holds for
    the measured channel itself: a model error may leave spikes in the residual alone. What recurs in the cycles before
    and after is no outlier either, but belongs to the motion, such as an impact at another time. A frequency response
    has a peak or a jump where a record over time has outliers: it has none.
    """
    if part.is_swept:
        return np.zeros(part.measured.shape, dtype=bool)
    far = part.weight == 1.0
    for rows in (part.measured, part.measured - simulated.rows):
        distance, sigma = deviations(rows)
        far &= distance > MIN_DEVIATION * np.maximum(sigma, 1e-300)
    jump = scipy.ndimage.uniform_filter1d(far.astype(float), 3, axis=1) > 0.5  # most samples about it depart too
    return far & ~jump & ~_recurring(part, rows - smoothed(rows))


def _recurring(part: Part, departure: np.ndarray) -> np.ndarray:
    """Whether departures (row, n) recur, of the same sign and half as large, in most cycles before and after.

    At the same phase, or a sample beside it. Two cycles on each side are compared, as far as the record has them: in
    one cycle alone another outlier may be there by chance.
    """
    if part.period is None:
        return np.zeros(departure.shape, dtype=bool)
    highest = scipy.ndimage.maximum_filter1d(departure, 3, axis=1)
    lowest = scipy.ndimage.minimum_filter1d(departure, 3, axis=1)
    cycles, recurrences = np.zeros(part.time.size), np.zeros(departure.shape)
    for number in (-2, -1, 1, 2):
        time = part.time + number * part.cycle * part.period
        nearest = np.searchsorted(0.5 * (part.time[1:] + part.time[:-1]), time)
        inside = (time >= part.time[0]) & (time <= part.time[-1])
        similar = np.where(departure > 0.0, highest[:, nearest], -lowest[:, nearest]) > 0.5 * np.abs(departure)
        cycles += inside
        recurrences += inside & similar
    return (recurrences >= 0.5 * cycles) & (cycles > 0)


def rounding(part: Part) -> np.ndarray:
    """Variance (row,) of a converter's steps over that of the row's noise; 0 where there are none  [1].

    There are steps where the samples lie on few levels that are whole steps apart; their variance is a twelfth of the
    step squared (Widrow & Kollar, Quantization Noise, 2008, chapter 4).
    """
    shares = np.zeros(len(part.rows))
    for index, (row, noise, used) in enumerate(zip(part.measured, part.noise, part.used, strict=True)):
        levels = np.unique(row[used])
        if 1 < levels.size < MAX_LEVEL_SHARE * used.sum():
            step = np.median(np.diff(levels))
            steps = (levels - levels[0]) / step
            if np.abs(steps - np.round(steps)).max() < MAX_LEVEL_ERROR:
                shares[index] = step**2 / 12.0 / noise.sigma**2
    return shares
