"""How the noise of a frequency response grows with its amplitude.

A reading has noise of its own; errors of a gain, of a phase and of the level that acts are proportional to the
amplitude. So the variance at a point is a^2 + b^2 |H|^2, whose share of the second part is estimated from what a fit
leaves: a variance function (Carroll & Ruppert, Transformation and Weighting in Regression, 1988, chapter 3). Taken as
equal at all points, the noise would be judged by the many points beside a resonance, and look like a misfit at it.
"""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.noise import Remainder
from calib.records.response import order_of_part

SHARES = np.linspace(0.0, 1.0, 41)  # of the variance that is proportional to the amplitude squared, on average  [1]
MIN_PROFILE = 0.05  # standard deviation of a point, over the rms one  [1]: it is not known to be without any noise


def noise_profiles(
    rows: Sequence[tuple[str, str]], measured: np.ndarray, weight: np.ndarray, left: Remainder
) -> list[np.ndarray]:
    """Return the standard deviation (n,) of the noise at each point, over the rms one, of each row  [1].

    Both parts of a harmonic of a body have the same: 1 at all points where Schwarz's criterion does not prefer another.

    Parameters
    ----------
    rows : (body, channel) pairs
    measured, weight : (row, n)
    left : what a fit leaves of them
    """
    harmonics, found = [(body, order_of_part(part)) for body, part in rows], dict[tuple[str, int], np.ndarray]()
    for harmonic in dict.fromkeys(harmonics):
        own = np.array([one == harmonic for one in harmonics])
        square = (measured[own] ** 2).sum(axis=0)
        freedom = np.maximum(weight[own] ** 2 - left.leverage[own], 0.0)
        found[harmonic] = _profile(square, freedom, (left.rows[own] * weight[own]) ** 2)
    return [found[harmonic] for harmonic in harmonics]


def _profile(square: np.ndarray, freedom: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Standard deviation (n,) at points of these squared amplitudes (n,), over the rms one.

    Squares `left` (part, n) are taken as gamma variables of the degrees of freedom (part, n) that a fit leaves them.
    """
    mean, free = float(square.mean()), float(freedom.sum())
    if not (mean > 0.0 and free > 0.0 and left.any()):
        return np.ones(square.size)
    variances = np.maximum(1.0 + SHARES[:, None] * (square / mean - 1.0), MIN_PROFILE**2)
    levels = (left / variances[:, None]).sum(axis=(1, 2)) / free
    deviance = (freedom * np.log(variances[:, None])).sum(axis=(1, 2)) + free * np.log(levels)
    best = int(np.argmin(deviance))
    is_better = deviance[0] - deviance[best] > np.log(free)
    return np.sqrt(variances[best] / variances[best].mean()) if is_better else np.ones(square.size)
