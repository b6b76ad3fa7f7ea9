"""Gross errors of frequency responses: points that were read before the motion had settled, or by a clipped amplifier.

Noise has no part in them, and no model of steady motions can come near them: a least sum of squares would try, at the
cost of all other points. Where they may be, the measured points say: they lie apart from those before and after. There
the weight of a distance from the simulated response falls where noise hardly reaches; elsewhere a large distance is a
fault of the model.
"""

from functools import lru_cache

import numpy as np
import xarray as xr
from scipy.special import chdtrc, chdtri

MAX_TRUSTED_DEVIATION = 3.0  # of a point in doubt from its model, in standard deviations: up to it the weight is 1
MAX_DOUBTED_RATIO = 1.15  # of what any distance of a point in doubt counts as, to the largest that counts in full  [1]
MAX_GROSS_TRUST = 0.5  # in the distance of a point: of less than that, 2.3 trusted ones, it is a gross error
MIN_STEP_DEVIATION = 8.0  # standard deviations: what a step between two points exceeds that is more than noise
MIN_JUMP_RATIO = 5.0  # of the steps to a point and from it, over those before and after and the median one  [1]
SETTLING_POINTS = 3  # after a point that was read in a jump, by which the motion has settled  [count]


@lru_cache
def largest_noise(parts: int, deviation: float) -> float:
    """Distance of a point that noise exceeds as rarely as one part alone exceeds some standard deviations.

    A quantile of chi's distribution. Parts and distance in standard uncertainties.
    """
    return float(np.sqrt(chdtri(parts, chdtrc(1, deviation**2))))


def in_doubt(values: np.ndarray, sigma: np.ndarray, frequency: np.ndarray, parts: int) -> np.ndarray:
    """Whether points (n,) of a sweep lie apart from those before and after, and may be gross errors.

    The steps to it and from it are more than noise, and several times the median step, the step before, and one of the
    steps after: a jump from branch to branch is a single large step, and near a resonance that is resolved neighbouring
    steps are alike. The point after it is in doubt too, as a motion decays. The first two and the last are not:
    what comes before or after them is not known. Points read again at a frequency count as one, by their mean.

    Parameters
    ----------
    values : (k, n) complex, of the points in the order measured
    sigma : (k, n) standard uncertainties of their parts, in the same unit
    frequency : (n,)  [Hz]
    parts : number of the parts of a point that are measured
    """
    group = np.concatenate([[0], np.cumsum(np.diff(frequency) != 0.0)])
    count = np.bincount(group)
    real, imaginary, square = (
        np.array([np.bincount(group, row) for row in rows]) / count for rows in (values.real, values.imag, sigma**2)
    )
    variance = square / count
    apart = np.diff(real) ** 2 + np.diff(imaginary) ** 2
    steps = np.sqrt((apart / (variance[:, 1:] + variance[:, :-1])).sum(axis=0))
    doubted = np.zeros(count.size, dtype=bool)
    least = (
        max(largest_noise(parts, MIN_STEP_DEVIATION), MIN_JUMP_RATIO * float(np.median(steps))) if steps.size else 0.0
    )
    for point in range(2, count.size - 2):
        before, into, out = steps[point - 2 : point + 1]
        after = steps[point + 1 : point + 1 + SETTLING_POINTS].min()
        doubted[point] = into > max(least, MIN_JUMP_RATIO * before) and out > max(least, MIN_JUMP_RATIO * after)
    doubted[1:] |= doubted[:-1].copy()
    return doubted[group]


def trust_at(square: np.ndarray, parts: int) -> np.ndarray:
    """Factors (n,) in (0, 1] on the distances of points in doubt.

    They count in full up to the largest that noise may have, a, and hardly more than that from there on, however large
    they are: an M-estimator whose influence falls to zero, and of which no distance is worth more than a smaller one.
    Source: Huber & Ronchetti, Robust Statistics, 2nd edition (2009), section 4.8.

    Parameters
    ----------
    square : (n,) squared distances, their parts in their standard uncertainties
    parts : of each
    """
    ratio = np.maximum(np.sqrt(square) / largest_noise(parts, MAX_TRUSTED_DEVIATION), 1.0)
    most = MAX_DOUBTED_RATIO - 1.0
    return (1.0 + most * (1.0 - np.exp((1.0 - ratio) / most))) / ratio


def gross_errors(trust: np.ndarray) -> np.ndarray:
    """Indices of the points that are gross errors, by the trust (n,) in their distances from a simulated response."""
    return np.flatnonzero(trust < MAX_GROSS_TRUST)


def without_gross_errors(measured: xr.Dataset, compared: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Return a measured response and a simulated one, as it is compared, without the points that are gross errors."""
    kept = np.setdiff1d(np.arange(measured.sizes["point"]), gross_errors(compared["trust"].values))
    return measured.isel(point=kept), compared.isel(point=kept)
