"""The excess chi-square of a fit: its sum of squared residuals less its degrees of freedom."""

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit


def degrees_of_freedom(evidence: Evidence, fit: Fit) -> float:
    """Number of weighted residuals less parameters and nuisances: the mean chi-square of noise alone."""
    return evidence.counted() - fit.columns.shape[1] - fit.nuisances.shape[1]


def excess_chi2(evidence: Evidence, fit: Fit) -> float:
    """Chi-square of a fit beyond its degrees of freedom.

    What gross errors leave of it is none: no model comes near them.
    """
    return _beyond_noise(fit.chi2, evidence, fit)


def excess_over(evidence: Evidence, fit: Fit) -> float:
    """Return the same over (other) evidence, such as where the simulations of another model are reliable too."""
    return _beyond_noise(fit.chi2_over(evidence), evidence, fit)


def _beyond_noise(chi2: float, evidence: Evidence, fit: Fit) -> float:
    """Chi-square of a fit over some evidence, less that of gross errors and the mean of noise."""
    return chi2 - _of_gross_errors(evidence, fit) - degrees_of_freedom(evidence, fit)


def _of_gross_errors(evidence: Evidence, fit: Fit) -> float:
    """Chi-square of the points in doubt that are far from the simulated response, beyond that of their noise."""
    excess = 0.0
    for part in evidence.parts:
        if part.is_swept:
            doubted = fit.point.simulated[part.name].trust < 1.0
            own = fit.residual[evidence.of(part.name)].reshape(len(part.rows), -1)[:, doubted]
            excess += max(0.0, float(np.square(own).sum()) - own.size)
    return excess


def chi2_std(evidence: Evidence) -> float:
    """Standard deviation of the chi-square of noise alone."""
    return float(np.sqrt(2.0 * evidence.counted()))


def significant(excess: float, std: float) -> bool:
    """Whether an excess chi-square is significant beside noise of this standard deviation of chi-square."""
    return excess > CRITERIA.significance_std * std


def dominant(excess: float, std: float) -> bool:
    """Whether more of a misfit is model error than noise of this standard deviation of chi-square."""
    return excess > CRITERIA.dominant_excess * std**2


def bias_std(excess: float, information: float) -> float:
    """Standard deviation of the bias of a size of this information by an excess chi-square  [unit of the size].

    The bound of Cauchy and Schwarz, sqrt(excess / information), is attained by a model error proportional to the
    effect; this is the share of it that is typical for a model error. Infinite without information.
    """
    if not information > 0.0:
        return np.inf
    return CRITERIA.model_error_cosine * float(np.sqrt(max(0.0, excess) / information))
