"""Constancy of the sizes of effects among the channels of the records: one size each, or several.

Several effects together may imitate one that is no candidate, but hardly with the same sizes everywhere. The sizes of
one effect are freed in each channel of each record, all else being common, and compared by Cochran's Q, whose variances
are those of the standard errors: they include the model error beside the noise (Cochran, Biometrics 10 (1954) 101).
Q tests whether sizes differ; by how much, relative to the size, is their weighted standard deviation over their
weighted mean, Q less its expectation where all are equal (moments, as DerSimonian & Laird, Controlled Clinical Trials 7
(1986) 177, and for weights that are no inverse variances DerSimonian & Kacker, Contemporary Clinical Trials 28 (2007)
105). Weights are the inverse of those variances, or the information that noise alone leaves. The former count most what
a channel says in which little model error stands, but which calibrated parameters shift that follow the model error of
others; the latter a channel that is mostly model error. Only where both differ do sizes differ for another reason. By
the latter, sizes vary by 1 / sqrt(m) at most, where the cause explains m times the misfit that it leaves: all that
would be explained if each channel had its own. From m = 9 on no difference among channels refutes a single cause.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.confidence.covariance import sandwich
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.score import Projection, deviate

CONSTANCY_RANK_TOLERANCE = 1e-9  # singular value over the largest, below which a direction is undetermined  [1]
CHANNELS, RECORDS = "the channels of the records", "the records"
MIN_DEGREES_OF_FREEDOM = 4.0  # of a variance  [1]: below 2 the mean of F does not exist


@dataclass(frozen=True)
class Constancy:
    """How much the sizes of one effect differ among the channels of the records, or from record to record.

    Attributes
    ----------
    effect : its name
    z : normal deviate of Cochran's Q  [1]
    variation : standard deviation of the sizes over their mean  [1]; among channels both weighted by the inverse of
        their variances, or by the information that noise leaves, whichever differ less; among records unweighted
    chi2 : by which the sum of squares would rise without the effect, to first order; infinite where it is absent only
        at an infinite size  [1]
    among : CHANNELS or RECORDS
    """

    effect: str
    z: float
    variation: float
    chi2: float
    among: str = CHANNELS


def differing(
    tested: Sequence[Constancy], threshold: float, explained_by_several: bool, is_remainder_significant: bool = True
) -> tuple[Constancy, ...]:
    """Return those whose sizes differ: each stands in for another cause.

    Significantly, and by more than a model error may account for. Where only noise is left no model error accounts for
    a difference of records; nor of channels, where several effects leave only noise: they may imitate any other, and
    have one size each if they do not.

    Parameters
    ----------
    threshold : of the normal deviate
    explained_by_several : whether these effects are several, and leave nothing but noise
    is_remainder_significant : whether these effects leave more than noise, by the sum of squares or by sizes that
        differ within the fit
    """
    least = {
        CHANNELS: 0.0 if explained_by_several else CRITERIA.max_variation,
        RECORDS: CRITERIA.max_variation if is_remainder_significant else 0.0,
    }
    return tuple(
        c for c in tested
        if c.z > threshold
        and (least[c.among] == 0.0 or c.variation > least[c.among])
    )  # fmt: skip


def constancies(evidence: Evidence, fit: Fit) -> tuple[Constancy, ...]:
    """Constancy of each effect in a fit, which has its derivatives; z is 0 where it changes one channel alone."""
    return tuple(_constancy(evidence, fit, index) for index in range(len(fit.candidates)))


def _constancy(evidence: Evidence, fit: Fit, index: int) -> Constancy:
    """Constancy of one of the effects in a fit."""
    candidate, rows = fit.candidates[index], evidence.rows()
    names = [name for name in (*candidate.free, *candidate.form) if fit.columns[:, fit.names.index(name)].any()]
    own = [fit.names.index(name) for name in names]
    common, everywhere = np.delete(fit.free(fit.columns), own, axis=1), fit.columns[:, own]
    by_row = [evidence.of_row(everywhere, int(row)) for row in np.unique(rows)]
    pairs = [(k, row) for k in range(len(own)) for row in range(len(by_row))]
    changed = [(k, row) for k, row in pairs if _changes(by_row[row][:, k], everywhere[:, k])]
    single = np.column_stack([by_row[row][:, k] for k, row in changed]) if changed else everywhere
    chi2 = _chi2(fit, candidate.effect.null, names, Projection(common)(fit.free(everywhere)))
    if len(changed) <= len(own):
        return Constancy(candidate.name, 0.0, 0.0, chi2)
    single = fit.free(single)
    sizes, covariance, freedom = _unrestricted(fit.residual, rows, common, single)
    sizes = sizes + np.array([fit.value(names[k]) for k, _ in changed])
    parameter = np.array([k for k, _ in changed])
    q, degrees, mean_chi2 = cochran(sizes, covariance, parameter)
    least = max(MIN_DEGREES_OF_FREEDOM, float(freedom.min()))
    z = float(deviate(q * (least - 2.0) / least, degrees))
    beside_common = Projection(common)(single)
    by_noise = _variation_by_information(sizes, covariance, beside_common.T @ beside_common, parameter)
    return Constancy(candidate.name, z, min(variation(q, degrees, mean_chi2), by_noise), chi2)


def _changes(alone: np.ndarray, column: np.ndarray) -> bool:
    """Whether an effect with this derivative (N,) changes a row that has this part of it."""
    return float(np.linalg.norm(alone)) > CONSTANCY_RANK_TOLERANCE * float(np.linalg.norm(column))


def _chi2(fit: Fit, null: Mapping[str, float], names: Sequence[str], columns: np.ndarray) -> float:
    """Rise of the sum of squares where the sizes of these names go to null; columns (N, p) without what others absorb.

    Infinite where a null is.
    """
    away = np.array([fit.value(name) - null.get(name, fit.value(name)) for name in names])
    if not np.isfinite(away).all():
        return np.inf
    change = columns @ away
    return float(change @ change)


def _unrestricted(
    residual: np.ndarray, rows: np.ndarray, common: np.ndarray, single: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps (m,) of the sizes of single channels, their covariance (m, m) and the degrees of freedom of its variances.

    common (N, k), single (N, m) : derivatives by what all channels share, and by the sizes of single channels
    """
    columns, m = np.column_stack([common, single]), single.shape[1]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    step = np.linalg.lstsq(columns / scale, residual, rcond=CONSTANCY_RANK_TOLERANCE)[0] / scale
    remainder = residual - columns @ step
    counted = (remainder != 0.0) | columns.any(axis=1)
    covariance, freedom = sandwich(columns[counted], remainder[counted], rows[counted])
    return step[-m:], covariance[-m:, -m:], freedom[-m:]


def variation(q: float, expected: float, mean_chi2: float) -> float:
    """Standard deviation of sizes over their mean  [1], by Q, that of equal ones, and chi-square of the mean."""
    return float(np.sqrt(max(0.0, q - expected) / max(mean_chi2, 1e-300)))


def cochran(sizes: np.ndarray, covariance: np.ndarray, parameter: np.ndarray) -> tuple[float, int, float]:
    """Cochran's Q, its degrees of freedom, and the chi-square of the weighted mean.

    sizes (m,) with their covariance, parameter (m,) : number of the parameter that each is of
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    scales = np.outer(scale, scale)
    weight = np.linalg.pinv(covariance / scales, rcond=CONSTANCY_RANK_TOLERANCE, hermitian=True) / scales
    q, mean_chi2, _ = _about_their_mean(sizes, weight, parameter)
    return q, len(sizes) - int(parameter.max() + 1), mean_chi2


def _variation_by_information(
    sizes: np.ndarray, covariance: np.ndarray, information: np.ndarray, parameter: np.ndarray
) -> float:
    """Variation of sizes (m,) weighted by the information (m, m) on them, with what their covariance makes of Q."""
    q, mean_chi2, within = _about_their_mean(sizes, information, parameter)
    return variation(q, float(np.sum(within * covariance)), mean_chi2)


def _about_their_mean(sizes: np.ndarray, weight: np.ndarray, parameter: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Weighted sums of squares about the means and of the means, and the form (m, m) that gives the former."""
    groups = (parameter[:, None] == np.arange(parameter.max() + 1)).astype(float)
    information = groups.T @ weight @ groups
    mean = np.linalg.lstsq(information, groups.T @ weight @ sizes, rcond=None)[0]
    within = weight - weight @ groups @ np.linalg.lstsq(information, groups.T @ weight, rcond=None)[0]
    deviation = sizes - groups @ mean
    return float(deviation @ weight @ deviation), float(mean @ information @ mean), within
