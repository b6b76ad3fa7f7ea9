"""Prediction of records, or blocks of time, that a model with free forces was not fitted to.

One fold after the other is left out, as in `calib.diagnosis.prediction`: the model is refitted to the others,
linearised about its fit to all data and with the same penalty, and only the left-out record's own nuisances are solved
for in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.discovery.penalised import PenalisedFit
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.prediction import folds

LEFT_OUT_RANK_TOLERANCE = 1e-9  # singular value over the largest, below which a direction is not moved  [1]


@dataclass(frozen=True, eq=False)
class LeftOutMisfit:
    """Misfit of the records that were left out in turn.

    Attributes
    ----------
    names : of the folds
    squares : (segment,) sums of squares of the segments of all folds, in units of the noise's variance
    """

    names: tuple[str, ...]
    squares: np.ndarray

    @property
    def chi2(self) -> float:
        """Sum of squares over all folds."""
        return float(self.squares.sum())

    def above(self, other: "LeftOutMisfit") -> tuple[float, float]:
        """Sum of squares less that of another model on the same folds, and its standard error.

        The differences of the segments count as independent (Diebold & Mariano, Journal of Business and Economic
        Statistics 13 (1995) 253).
        """
        difference = self.squares - other.squares
        return float(difference.sum()), float(np.sqrt(difference.size * np.var(difference, ddof=1)))


def left_out_misfit(evidence: Evidence, fit: Fit, penalised: PenalisedFit | None = None) -> LeftOutMisfit | None:
    """Leave each fold out in turn; None where there is none: of one steady tone, whose cycles repeat any model error.

    penalised : of a model with free forces, whose fit it is
    """
    segments = evidence.segments()
    names, squares = [], []
    rows, target = _penalty(fit, penalised)
    for name, left_out in folds(evidence):
        residual = _residual(fit, left_out, rows, target)
        numbers = segments[left_out]
        squares.append(np.bincount(numbers - numbers.min(), residual**2))
        names.append(name)
    return LeftOutMisfit(tuple(names), np.concatenate(squares)) if names else None


def _penalty(fit: Fit, penalised: PenalisedFit | None) -> tuple[np.ndarray, np.ndarray]:
    """Rows (p, k) by a step of the parameters, and what they should amount to (p,): penalties as further data."""
    if penalised is None:
        return np.zeros((0, len(fit.names))), np.zeros(0)
    own = np.isin(fit.names, penalised.model.coefficients)
    root = penalised.smoothing.root(penalised.weight)
    rows = np.zeros((len(root), own.size))
    rows[:, own] = root
    return rows, -root @ penalised.coefficients


def _residual(fit: Fit, left_out: np.ndarray, rows: np.ndarray, target: Sequence[float] | np.ndarray) -> np.ndarray:
    """Residual (n,) of the left-out data (N,) by the model refitted to the others."""
    columns = fit.free(fit.columns)
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    training = np.vstack([columns[~left_out], rows]) / scale
    wanted = np.concatenate([fit.residual[~left_out], target])
    step = np.linalg.lstsq(training, wanted, rcond=LEFT_OUT_RANK_TOLERANCE)[0] / scale
    return np.asarray(fit.residual[left_out] - columns[left_out] @ step)
