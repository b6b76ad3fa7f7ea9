"""Whether a cause predicts data that had no part in fitting it: cross-validation over records, or blocks of time.

One fold after the other is left out: each record in turn, or a fourth of a single record that does not repeat. The
model without the cause and the model with it are refitted to the other folds, linearised about their fits to all data,
and only the left-out record's own nuisances are solved for in it. The cycles of one steady tone repeat whatever a model
lacks, so that leaving some of them out would prove nothing: there prediction cannot be tested.

The fall of the sum of squares on the left-out data is a sum over segments of the records; its standard error is that of
a sum of as many independent terms (the test of equal predictive accuracy of Diebold & Mariano, Journal of Business and
Economic Statistics 13 (1995) 253-263, its autocorrelation within a segment counted by summing over it).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.refit import Fit
from calib.diagnosis.score import Projection

TIME_FOLDS = 4  # blocks of time of a single record
LEAST_INFORMATION = 0.05  # share of what is known of a size that the other folds have to hold, to predict by it
MAX_GROWTH = 4.0  # of a sum of squares when its data are left out: more is beyond what a linearisation holds for
RANK = 1e-7  # singular value, over the largest, below which a direction stays where it is


@dataclass(frozen=True)
class Prediction:
    """What a cause brings on data that had no part in fitting it.

    Attributes
    ----------
    reduction : fall of the sum of squares on the left-out data, in units of the noise's variance
    error : its standard error
    without : sum of squares on the left-out data without the cause, in units of the noise's variance
    folds : what was left out in turn
    """

    reduction: float
    error: float
    without: float
    folds: tuple[str, ...]

    @property
    def fails(self) -> bool:
        """Whether the misfit does not fall; a single fold tells less: there it has to rise by its standard error."""
        return self.reduction <= (0.0 if len(self.folds) > 1 else -self.error)


def predicted(evidence: Evidence, base: Fit, extended: Fit, own: Sequence[str]) -> Prediction | None:
    """Cross-validate a cause.

    Parameters
    ----------
    evidence : that both models were fitted to
    base, extended : the model without the cause and with it, with their derivatives
    own : names of the parameters of the cause

    Returns
    -------
    None where no fold can be left out: of one steady tone, where but one fold shows the cause at all, or where the
    refits leave the range of their linearisation
    """
    segments = evidence.segments()
    falls, tested, without = [], [], 0.0
    for name, left_out in _folds(evidence):
        if _information(extended, own, ~left_out) < LEAST_INFORMATION:
            continue
        squares = [_residual(fit, left_out) ** 2 for fit in (base, extended)]
        if max(map(np.sum, squares)) > MAX_GROWTH * np.sum(base.residual[left_out] ** 2):
            continue
        fall = squares[0] - squares[1]
        numbers = segments[left_out]
        without += float(squares[0].sum())
        falls.append(np.bincount(numbers - numbers.min(), fall))
        tested.append(name)
    if not tested:
        return None
    sums = np.concatenate(falls)
    error = float(np.sqrt(sums.size * np.var(sums, ddof=1))) if sums.size > 1 else np.inf
    return Prediction(float(sums.sum()), error, without, tuple(tested))


def _folds(evidence: Evidence) -> list[tuple[str, np.ndarray]]:
    """Name and residuals (N,) of each fold."""
    segments = evidence.segments()
    if len(evidence.parts) > 1:
        masks = []
        for name in evidence.names:
            mask = np.zeros(segments.size, dtype=bool)
            mask[evidence.of(name)] = True
            masks.append((name, mask))
        return masks
    [part] = evidence.parts
    if part.period is not None:
        return []
    block = segments * TIME_FOLDS // (segments.max() + 1)
    return [(f"block {k + 1} of {TIME_FOLDS} of {part.name}", block == k) for k in range(TIME_FOLDS)]


def _residual(fit: Fit, left_out: np.ndarray) -> np.ndarray:
    """Residual of the left-out data by the model refitted to the others, linearised about its fit to all."""
    columns = fit.free(fit.columns)
    scale = np.linalg.norm(columns, axis=0)
    columns = columns[:, scale > 0.0] / scale[scale > 0.0]
    step = np.linalg.lstsq(columns[~left_out], fit.residual[~left_out], rcond=RANK)[0]
    return (fit.residual - columns @ step)[left_out]


def _information(fit: Fit, own: Sequence[str], kept: np.ndarray) -> float:
    """Share of the information on the own parameters, beside all others, that the kept data hold  [1]."""
    columns = fit.free(fit.columns)
    mine = np.array([name in own for name in fit.names])
    shares = []
    for data in (np.ones_like(kept), kept):
        alone = Projection(columns[data][:, ~mine])(columns[data][:, mine])
        shares.append(np.linalg.norm(alone, axis=0) ** 2)
    whole, part = shares
    known = whole > 0.0
    return float((part[known] / whole[known]).min()) if known.any() else 0.0
