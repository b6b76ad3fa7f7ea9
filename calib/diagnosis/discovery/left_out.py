"""Prediction of records, levels of a frequency response, or blocks of time, that a model was not fitted to.

One fold after the other is left out, as in `calib.diagnosis.prediction`, but that of a single frequency response these
are its levels, which go through other states than each other: the model is refitted to the others,
linearised about its fit to all data, and only the left-out record's own nuisances are solved for in it. The weights of
the penalties are those that the others have: with weights of all data, which know how smooth the functions have to be
in the left-out ones too, the model of more functions would be preferred too often (Greven & Kneib, Biometrika 97 (2010)
773). What counts is the predictive deviance, minus twice the logarithm of the density that the refitted model
gives the left-out data, a proper score (Gneiting & Raftery, Journal of the American Statistical Association 102 (2007)
359): with the derivatives J there and the covariance C of the refit,

    r' (1 + J C J')^-1 r + log det (1 + J C J').

Where a record visits states that the others do not, the prediction is uncertain and is not expected to be exact.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.discovery.penalised import PenalisedFit, linearised
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.prediction import folds

MAX_LEVEL_FOLDS = 8  # of a frequency response  [count]
LEFT_OUT_RANK_TOLERANCE = 1e-9  # singular value over the largest, below which a direction is not moved  [1]


@dataclass(frozen=True, eq=False)
class LeftOutMisfit:
    """Misfit of the records that were left out in turn.

    Attributes
    ----------
    names : of the folds
    deviances : (fold,) predictive deviance, but for a constant, of each
    count : number of residuals
    """

    names: tuple[str, ...]
    deviances: np.ndarray
    count: int

    @property
    def deviance(self) -> float:
        """Predictive deviance of all folds: chi-square where the prediction is certain."""
        return float(self.deviances.sum())

    def is_better(self, other: "LeftOutMisfit") -> bool:
        """Whether it predicts the same folds better than another model: by more than a tie in AIC.

        Where it leaves more than noise, differences are judged by the quasi-likelihood, divided by its reduced
        deviance (Burnham & Anderson 2002, section 2.5).
        """
        dispersion = max(1.0, self.deviance / max(1, self.count))
        return other.deviance - self.deviance > CRITERIA.aic_tie * dispersion


def left_out_misfit(evidence: Evidence, fit: Fit, penalised: PenalisedFit | None = None) -> LeftOutMisfit | None:
    """Leave each fold out in turn; None where there is none: of one steady tone, whose cycles repeat any model error.

    penalised : of a model with free forces, whose fit it is
    """
    names, deviances = [], []
    for name, left_out in _levels(evidence) or folds(evidence):
        rows, target = _penalty(fit, left_out, penalised)
        deviances.append(_deviance(fit, left_out, rows, target))
        names.append(name)
    return LeftOutMisfit(tuple(names), np.array(deviances), fit.residual.size) if names else None


def _levels(evidence: Evidence) -> list[tuple[str, np.ndarray]]:
    """Name and residuals (N,) of each level of a single frequency response, of neighbouring ones where they are many.

    Empty for other records, and for a single level.
    """
    part = evidence.parts[0]
    if len(evidence.parts) > 1 or part.level is None or part.sweep is None:
        return []
    groups = np.array_split(np.unique(part.level), min(MAX_LEVEL_FOLDS, np.unique(part.level).size))
    if len(groups) == 1:
        return []
    masks = [np.isin(part.level, group) for group in groups]
    sweeps = [", ".join(f"{number:g}" for number in dict.fromkeys(part.sweep[mask].tolist())) for mask in masks]
    return [
        (f"sweep{'s' * (',' in own)} {own} of {part.name}", np.tile(mask, len(part.rows)))
        for own, mask in zip(sweeps, masks, strict=True)
    ]


def _penalty(fit: Fit, left_out: np.ndarray, penalised: PenalisedFit | None) -> tuple[np.ndarray, np.ndarray]:
    """Rows (p, k) by a step of the parameters, and what they should amount to (p,): penalties as further data."""
    if penalised is None:
        return np.zeros((0, len(fit.names))), np.zeros(0)
    own = np.isin(fit.names, penalised.model.coefficients)
    residual, columns, nuisances, at = (
        part[~left_out] for part in (fit.residual, fit.columns, fit.nuisances, fit.rows)
    )
    others = replace(fit, residual=residual, columns=columns, nuisances=nuisances, rows=at)
    smoothing = linearised(others, penalised.model)
    root = smoothing.root(smoothing.weight)
    rows = np.zeros((len(root), own.size))
    rows[:, own] = root
    return rows, -root @ penalised.coefficients


def _deviance(fit: Fit, left_out: np.ndarray, rows: np.ndarray, target: np.ndarray) -> float:
    """Predictive deviance of the left-out data (N,) by the model refitted to the others."""
    columns = fit.free(fit.columns)
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    training = np.vstack([columns[~left_out], rows]) / scale
    expected = np.concatenate([fit.residual[~left_out], target])
    left, singular, turn = np.linalg.svd(training, full_matrices=False)
    moved = singular > LEFT_OUT_RANK_TOLERANCE * singular.max(initial=0.0)
    there = (columns[left_out] / scale) @ (turn[moved].T / singular[moved])  # per standard deviation of the refit
    residual = fit.residual[left_out] - there @ (left[:, moved].T @ expected)
    information = np.eye(there.shape[1]) + there.T @ there
    scaled = residual - there @ np.linalg.solve(information, there.T @ residual)
    return float(residual @ scaled + np.linalg.slogdet(information)[1])
