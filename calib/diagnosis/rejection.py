"""The stopping rules of the forward selection: reasons why the suspect that explains most is no cause."""

from dataclasses import dataclass

import numpy as np
import scipy

from calib.diagnosis.constancy import constancies, differing
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import chi2_std, dominant, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.prediction import Prediction, predicted
from calib.diagnosis.suspect import Refitted


def cross_validation(evidence: Evidence, base: Fit, extended: Fit, cause: Refitted) -> Prediction | None:
    """Cross-validate a cause; None where that cannot be done, or a derivative is zero."""
    own = (*cause.candidate.free, *cause.candidate.form)
    index = [extended.names.index(name) for name in own if name in extended.names]
    if len(index) < len(own) or not extended.columns[:, index].any(axis=0).all():
        return None
    return predicted(evidence, base, extended, cause.candidate)


@dataclass(frozen=True, eq=False)
class Extension:
    """A model extended by one cause.

    Attributes
    ----------
    base, extended : the model without the cause and with it, with its derivatives
    cause : in the extended model
    prediction : of data to which it was not fitted; None where that cannot be tested
    threshold : of |z|
    """

    base: Fit
    extended: Fit
    cause: Refitted
    prediction: Prediction | None
    threshold: float


def extension(evidence: Evidence, base: Fit, extended: Fit, cause: Refitted, threshold: float) -> Extension:
    """Return the model with a cause beside the one without it, cross-validated."""
    return Extension(base, extended, cause, cross_validation(evidence, base, extended, cause), threshold)


def rejection(evidence: Evidence, null: Fit, made: Extension, further: bool) -> str:
    """Why the cause of an extension is none; "" where it is one.

    Parameters
    ----------
    null : the calibrated model
    further : whether there are causes beside it
    """
    cause, test = made.cause, made.prediction
    if further and is_negligible(evidence, null, made.base, cause.chi2_reduction):
        return "it explains a negligible share of the excess misfit of the calibrated model"
    if _may_be_absent(made.extended, cause):
        return "its confidence interval beside all other parameters contains the size at which it is absent"
    if test is not None and test.fails:
        change = f"{'falls' if test.reduction > 0.0 else 'rises'} by {_chi2(abs(test.reduction))}"
        return (
            f"it does not predict data to which it was not fitted ({', '.join(test.folds)} left out in turn): the sum "
            f"of squares there, in units of the noise variance, {change} ± {_chi2(test.error)}"
        )
    if further and _is_heterogeneous(evidence, made.extended, cause, made.threshold):
        return "its size differs among the channels of the records, and a large misfit remains"
    return ""


def _chi2(size: float) -> str:
    """Write a change of chi-square to two digits, or to the unit."""
    return f"{size:.0f}" if size >= 100.0 else f"{size:.2g}"


def is_negligible(evidence: Evidence, null: Fit, base: Fit, chi2_reduction: float) -> bool:
    """Whether so small a reduction of chi-square beside the causes of `base` is no evidence of another one.

    A negligible share of the excess of the calibrated model corrects the form of the causes before it, which is known
    only as far as they explain the rest; a small share of a remainder that is more than noise explains part of another
    cause.
    """
    std = chi2_std(evidence)
    whole, remainder = excess_chi2(evidence, null), excess_chi2(evidence, base)
    of_whole = significant(whole, std) and chi2_reduction < CRITERIA.negligible_share * whole
    least = CRITERIA.min_share_of_remainder * remainder
    return of_whole or (significant(remainder, std) and chi2_reduction < least)


def _may_be_absent(fit: Fit, cause: Refitted) -> bool:
    """Whether the size of a cause, beside all other parameters of the model with it, may be its null.

    Its joint 95 % interval contains the null - of several parameters, that of each - and so does the one by the
    likelihood ratio, inflated by the remainder: where a size is far from linear, the first is too wide (Hauck and
    Donner, J. Am. Stat. Assoc. 72 (1977) 851). Without a derivative there is no interval.
    """
    names, null = cause.candidate.free, cause.candidate.null
    half = fit.half_width(names)
    known = np.isfinite(half) & np.isfinite(null)
    size = np.array([fit.value(name) for name in names])
    if not known.all() or (np.abs(size - null) >= half).any():
        return False
    limit = scipy.stats.chi2.ppf(CRITERIA.confidence_level, len(names))
    return bool(cause.chi2_reduction / fit.inflation(names) < limit)


def _is_heterogeneous(evidence: Evidence, extended: Fit, cause: Refitted, threshold: float) -> bool:
    """Whether a further cause has another size in each channel, where more than noise is left.

    threshold : of the normal deviate from which sizes differ
    """
    if not dominant(excess_chi2(evidence, extended), chi2_std(evidence)):
        return False
    own = [c for c in constancies(evidence, extended) if c.effect == cause.name]
    return bool(differing(own, threshold, explained_by_several=False))
