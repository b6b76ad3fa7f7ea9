"""The part of the records that no candidate explains, from which their noise is estimated where need be."""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.noise import Remainder, absorbed_by
from calib.diagnosis.score import Projection


def remainder(evidence: Evidence, fit: Fit, derivatives: Sequence[np.ndarray]) -> dict[str, Remainder]:
    """Residuals of the measured rows with all candidates fitted to them at once, to first order, by record.

    So is the rate of each uncertain clock: beside so many candidates the part of the residual that is due to a clock
    is undetermined. And so are the calibrated parameters in each sweep of a frequency response by itself: a force that
    no candidate resembles makes stiffness and damping differ from level to level, noise does not (the homogeneity of
    frequency responses: Worden & Tomlinson, Nonlinearity in Structural Dynamics, 2001, section 2.3).

    Parameters
    ----------
    derivatives : columns (N, k) by the parameters of the candidates, in units of the noise
    """
    by_sweep, clocks = evidence.by_sweep(fit.columns), evidence.clock_changes()
    everything = Projection(np.column_stack([fit.columns, by_sweep, fit.nuisances, clocks, *derivatives]))
    residual = everything(fit.residual)
    left = {}
    for part in evidence.parts:
        own = evidence.of(part.name)
        rows = part.restored(residual[own, None])[:, :, 0]
        bases = everything.basis[own].reshape(*rows.shape, -1)
        whole = part.restored(fit.residual[own, None])[:, :, 0]
        absorbed = np.array([absorbed_by(basis) for basis in bases])
        left[part.name] = Remainder(rows, whole, absorbed, (bases**2).sum(axis=2))
    return left
