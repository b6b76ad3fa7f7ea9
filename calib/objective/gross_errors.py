"""Gross errors of frequency responses: points that were read in a jump, or while an amplifier was overloaded.

Noise has no part in them, and no model of steady motions can come near them: a least sum of squares would try, at the
cost of all other points. Where they may be, the measured points say: they lie apart from those before and after. There
a distance from the simulated response that no noise has counts little, and one that noise may have as everywhere;
elsewhere a large distance is a fault of the model.
"""

import numpy as np
import xarray as xr
from scipy import stats

from calib.objective.outliers import MIN_DEVIATION

MAX_TRUSTED_DEVIATION = 4.0  # of a part from its model, in standard deviations, that is not doubted
MAX_GROSS_TRUST = 0.5  # in the distance of a point, below which that is a gross error: from 7.3 standard deviations on
MIN_JUMP_RATIO = 3.0  # of a jump to the steps between points before and after it  [1]
MIN_DECAY_RATIO = 10.0  # of a step to the least of the next four, where the motion still decays  [1]
FEWEST_STEPS = 4  # between the points of a sweep, in which a jump can be told from steps  [count]


def reach_of_noise(parts: int, deviation: float) -> float:
    """Squared distance that noise exceeds as rarely as one of its parts a number of standard deviations  [1].

    Parts in their standard uncertainties.
    """
    return float(stats.chi2.isf(stats.chi2.sf(deviation**2, 1), parts))


def may_be_gross(values: np.ndarray, parts: int) -> np.ndarray:
    """Whether points (n,) of a sweep lie apart from those before and after.

    A step between two points is a jump where it is larger than the steps on either side. A single one leads from one
    branch to the other. The points between several were read on neither: while the motion jumped, or in error; and so
    may be the one after them, as a motion decays. At either end of a sweep a single jump leaves a point alone.

    Parameters
    ----------
    values : (k, n) parts of the points in the order measured, each in its standard uncertainty
    parts : how many of them are measured
    """
    steps = np.sqrt(np.square(np.diff(values, axis=1)).sum(axis=0))
    if steps.size < FEWEST_STEPS:
        return np.zeros(values.shape[1], dtype=bool)
    large = steps**2 > 2.0 * reach_of_noise(parts, MIN_DEVIATION)  # a difference has the noise of two points
    jump = np.zeros(steps.size, dtype=bool)
    for place in np.flatnonzero(large):
        begins = steps[place] > MIN_JUMP_RATIO * _least(steps[max(place - 2, 0) : place])
        ends = steps[place] > MIN_JUMP_RATIO * _least(steps[place + 1 : place + 3])
        decays = steps[place] > MIN_DECAY_RATIO * _least(steps[place + 1 : place + 5])
        jump[place] = (begins and (ends or decays)) or (place > 0 and jump[place - 1] and decays)
    bounded = np.concatenate([[True], jump, [True]])
    between = bounded[:-1] & bounded[1:]
    return between | np.concatenate([[False], between[:-1]])


def _least(steps: np.ndarray) -> float:
    """Least of some steps, 0 where there are none: nothing is known beyond the end of a sweep."""
    return float(steps.min()) if steps.size else 0.0


def trust_at(square: np.ndarray, parts: int) -> np.ndarray:
    """Factors (n,) in (0, 1] on distances: 1 up to one that noise may have, and next to 0 at that of a gross error.

    With a the distance that noise exceeds as rarely as 4 standard deviations of one part, a distance r > a counts as
    r exp(-(r / a - 1)^2): a redescending M-estimator that is least squares in the middle. What is left of a gross error
    is no evidence against a model either. Source: Huber & Ronchetti, Robust Statistics, 2nd edition (2009), section
    4.8.

    Parameters
    ----------
    square : (n,) squared distances, their parts in their standard uncertainties
    parts : of each
    """
    over = np.sqrt(np.maximum(square / reach_of_noise(parts, MAX_TRUSTED_DEVIATION), 1.0)) - 1.0
    return np.exp(-np.square(over))


def gross_errors(compared: xr.Dataset) -> np.ndarray:
    """Indices of the points of a simulated response, as it is compared, whose measured ones are gross errors."""
    return np.flatnonzero(compared["trust"].values < MAX_GROSS_TRUST)


def without_gross_errors(measured: xr.Dataset, compared: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Return a measured response and a simulated one, as it is compared, without the points that are gross errors."""
    kept = np.setdiff1d(np.arange(measured.sizes["point"]), gross_errors(compared))
    return measured.isel(point=kept), compared.isel(point=kept)
