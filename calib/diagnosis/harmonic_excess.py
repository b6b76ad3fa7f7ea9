"""The part of a misfit that lies in the low harmonics of the excitation.

The error of a model of a steady motion lies in its low harmonics, noise in all frequencies: there a model error is
significant that the sum of all squares hides. It is a smooth test: Neyman, Skandinavisk Aktuarietidskrift 20 (1937)
149; Rayner, Thas & Best, Smooth Tests of Goodness of Fit (2009).
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.part import Part

HARMONICS_RANK_TOLERANCE = 1e-9  # singular value over the largest, below which samples do not determine a harmonic  [1]


@dataclass(frozen=True, eq=False)
class HarmonicExcess:
    """Excess chi-square of a fit in the low harmonics of the records of a steady tone.

    Attributes
    ----------
    rows : (R,) of each row of all records, as `Evidence.rows` numbers them; 0 where a record has no period
    degrees : (R,) degrees of freedom that parameters and nuisances leave there
    """

    rows: np.ndarray
    degrees: np.ndarray

    @property
    def total(self) -> float:
        """Excess chi-square of all rows."""
        return float(self.rows.sum())

    @property
    def std(self) -> float:
        """Standard deviation of the total where there is noise alone."""
        return math.sqrt(2.0 * float(self.degrees.sum()))

    @property
    def is_significant(self) -> bool:
        """Whether the total is more than noise."""
        return bool(self.degrees.any()) and significant(self.total, self.std)


UNTESTED = HarmonicExcess(np.array([]), np.array([]))


def model_error_chi2(excess: float, std: float, harmonics: HarmonicExcess) -> float:
    """Chi-square of a model error: the excess of all squares where that is significant, else that in low harmonics.

    0 where neither is. `std` is the standard deviation of the chi-square of noise alone.
    """
    if significant(excess, std):
        return excess
    return harmonics.total if harmonics.is_significant else 0.0


def harmonic_excess(evidence: Evidence, fit: Fit) -> HarmonicExcess:
    """Excess chi-square of a fit in harmonics up to `CRITERIA.model_error_harmonics`, and subharmonics of its cycle."""
    excess, degrees = [], []
    for part in evidence.parts:
        own = evidence.of(part.name)
        residuals = fit.residual[own].reshape(len(part.rows), -1)
        absorbed = fit.projection.basis[own].reshape(len(part.rows), part.time.size, -1)
        for row, (residual, columns) in enumerate(zip(residuals, absorbed, strict=True)):
            basis = _low_harmonics(part, row)
            degrees.append(basis.shape[1] - float(((basis.T @ columns) ** 2).sum()))
            excess.append(float(((basis.T @ residual) ** 2).sum()) - degrees[-1])
    return HarmonicExcess(np.array(excess), np.array(degrees))


def _low_harmonics(part: Part, row: int) -> np.ndarray:
    """Orthonormal columns (n, k) that span the low harmonics of a row in units of its noise."""
    if part.period is None or not part.used[row].any():
        return np.zeros((part.time.size, 0))
    cycle = max(1, part.cycle)
    orders = np.arange(1, cycle * CRITERIA.model_error_harmonics + 1) / cycle
    angles = 2.0 * np.pi / part.period * np.multiply.outer(orders, part.time)
    waves = np.concatenate([np.ones((1, part.time.size)), np.cos(angles), np.sin(angles)])
    whitened = np.array([part.noise[row].whitened(wave, part.weight[row]) for wave in waves])
    left, singular, _ = np.linalg.svd(whitened.T, full_matrices=False)
    return left[:, singular > HARMONICS_RANK_TOLERANCE * singular[0]]
