"""The excess chi-square of a fit: its sum of squared residuals less its degrees of freedom."""

from collections.abc import Mapping

import numpy as np

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.part import Part


def degrees_of_freedom(evidence: Evidence, fit: Fit) -> float:
    """Number of weighted residuals less parameters and nuisances: the mean chi-square of noise alone."""
    return evidence.counted() - fit.columns.shape[1] - fit.nuisances.shape[1]


def excess_chi2(evidence: Evidence, fit: Fit) -> float:
    """Chi-square of a fit beyond its degrees of freedom.

    What gross errors leave of it is none: no model comes near them.
    """
    return fit.chi2 - _of_noise(evidence, fit, fit.residual)


def excess_over(evidence: Evidence, fit: Fit) -> float:
    """Return the same over (other) evidence, such as where the simulations of another model are reliable too."""
    residual = fit.residual_over(evidence)
    return float(residual @ residual) - _of_noise(evidence, fit, residual)


def _of_noise(evidence: Evidence, fit: Fit, residual: np.ndarray) -> float:
    """Mean chi-square of the noise of these residuals, and the excess of their gross errors."""
    return degrees_of_freedom(evidence, fit) + excess_of_gross_errors(evidence, fit.point.simulated, residual)


def excess_of_gross_errors(evidence: Evidence, simulations: Mapping[str, SimulatedRows], residual: np.ndarray) -> float:
    """Chi-square of the gross errors among residuals (N,), beyond that of their noise."""
    swept = ((part, residual[evidence.of(part.name)]) for part in evidence.parts if part.is_swept)
    return float(sum(gross_excess_by_row(part, simulations[part.name], own).sum() for part, own in swept))


def gross_excess_by_row(part: Part, simulated: SimulatedRows, residual: np.ndarray) -> np.ndarray:
    """Chi-square (row,) of the points of a response in doubt that are far from the simulated one, beyond their noise.

    0 in a record that is no response.

    Parameters
    ----------
    residual : (row x n,) of the record, in units of the noise
    """
    if not part.is_swept:
        return np.zeros(len(part.rows))
    doubted = residual.reshape(len(part.rows), -1)[:, simulated.trust < 1.0]
    return np.maximum(0.0, np.square(doubted).sum(axis=1) - doubted.shape[1])


def reduced_chi2(evidence: Evidence, fit: Fit) -> float:
    """Chi-square of a fit without that of gross errors over its degrees of freedom, at least 1."""
    return max(1.0, 1.0 + excess_chi2(evidence, fit) / max(1.0, degrees_of_freedom(evidence, fit)))


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
