"""The noise of a frequency response from its replicates: their pure error, whatever the model leaves of all of them.

A misfit that changes slowly over the frequency looks like noise with a memory where each frequency was measured once.
Measured again, in a sweep down after one up, it is there again, and noise is not.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.noise import CYCLIC, REPLICATED, Noise, Remainder, from_cycles
from calib.diagnosis.noise_profile import noise_profiles
from calib.records.replicates import replicates


def pure_errors(
    record: xr.Dataset,
    rows: Sequence[tuple[str, str]],
    measured: np.ndarray,
    residual: np.ndarray,
    weight: np.ndarray,
    stated: float | None,
) -> dict[tuple[str, str], Noise]:
    """Return the noise of each row whose replicates leave it enough degrees of freedom.

    Parameters
    ----------
    record : a frequency response
    rows : (body, channel) pairs
    measured, residual, weight : (row, n)
    stated : standard deviation of the noise; None where the record states none  [unit of the rows]
    """
    group, pairs = replicates(record), zip(residual, weight, strict=True)
    errors, free = np.stack([recursive_residuals(own, w, group) for own, w in pairs], axis=1)
    profiles: Sequence[np.ndarray | float] = [1.0] * len(rows)
    if stated is None:
        left = Remainder(errors, errors, np.zeros((len(rows), 1, 1)), np.zeros(errors.shape))
        profiles = noise_profiles(rows, measured, free, left)
    found = {}
    for row, error, counted, whole, profile in zip(rows, errors, free, measured, profiles, strict=True):
        if float((counted**2).sum()) >= CRITERIA.min_noise_samples:
            noise = from_cycles(error / profile, counted, whole, 0, stated)
            source = REPLICATED if noise.source == CYCLIC else noise.source
            found[row] = replace(noise, source=source, profile=profile)
    return found


def recursive_residuals(residual: np.ndarray, weight: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What each point differs by from the mean of its replicates before it, of the variance of one point; its weight.

    They are as many as there are degrees of freedom, and independent where the noise is (Brown, Durbin & Evans, Journal
    of the Royal Statistical Society B 37 (1975) 149). A point without replicates before it has weight 0.

    Parameters
    ----------
    residual, weight : (n,) in the order measured
    group : (n,) number of the replicates that each belongs to
    """
    found, free = np.zeros(residual.size), np.zeros(residual.size)
    before: dict[int, list[float]] = {}
    for point in np.flatnonzero(weight > 0.0):
        earlier = before.setdefault(int(group[point]), [])
        if earlier:
            scale = (1.0 + 1.0 / len(earlier)) ** -0.5
            found[point], free[point] = scale * (residual[point] - np.mean(earlier)), weight[point]
        earlier.append(float(residual[point]))
    return found, free
