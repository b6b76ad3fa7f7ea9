"""Cross-validation of a cause over records, or over blocks of time.

One fold after the other is left out: each record in turn, or a fourth of a single record that is not periodic. The
model without the cause and the model with it are refitted to the other folds, linearised about their fits to all data,
and only the left-out record's own nuisances are solved for in it. Data that the cause does not change are not left out:
the model error there is independent of the cause. The cycles of one steady tone repeat any model error, so that leaving
some of them out tests nothing: there prediction cannot be tested.

The fall of the sum of squares on the left-out data is a sum over segments of the records; its standard error is that of
a sum of as many independent terms (the test of equal predictive accuracy of Diebold & Mariano, Journal of Business and
Economic Statistics 13 (1995) 253-263, its autocorrelation within a segment counted by summing over it). As a share of
what is left without the cause its error is that of a ratio (Cochran, Sampling Techniques, 1977, section 2.11).

Few folds determine parameters poorly, and the more so the more of them there are. What their errors alone are expected
to add on the left-out data, tr(J C J') of the derivatives J there and the covariance C from the other folds (the
variance in the decomposition of an expected prediction error: Hastie, Tibshirani & Friedman, The Elements of
Statistical Learning, 2009, section 7.3), does not count against a cause.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.confidence.covariance import sandwich
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.score import Projection

TIME_FOLDS = 4  # blocks of time of a single record  [count]
MIN_INFORMATION_SHARE = 0.05  # of the information on a size that the other folds have to hold, to predict by it  [1]
MAX_GROWTH = 4.0  # of a sum of squares when its data are left out  [1]: more exceeds the range of the linearisation
PREDICTION_RANK_TOLERANCE = 1e-7  # singular value over the largest, below which a direction is not moved  [1]


@dataclass(frozen=True)
class Prediction:
    """The reduction of the misfit by a cause on data to which it was not fitted.

    Attributes
    ----------
    reduction : fall of the sum of squares on the left-out data, in units of the noise's variance
    error : its standard error
    without : sum of squares on the left-out data without the cause, in units of the noise's variance
    folds : that were left out in turn
    uncertainty : expected increase of the sum of squares by the cause for the errors of the refitted parameters alone,
        in units of the noise's variance
    share_error : standard error of the reduction over `without`, as of a ratio of sums over segments: where the misfit
        sits in few segments the sum may be uncertain though the share is not
    """

    reduction: float
    error: float
    without: float
    folds: tuple[str, ...]
    uncertainty: float = 0.0
    share_error: float = np.inf

    @property
    def fails(self) -> bool:
        """Whether the misfit does not fall, the increase by the errors of parameters allowed for.

        A single fold is weaker evidence: there it has to rise by its standard error.
        """
        return self.reduction + max(0.0, self.uncertainty) <= (0.0 if len(self.folds) > 1 else -self.error)


def predicted(evidence: Evidence, base: Fit, extended: Fit, candidate: Candidate) -> Prediction | None:
    """Cross-validate a cause.

    Parameters
    ----------
    evidence : that both models were fitted to
    base, extended : the model without the cause and with it, with their derivatives
    candidate : of the cause

    Returns
    -------
    None where no fold can be left out: of one steady tone, where the cause changes one fold only, or where the refits
    leave the range of their linearisation
    """
    own = (*candidate.free, *candidate.form)
    segments, rows = evidence.segments(), evidence.rows()
    falls, squares, tested, uncertainty = [], [], [], 0.0
    for name, left_out in folds(evidence):
        changed = extended.is_changed_by(candidate, extended.columns[left_out])
        if not changed or _information(extended, own, ~left_out) < MIN_INFORMATION_SHARE:
            continue
        before, after = (_left_out(fit, left_out, rows) for fit in (base, extended))
        if max(before.chi2, after.chi2) > MAX_GROWTH * np.sum(base.residual[left_out] ** 2):
            continue
        numbers = segments[left_out]
        uncertainty += after.uncertainty - before.uncertainty
        squares.append(np.bincount(numbers - numbers.min(), before.residual**2))
        falls.append(np.bincount(numbers - numbers.min(), before.residual**2 - after.residual**2))
        tested.append(name)
    if not tested:
        return None
    fall, square = np.concatenate(falls), np.concatenate(squares)
    reduction, without = float(fall.sum()), float(square.sum())
    share_error = _error_of_sum(fall - reduction / without * square) / without if without > 0.0 else np.inf
    return Prediction(reduction, _error_of_sum(fall), without, tuple(tested), uncertainty, share_error)


def _error_of_sum(terms: np.ndarray) -> float:
    """Standard error of the sum of independent terms (n,), infinite of a single one."""
    return float(np.sqrt(terms.size * np.var(terms, ddof=1))) if terms.size > 1 else np.inf


@dataclass(frozen=True, eq=False)
class _LeftOut:
    """Residual of left-out data (n,), and the expected increase of its squares by the errors of the parameters."""

    residual: np.ndarray
    uncertainty: float

    @property
    def chi2(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)


def folds(evidence: Evidence) -> list[tuple[str, np.ndarray]]:
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
    count = int(segments.max()) + 1
    blocks = min(TIME_FOLDS, count)
    if blocks < 2:  # there is nothing left to fit
        return []
    block = segments * blocks // count
    return [(f"block {k + 1} of {blocks} of {part.name}", block == k) for k in range(blocks)]


def _left_out(fit: Fit, left_out: np.ndarray, rows: np.ndarray) -> _LeftOut:
    """Left-out data by the model refitted to the others, linearised about its fit to all.

    rows : (N,) number of the row that each residual belongs to
    """
    columns = fit.free(fit.columns)
    scale = np.linalg.norm(columns, axis=0)
    columns = columns[:, scale > 0.0] / scale[scale > 0.0]
    _, singular, turn = np.linalg.svd(columns[~left_out], full_matrices=False)
    determined = singular > PREDICTION_RANK_TOLERANCE * singular.max(initial=0.0)
    columns = columns @ turn[determined].T  # what the others do not determine is not moved
    training, residual = columns[~left_out], fit.residual[~left_out]
    step = np.linalg.lstsq(training, residual, rcond=None)[0]
    residual = residual - training @ step
    counted = (residual != 0.0) | training.any(axis=1)
    covariance, _ = sandwich(training[counted], residual[counted], rows[~left_out][counted])
    there = columns[left_out]
    return _LeftOut(fit.residual[left_out] - there @ step, float(np.sum((there @ covariance) * there)))


def _information(fit: Fit, own: Sequence[str], training: np.ndarray) -> float:
    """Share of the information on the own parameters, beside all others, that the training data hold  [1]."""
    columns = fit.free(fit.columns)
    mine = np.array([name in own for name in fit.names])
    shares = []
    for data in (np.ones_like(training), training):
        alone = Projection(columns[data][:, ~mine])(columns[data][:, mine])
        shares.append(np.linalg.norm(alone, axis=0) ** 2)
    whole, part = shares
    known = whole > 0.0
    return float((part[known] / whole[known]).min()) if known.any() else 0.0
