"""What no candidate explains of the records: by it their noise is judged where nothing else tells it."""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.noise import Remainder, absorbed_by
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
        whole = part.restored(fit.residual[own, None])[:, :, 0]
        left[part.name] = Remainder(rows, whole, np.array([absorbed_by(basis) for basis in bases]))
    return left
