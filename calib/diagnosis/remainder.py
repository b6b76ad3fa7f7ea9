"""What no candidate explains of the records: by it their noise is judged where nothing else tells it."""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.refit import Fit
from calib.diagnosis.score import Projection


def remainder(evidence: Evidence, fit: Fit, derivatives: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """What is left of the measured rows (row, n) when all candidates are fitted to them at once, by record.

    To first order, and scaled to be as large as the noise on average.

    Parameters
    ----------
    derivatives : columns (N, k) by the parameters of the candidates, in units of the noise
    """
    everything = Projection(np.column_stack([fit.columns, fit.nuisances, *derivatives]))
    counted = evidence.counted()
    residual = everything(fit.residual) * np.sqrt(counted / max(1.0, counted - everything.rank))
    left = {}
    for part in evidence.parts:
        rows = part.restored(residual[evidence.of(part.name), None])[:, :, 0]
        left[part.name] = part.without_clock(rows)
    return left
