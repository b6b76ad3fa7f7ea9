"""What no candidate explains of the records: by it their noise is judged where nothing else tells it."""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.noise import ORDER, Remainder
from calib.diagnosis.refit import Fit
from calib.diagnosis.score import Projection


def remainder(evidence: Evidence, fit: Fit, derivatives: Sequence[np.ndarray]) -> dict[str, Remainder]:
    """What is left of the measured rows when all candidates are fitted to them at once, to first order, by record.

    So is the rate of each clock that is uncertain: beside so many candidates nothing tells how much of what is left
    along its change a clock makes.

    Parameters
    ----------
    derivatives : columns (N, k) by the parameters of the candidates, in units of the noise
    """
    everything = Projection(np.column_stack([fit.columns, fit.nuisances, evidence.clock_changes(), *derivatives]))
    residual = everything(fit.residual)
    left = {}
    for part in evidence.parts:
        own = evidence.of(part.name)
        rows = part.restored(residual[own, None])[:, :, 0]
        bases = everything.basis[own].reshape(*rows.shape, -1)
        left[part.name] = Remainder(rows, np.array([_absorbed(basis) for basis in bases]))
    return left


def _absorbed(basis: np.ndarray) -> np.ndarray:
    """What a projection P on an orthonormal basis, of which a row has this part (n, k), absorbs: see `Remainder`.

    With D_j the matrix of ones between samples j apart, the products of residuals l apart are e' D_l e / 2 and their
    expectation for each unit of the autocovariance at lag j is tr(D_l (1 - P) D_j (1 - P)) / 2; less that without P.
    What a shift moves beyond the ends of the row is left out of tr(P D_l D_j). Source: Worsley et al., NeuroImage 15
    (2002) 1, section 2.3.
    """
    n, lags = len(basis), np.arange(min(ORDER, (len(basis) - 1) // 2) + 1)
    shifted = [basis[lag:].T @ basis[: n - lag] for lag in range(2 * lags.size)]
    sums = 2.0 * np.array([np.trace(product) for product in shifted])
    once = sums[np.abs(lags[:, None] - lags)] + sums[lags[:, None] + lags]  # tr(P D_l D_j), where D_0 counted twice
    both = np.array([(product + product.T).ravel() for product in shifted[: lags.size]])
    halves = np.where(lags == 0, 0.5, 1.0)
    return np.outer(np.where(lags == 0, 1.0, 0.5) * halves, halves) * (2.0 * once - both @ both.T)
