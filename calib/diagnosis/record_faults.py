"""Faults of the records themselves: outliers, and the steps of a converter."""

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.part import Part
from calib.objective.outliers import MIN_DEVIATION, deviations, smoothed

MAX_LEVEL_SHARE = 0.5  # levels over samples: fewer are steps of a converter
MAX_LEVEL_ERROR = 1e-3  # distance of a level from whole steps that is rounding, over a step


def outliers(part: Part, seen: SimulatedRows) -> np.ndarray:
    """Whether a sample (row, n) departs from those about it as no noise does.

    Its residual stands MIN_DEVIATION standard deviations beyond the median about it, theirs do not, and so it is with
    the measured channel itself: what the model lacks may leave spikes in the residual alone. What comes again in the
    cycles before and after is no outlier either, but belongs to the motion, such as an impact at another time.
    """
    far = part.weight == 1.0
    for rows in (part.measured, part.measured - seen.rows):
        distance, sigma = deviations(rows)
        far &= distance > MIN_DEVIATION * np.maximum(sigma, 1e-300)
    crowd = uniform_filter1d(far.astype(float), 3, axis=1) > 0.5  # a jump is no outlier
    return far & ~crowd & ~_recurring(part, rows - smoothed(rows))


def _recurring(part: Part, departure: np.ndarray) -> np.ndarray:
    """Whether departures (row, n) come again, of the same sign and half as large, in most cycles before and after.

    At the same phase, or a sample beside it. Two cycles on each side are looked at, as far as the record has them: in
    one cycle alone another outlier may be there by chance.
    """
    if part.period is None:
        return np.zeros(departure.shape, dtype=bool)
    highest, lowest = maximum_filter1d(departure, 3, axis=1), minimum_filter1d(departure, 3, axis=1)
    cycles, again = np.zeros(part.time.size), np.zeros(departure.shape)
    for number in (-2, -1, 1, 2):
        time = part.time + number * part.cycle * part.period
        there = np.searchsorted(0.5 * (part.time[1:] + part.time[:-1]), time)
        inside = (time >= part.time[0]) & (time <= part.time[-1])
        alike = np.where(departure > 0.0, highest[:, there], -lowest[:, there]) > 0.5 * np.abs(departure)
        cycles += inside
        again += inside & alike
    return (again >= 0.5 * cycles) & (cycles > 0)


def rounding(part: Part) -> np.ndarray:
    """Variance (row,) that a converter's steps make, over that of the row's noise; 0 where it shows none  [1].

    They show where the samples lie on few levels that are whole steps apart; theirs is a twelfth of the
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
